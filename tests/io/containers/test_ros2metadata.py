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
from tests.helpers.broken import content, flight, one_line
from tests.helpers.ros2bags import split


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
