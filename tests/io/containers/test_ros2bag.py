"""ROS 2 bags: folders and lone files of SQLite and MCAP, split, compressed, cut, contradicted.

Ways to pass without being right: the metadata believed instead of the files; the files of a
split bag read one after the other although their times overlap; a log beside a file ignored;
a file written beside the user's; what is missing of a page of SQLite taken for zeros.
"""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from mlscli.errors import InputError
from mlscli.io.containers.opening import open_container
from mlscli.io.containers.ros2bag import Ros2Bag
from mlscli.io.containers.sqlitefile import SqliteFile
from tests.bags import write_serialized
from tests.broken import (
    SECOND,
    STRING,
    Sent,
    allocating_less_than,
    by_anyreader,
    check_every_cut,
    content,
    flight,
    one_line,
    read_or_refused,
    refusal,
    write_mcap,
)

PLUGINS = pytest.mark.parametrize("plugin", list(StoragePlugin))


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


def edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / "metadata.yaml"
    metadata = yaml.safe_load(path.read_text())
    change(metadata["rosbag2_bagfile_information"])
    path.write_text(yaml.safe_dump(metadata))


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


@pytest.mark.parametrize("name", ["ros2_jackal_scan_pose", "ros2_tf_example"])
def test_a_recorded_bag_reads_as_rosbags_reads_it(shared_data: Path, name: str) -> None:
    folder = shared_data / "bags" / name
    bag = open_container(folder)
    expected = by_anyreader(folder)
    assert content(bag) == expected
    assert bag.kind == "ROS 2 bag"
    assert (list(bag.losses), list(bag.notes)) == ([], [])
    assert bag.time_span == (expected[0].log_time, expected[-1].log_time)
    for channel in bag.channels:
        assert channel.count == sum(message.topic == channel.topic for message in expected)
        assert channel.schema_encoding == "ros2msg"
        assert channel.schema
    (file,) = folder.glob("*.db3")
    assert content(open_container(file)) == expected


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (plugin, mode)
        for plugin in StoragePlugin
        for mode in CompressionMode
        # SQLite does not compress by itself.
        if (plugin, mode) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)
    ],
)
def test_a_written_bag_reads_as_rosbags_reads_it(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
) -> None:
    messages = cdr(flight())
    folder = write_bag(tmp_path / "bag", messages, plugin, mode)
    bag = Ros2Bag(folder)
    assert by_anyreader(folder) == messages
    assert content(bag) == messages
    assert (list(bag.losses), bag.notes) == ([], [])
    next(bag.messages())
    assert content(bag, ["/b"]) == [message for message in messages if message.topic == "/b"]
    # Without metadata the files say the same, and a note that there are none.
    (folder / "metadata.yaml").unlink()
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert list(bag.losses) == []
    assert "has no metadata.yaml" in bag.notes[0]
    (file,) = folder.iterdir()
    assert content(open_container(file)) == messages


def test_a_file_of_an_early_version_is_read(tmp_path: Path) -> None:
    messages = flight()
    file = open_container(write_early(tmp_path / "a.db3", messages))
    assert content(file) == messages
    assert [
        (c.topic, c.type, c.encoding, c.schema, c.schema_encoding, c.count) for c in file.channels
    ] == [(topic, STRING, "cdr", b"", "", 60) for topic in ("/a", "/b")]


def test_messages_come_in_the_order_of_time_and_equal_times_in_that_of_recording(
    tmp_path: Path,
) -> None:
    rng = random.Random(3)
    messages = [m._replace(log_time=SECOND + rng.randrange(40)) for m in flight(300)]
    file = SqliteFile(write_early(tmp_path / "a.db3", messages))
    assert content(file) == sorted(messages, key=lambda m: m.log_time)


def test_files_whose_times_overlap_are_merged(tmp_path: Path) -> None:
    messages = flight()
    bag = Ros2Bag(split(tmp_path / "bag", messages))
    assert content(bag) == messages
    assert [(c.topic, c.count) for c in bag.channels] == [("/a", 60), ("/b", 60)]
    assert (list(bag.losses), bag.notes) == ([], [])


@PLUGINS
def test_memory_stays_flat(tmp_path: Path, plugin: StoragePlugin) -> None:
    folder = write_bag(tmp_path / "bag", flight(240, size=100_000), plugin)
    bag = Ros2Bag(folder)
    with allocating_less_than(4_000_000):
        assert sum(len(message.data) for message in bag.messages()) > 20_000_000


def test_a_file_that_is_missing_is_told_with_what_it_should_hold(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "bag_1.db3").unlink()
    bag = Ros2Bag(folder)
    assert content(bag) == [m for n, m in enumerate(messages) if n % 3 != 1]
    (told,) = bag.losses
    assert told == (
        f"{folder}: metadata.yaml names bag_1.db3, which is missing; lost: 40 messages, 60.000 s"
    )


def test_a_file_that_cannot_be_read_leaves_the_others(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "bag_2.db3").write_bytes(b"")
    bag = Ros2Bag(folder)
    assert content(bag) == [m for n, m in enumerate(messages) if n % 3 != 2]
    (told,) = bag.losses
    assert "bag_2.db3" in told
    assert "lost: 40 messages" in told


def test_files_that_the_metadata_do_not_name_are_read_and_noted(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)

    def forget(information: dict[str, Any]) -> None:
        information["relative_file_paths"].pop()
        information["files"].pop()
        information["message_count"] = 80

    edit(folder, forget)
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert list(bag.losses) == []
    assert "does not name bag_2.db3" in bag.notes[0]
    assert "declares 80 messages, the files hold 120" in bag.notes[1]


def test_metadata_that_declare_more_than_there_is_are_a_loss(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    edit(folder, lambda information: information.update(message_count=130))
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    (told,) = bag.losses
    assert "declares 130 messages, the files hold 120; lost: 10 messages" in told


def test_a_file_that_was_compressed_or_decompressed_by_hand_is_read_once(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    file = folder / "bag_1.db3"
    (folder / "bag_1.db3.zstd").write_bytes(zstandard.compress(file.read_bytes()))
    assert content(Ros2Bag(folder)) == messages
    file.unlink()
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert (list(bag.losses), bag.notes) == ([], [])


@pytest.mark.parametrize("text", ["rosbag2_bagfile_information: [", "- 1\n- 2\n", "\0\1\2", ""])
def test_metadata_that_cannot_be_read_do_not_keep_the_files_from_it(
    tmp_path: Path, text: str
) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "metadata.yaml").write_text(text)
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert all(one_line(note) for note in bag.notes)


def test_files_of_both_kinds_in_a_folder_are_read_in_the_order_of_time(tmp_path: Path) -> None:
    messages = flight()
    write_early(tmp_path / "a_0.db3", messages[::2])
    write_mcap(tmp_path / "a_1.mcap", messages[1::2])
    assert content(Ros2Bag(tmp_path)) == messages


def test_files_of_several_recordings_are_not_taken_for_one(tmp_path: Path) -> None:
    write_early(tmp_path / "a_0.db3", flight())
    write_early(tmp_path / "b_0.db3", flight())
    with pytest.raises(InputError, match=r"a_0.db3, b_0.db3 .* name one of them"):
        Ros2Bag(tmp_path)


def test_of_equal_times_the_file_with_the_lower_number_comes_first(tmp_path: Path) -> None:
    messages = [message._replace(log_time=SECOND) for message in flight(3)]
    for name, message in zip(("bag_1", "bag_2", "bag_10"), messages, strict=True):
        write_early(tmp_path / f"{name}.db3", [message])
    assert content(Ros2Bag(tmp_path)) == messages


def test_a_compressed_file_that_is_cut_yields_what_lies_before_the_cut(tmp_path: Path) -> None:
    messages = cdr(flight(size=4000))
    write_mcap(tmp_path / "a.mcap", messages, chunk_size=10_000)
    packed = zstandard.compress((tmp_path / "a.mcap").read_bytes())
    (tmp_path / "a.mcap").unlink()
    file = tmp_path / "a.mcap.zstd"
    file.write_bytes(packed[: len(packed) * 2 // 3])
    bag = Ros2Bag(tmp_path)
    found = content(bag)
    assert 20 < len(found) < len(messages)
    assert found == messages[: len(found)]
    (told,) = bag.losses
    assert told.startswith(f"{file}: breaks off")


def whole_in_sqlite(path: Path, messages: Sequence[Sent]) -> Callable[[int], list[Sent]]:
    """Return what tells the messages all of whose pages lie before a byte.

    Random data stands in a file only once. Data of more than a page is found by its last bytes,
    as pages were only ever added.
    """
    data = path.read_bytes()
    page = int.from_bytes(data[16:18], "big")
    ends = []
    for message in messages:
        at = max(data.index(message.data[:40]), data.index(message.data[-20:]))
        ends.append((at // page + 1) * page)
    return lambda size: [m for m, end in zip(messages, ends, strict=True) if end <= size]


@pytest.mark.parametrize("size", [300, 3000, 20_000])
def test_a_file_cut_anywhere_yields_what_lies_whole(tmp_path: Path, size: int) -> None:
    messages = flight(200, size=size)
    (tmp_path / "cut").mkdir()
    path = write_early(tmp_path / "a.db3", messages)
    whole = whole_in_sqlite(path, messages)
    # Before the pages of the schema and the topics, messages have no names.
    named = 4 * 4096
    check_every_cut(
        path, tmp_path / "cut", SqliteFile, lambda size: whole(size) if size > named else [], 60
    )


def test_a_recorded_file_cut_anywhere_yields_no_other_messages(
    shared_data: Path, tmp_path: Path
) -> None:
    for name in ("ros2_tf_example", "ros2_jackal_scan_pose"):
        (path,) = (shared_data / "bags" / name).glob("*.db3")
        check_every_cut(path, tmp_path, SqliteFile, lambda _: [], places=15)


def test_of_a_cut_file_nearly_all_that_lies_before_the_cut_is_read(
    shared_data: Path, tmp_path: Path
) -> None:
    (path,) = (shared_data / "bags" / "ros2_jackal_scan_pose").glob("*.db3")
    data = path.read_bytes()
    part = tmp_path / "a.db3"
    for share in (0.25, 0.5, 0.75):
        part.write_bytes(data[: int(len(data) * share)])
        found = content(SqliteFile(part))
        assert len(found) > (share - 0.02) * 2472


@pytest.mark.parametrize("size", [300, 20_000])
def test_damaged_pages_lose_their_messages_and_no_others(tmp_path: Path, size: int) -> None:
    messages = flight(200, size=size)
    path = write_early(tmp_path / "a.db3", messages)
    data = bytearray(path.read_bytes())
    at = data.index(messages[100].data[:40]) // 4096 * 4096
    data[at : at + 4096] = b"\xff" * 4096
    path.write_bytes(data)
    file = SqliteFile(path)
    found = content(file)
    lost = [message for message in messages if message not in found]
    assert messages[100] in lost
    assert len(lost) < 20
    assert found == [message for message in messages if message not in lost]
    assert f"lost: {len(lost)} message" in file.losses[0]


def test_rotten_bits_end_in_no_worse_than_a_loss(tmp_path: Path) -> None:
    messages = flight(100)
    path = write_early(tmp_path / "a.db3", messages)
    data = path.read_bytes()
    part = tmp_path / "rotten.db3"
    rng = random.Random(11)
    for turn in range(200):
        rotten = bytearray(data)
        # Every other turn in what leads to the rows: the schema and the topics.
        at = rng.randrange(8192) if turn % 2 else rng.randrange(8192, len(data))
        rotten[at] ^= 1 << rng.randrange(8)
        part.write_bytes(rotten)
        found, told = read_or_refused(SqliteFile, part)
        assert all(one_line(line) for line in told)
        # A bit spoils a message, or what leads to those of a page, of which there are less than 20.
        spoilt = Counter(messages) - Counter(found)
        assert turn % 2 or sum(spoilt.values()) < 20


def test_what_a_recorder_left_in_a_log_is_read_and_nothing_is_written_beside(
    tmp_path: Path,
) -> None:
    messages = flight()
    folder = tmp_path / "bag"
    folder.mkdir()
    path = write_early(tmp_path / "live.db3", messages[:100], journal_mode="WAL")
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA wal_autocheckpoint = 0")
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(1 + (topic == "/b"), time, data) for topic, time, data in messages[100:]],
        )
        database.commit()
        # The recorder is killed: what is on the disk stays as it is.
        for ending in ("", "-wal", "-shm"):
            shutil.copyfile(f"{path}{ending}", folder / f"bag_0.db3{ending}")
    database.close()
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert len(before["bag_0.db3-wal"]) > 0
    for target in (folder, folder / "bag_0.db3"):
        bag = open_container(target)
        assert content(bag) == messages
        assert content(bag, ["/a"]) == [message for message in messages if message.topic == "/a"]
    assert {file.name: file.read_bytes() for file in folder.iterdir()} == before
    (folder / "bag_0.db3-wal").unlink()
    assert content(open_container(folder)) == messages[:100]


def test_messages_of_no_topic_are_told(tmp_path: Path) -> None:
    path = write_early(tmp_path / "a.db3", flight())
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM topics WHERE name = '/b'")
    database.close()
    file = SqliteFile(path)
    assert len(content(file)) == 60
    assert "60 messages belong to no topic" in file.losses[0]


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    assert "holds nothing" in refusal(open_container, folder)
    (folder / "notes.txt").write_text("hello")
    assert "notes.txt" in refusal(open_container, folder)
    (folder / "a.db3").write_bytes(b"")
    assert "is empty" in refusal_of(folder)
    (folder / "a.db3").write_bytes(b"x,y,z\n")
    assert "expected SQLite or MCAP" in refusal_of(folder)
    (folder / "a.db3").write_bytes(b"SQLite format 3\0" + b"\7" * 5000)
    refusal_of(folder)
    other = tmp_path / "other.db3"
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE photos(id)")
    database.close()
    assert "tables photos" in refusal(open_container, other)
    assert "no such file" in refusal(open_container, tmp_path / "none.db3").lower()


def refusal_of(folder: Path) -> str:
    """Return why a folder is refused of which one file is to blame."""
    words = refusal(open_container, folder)
    assert words.startswith(f"{folder}/a.db3: ")
    return words
