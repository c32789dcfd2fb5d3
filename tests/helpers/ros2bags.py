"""Writes ROS 2 bags for the tests to read back, and to damage."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Sequence
from pathlib import Path

import yaml
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.helpers.bags import write_serialized
from tests.helpers.broken import SECOND, STRING, Sent


def cdr(messages: Iterable[Sent]) -> list[Sent]:
    return [message._replace(data=b"\0\1\0\0" + message.data) for message in messages]


def write_bag(
    path: Path,
    messages: Iterable[Sent],
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    writer = Writer2(path, version=9, storage_plugin=plugin)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    strings = ((topic, STRING, time, data) for topic, time, data in messages)
    write_serialized(writer, get_typestore(Stores.LATEST), strings)
    return path


def write_early(path: Path, messages: Sequence[Sent], **pragmas: str) -> Path:
    """Write a file as ROS 2 Dashing did, without definitions, profiles and schema version."""
    with sqlite3.connect(path, isolation_level=None) as database:
        for name, value in pragmas.items():
            database.execute(f"PRAGMA {name} = {value}")
        database.executescript(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
        )
        topics = list(dict.fromkeys(message.topic for message in messages))
        for number, topic in enumerate(topics, 1):
            database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr')", (number, topic, STRING))
        database.execute("BEGIN")
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(topics.index(topic) + 1, time, data) for topic, time, data in messages],
        )
        database.execute("COMMIT")
    database.close()
    return path


def split(folder: Path, messages: Sequence[Sent], parts: int = 3) -> Path:
    """Write a bag of several files whose times overlap: each has every third message."""
    folder.mkdir()
    files = []
    for part in range(parts):
        name = f"bag_{part}.db3"
        write_early(folder / name, messages[part::parts])
        files.append((name, len(messages[part::parts])))
    information = {
        "version": 5,
        "storage_identifier": "sqlite3",
        "message_count": len(messages),
        "relative_file_paths": [name for name, _ in files],
        "files": [
            {"path": name, "message_count": count, "duration": {"nanoseconds": 60 * SECOND}}
            for name, count in files
        ],
    }
    (folder / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": information})
    )
    return folder
