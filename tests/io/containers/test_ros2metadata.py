"""What the metadata of a ROS 2 bag say beside what its files say: no more, less, or nonsense.

Ways to pass without being right: the metadata believed instead of the files; a difference that
is told as a loss although all is there.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
import zstandard

from mlscli.io.containers.ros2bag import Ros2Bag
from tests.helpers.broken import content, flight, one_line, write_mcap
from tests.helpers.ros2bags import split, write_early


def edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / "metadata.yaml"
    metadata = yaml.safe_load(path.read_text())
    change(metadata["rosbag2_bagfile_information"])
    path.write_text(yaml.safe_dump(metadata))


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


@pytest.mark.parametrize(
    "value",
    ["!!timestamp foo", '!!int ""', "!!bool foo", "!!float x", '"\\U80000000"', "!!binary ä"],
)
def test_metadata_of_values_that_do_not_fit_their_tags_leave_the_files(
    tmp_path: Path, value: str
) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  version: {value}\n")
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    (note,) = bag.notes
    assert note.startswith(f"{folder / 'metadata.yaml'}: cannot be read: ")
    assert one_line(note)


def forget(folder: Path, count: int = 40) -> None:
    """Leave the last file out of the metadata."""

    def change(information: dict[str, Any]) -> None:
        information["relative_file_paths"].pop()
        information["files"].pop()
        information["message_count"] -= count

    edit(folder, change)


def test_a_file_that_goes_on_where_the_metadata_end_is_read_and_noted(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    forget(folder)
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert list(bag.losses) == []
    assert "does not name bag_2.db3; it is read" in bag.notes[0]
    assert "declares 80 messages, the files hold 120" in bag.notes[1]


@pytest.mark.parametrize(
    "name", ["bag_0 (copy).db3", "bag_0_backup.db3", "bag_7.db3", "bag_1.mcap", "bag.mcap", "x.db3"]
)
def test_a_copy_or_what_was_left_over_is_not_read_twice(tmp_path: Path, name: str) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (write_mcap if name.endswith("mcap") else write_early)(folder / name, messages[1::3])
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert list(bag.losses) == []
    (note,) = bag.notes
    assert name in note
    assert "not read" in note


def test_in_place_of_a_file_that_is_missing_another_is_read_but_no_copy(tmp_path: Path) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "bag_1.db3").rename(folder / "renamed.db3")
    (folder / "bag_0 (copy).db3").write_bytes((folder / "bag_0.db3").read_bytes())
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    notes = " ".join(bag.notes)
    assert "does not name renamed.db3; it is read" in notes
    assert "bag_0 (copy).db3, which metadata.yaml does not name, is not read" in notes


@pytest.mark.parametrize("has_metadata", [True, False])
def test_what_macos_puts_beside_a_file_is_none_of_the_bag(
    tmp_path: Path, *, has_metadata: bool
) -> None:
    messages = flight()
    folder = split(tmp_path / "bag", messages)
    (folder / "._bag_0.db3").write_bytes(b"\0\5\x16\7Mac OS X")
    if not has_metadata:
        (folder / "metadata.yaml").unlink()
    bag = Ros2Bag(folder)
    assert content(bag) == messages
    assert list(bag.losses) == []


def test_without_metadata_a_converted_file_is_not_read_beside_what_it_was(tmp_path: Path) -> None:
    messages = flight()
    write_early(tmp_path / "bag_0.db3", messages)
    write_mcap(tmp_path / "bag_0.mcap", messages)
    bag = Ros2Bag(tmp_path)
    assert content(bag) == messages
    assert "bag_0.mcap is not read: its messages are those of other files" in bag.notes[-1]


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
