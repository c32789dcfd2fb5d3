"""Bags that were cut, overwritten or robbed of messages.

How these tests could be cheated: by skipping in silence what cannot be read. So clouds are
counted against what was sent, and whatever is missing must be told.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.base import Cloud
from mlscli.io.formats import open_source
from tests.bags import Sent, write_bag

KINDS = ["ros1", "ros2", "mcap"]


def some_points(count: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32).astype(float)


def points_of(clouds: list[Cloud]) -> list[object]:
    return [cloud.points.tolist() for cloud in clouds]


def storage_of(bag: Path) -> Path:
    """Return the file that holds the messages."""
    return bag if bag.is_file() else next(p for p in bag.iterdir() if p.suffix != ".yaml")


@pytest.fixture
def messages() -> list[Sent]:
    return [
        Sent(some_points(5 + k, k), nanoseconds=1_600_000_000_123_456_789 + k) for k in range(4)
    ]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
def test_a_cut_bag_is_one_clear_error_or_a_loss(tmp_path: Path, kind: str, share: float) -> None:
    messages = [Sent(some_points(3000, k), nanoseconds=k + 1) for k in range(30)]
    bag = write_bag(tmp_path / "flight", messages, kind)
    storage = storage_of(bag)
    content = storage.read_bytes()
    storage.write_bytes(content[: int(share * len(content))])

    try:
        source = open_source(bag)
        clouds = list(source.clouds())
    except InputError as error:
        assert str(bag) in str(error)  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert len(clouds) == 30 or source.losses


def test_an_unindexed_bag_is_read_and_said_to_be_cut(shared_data: Path) -> None:
    source = open_source(shared_data / "hard/ros1_unindexed.bag")

    assert all(len(cloud.points) for cloud in source.clouds())
    assert any("index" in loss for loss in source.losses)


@pytest.mark.parametrize("broken", [b"", b"\x00\x01\x00\x00", None])
def test_a_message_that_cannot_be_decoded_is_a_loss_among_others(
    tmp_path: Path, messages: list[Sent], broken: bytes | None
) -> None:
    bag = write_bag(tmp_path / "flight", messages, "ros2")
    with sqlite3.connect(storage_of(bag)) as database:
        (whole,) = database.execute("SELECT data FROM messages WHERE id = 2").fetchone()
        shorter = whole[:-40] if broken is None else broken
        database.execute("UPDATE messages SET data = ? WHERE id = 2", (shorter,))
    database.close()
    source = open_source(bag)

    clouds = list(source.clouds())

    assert points_of(clouds) == [messages[k].points.tolist() for k in (0, 2, 3)]
    (loss,) = source.losses
    assert "/cloud: 1 of 4 messages cannot be read" in loss
    assert list(source.clouds())
    assert len(source.losses) == 1


def test_a_cloud_that_contradicts_itself_is_a_loss_with_its_stamp(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight", messages, "ros2")
    with sqlite3.connect(storage_of(bag)) as database:
        (whole,) = database.execute("SELECT data FROM messages WHERE id = 3").fetchone()
        seven = (7).to_bytes(4, "little")
        assert whole.count(seven) > 0
        header = whole[:24] + whole[24:32].replace(seven, b"\x09\0\0\0")
        database.execute("UPDATE messages SET data = ? WHERE id = 3", (header + whole[32:],))
    database.close()
    source = open_source(bag)

    assert len(list(source.clouds())) == 3
    (loss,) = source.losses
    assert "at 1600000000.123456" in loss
    assert "bytes of data, expected" in loss


def test_messages_that_the_metadata_declare_and_the_bag_lacks_are_a_loss(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight", messages, "ros2")
    with sqlite3.connect(storage_of(bag)) as database:
        database.execute("DELETE FROM messages WHERE id > 1")
    database.close()
    source = open_source(bag)

    assert len(list(source.clouds())) == 1
    assert ["lost: 3 messages" in loss for loss in source.losses] == [True]


def test_a_damaged_chunk_is_a_loss(tmp_path: Path) -> None:
    messages = [Sent(some_points(30_000, k), nanoseconds=k + 1) for k in range(4)]
    bag = write_bag(tmp_path / "flight.bag", messages)
    content = bytearray(bag.read_bytes())
    third = content.index(messages[2].points.tobytes()[:8])
    record = content.rindex(b"time=", 0, third)
    content[record : record + 5] = b"emit="
    bag.write_bytes(content)
    source = open_source(bag)

    clouds = list(source.clouds())

    assert points_of(clouds[:2]) == [m.points.tolist() for m in messages[:2]]
    assert len(clouds) < 4
    assert source.losses
