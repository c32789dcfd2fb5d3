"""ROS 2 bags: folders and lone files of SQLite and MCAP, split, compressed, cut, refused.

Ways to pass without being right: the files of a split bag read one after the other although
their times overlap; all of a folder taken for one recording; equal times in any order.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from mlscli.errors import InputError
from mlscli.io.containers.opening import open_container
from mlscli.io.containers.ros2bag import Ros2Bag
from tests.helpers.broken import (
    SECOND,
    allocating_less_than,
    by_anyreader,
    content,
    flight,
    refusal,
    write_mcap,
)
from tests.helpers.ros2bags import cdr, split, write_bag, write_early


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


def test_files_whose_times_overlap_are_merged(tmp_path: Path) -> None:
    messages = flight()
    bag = Ros2Bag(split(tmp_path / "bag", messages))
    assert content(bag) == messages
    assert [(c.topic, c.count) for c in bag.channels] == [("/a", 60), ("/b", 60)]
    assert (list(bag.losses), bag.notes) == ([], [])


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_memory_stays_flat(tmp_path: Path, plugin: StoragePlugin) -> None:
    folder = write_bag(tmp_path / "bag", flight(240, size=100_000), plugin)
    bag = Ros2Bag(folder)
    with allocating_less_than(4_000_000):
        assert sum(len(message.data) for message in bag.messages()) > 20_000_000


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


def test_a_compressed_file_that_is_cut_in_its_first_block_is_no_empty_one(tmp_path: Path) -> None:
    write_mcap(tmp_path / "a.mcap", cdr(flight()))
    file = tmp_path / "a.mcap.zstd"
    file.write_bytes(zstandard.compress((tmp_path / "a.mcap").read_bytes())[:9_000])

    words = refusal(open_container, file)

    assert "cannot be decompressed: it breaks off, within its first block" in words


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
