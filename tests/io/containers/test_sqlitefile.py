"""SQLite files of ROS 2 bags: of early versions, with logs, cut, rotten.

Ways to pass without being right: a log beside a file ignored; a file written beside the user's;
what is missing of a page taken for zeros.
"""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from mlscli.io.containers.opening import open_container
from mlscli.io.containers.sqlitefile import SqliteFile
from tests.helpers.broken import (
    SECOND,
    STRING,
    Sent,
    allocating_less_than,
    check_every_cut,
    content,
    flight,
    one_line,
    read_or_refused,
)
from tests.helpers.ros2bags import write_early


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


def test_data_that_the_database_computes_takes_no_more_than_its_file(tmp_path: Path) -> None:
    path = write_early(tmp_path / "bag.db3", [])
    with sqlite3.connect(path, isolation_level=None) as database:
        database.executescript(
            "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, "
            "timestamp INTEGER, data BLOB AS (zeroblob(900000000)));"
            "INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr');"
            "INSERT INTO messages (topic_id, timestamp) VALUES (1, 5);"
        )
    database.close()
    bag = SqliteFile(path)
    with allocating_less_than(20_000_000):
        assert content(bag) == []
    assert "lost" in bag.losses[0]


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


def pages(path: Path) -> dict[str, int]:
    """Return the offset of the first page of each table."""
    with sqlite3.connect(path) as database:
        found = dict(database.execute("SELECT name, rootpage FROM sqlite_master"))
    database.close()
    return {name: (page - 1) * 4096 for name, page in found.items()}


@pytest.mark.parametrize("filled", [b"\0", b"\xff"])
def test_a_damaged_page_of_the_topics_is_named_as_that(tmp_path: Path, filled: bytes) -> None:
    path = write_early(tmp_path / "a.db3", flight(200))
    at, data = pages(path)["topics"], bytearray(path.read_bytes())
    data[at : at + 4096] = filled * 4096
    path.write_bytes(data)

    file = SqliteFile(path)
    assert content(file) == []
    assert file.losses == [
        f"{path}: its table of topics is damaged, and 1 more fault; lost: 200 messages"
    ]


def test_where_the_list_of_tables_is_damaged_nothing_is_guessed(tmp_path: Path) -> None:
    path = write_early(tmp_path / "a.db3", flight(200))
    data = bytearray(path.read_bytes())
    data[100:4096] = bytes(3996)
    path.write_bytes(data)

    _, (told,) = read_or_refused(SqliteFile, path)
    assert told == (
        f"{path}: is a damaged SQLite database, of which no table can be read; without its table "
        "of topics nothing says what its messages are"
    )


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
