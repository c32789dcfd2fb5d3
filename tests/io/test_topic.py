"""Bags, written by rosbags' writers or recorded by others, and read back.

How these tests could be cheated: by going by file names, by taking the log's clock for the
header's, by reading a bag whole, by skipping in silence what cannot be read, or by a list of
topics that only this file's bags have. So bags are renamed, cut and overwritten, clouds are
counted against what was sent, and the two clocks of every written message differ.
"""

from __future__ import annotations

import itertools
import shutil
import sqlite3
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.io.base import Cloud, Reading
from mlscli.io.container import Message
from mlscli.io.decoding import Deserializer
from mlscli.io.formats import open_source
from mlscli.io.text import TextCloud
from mlscli.io.topic import TopicSource
from tests.bags import Sent, write_bag

KINDS = ["ros1", "ros2", "mcap"]
POINT_CLOUD = "sensor_msgs/msg/PointCloud"


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
@pytest.mark.parametrize("dtype", ["<f4", "<f8", ">f8"])
def test_clouds_come_back_with_the_stamps_of_their_headers(
    tmp_path: Path, messages: list[Sent], kind: str, dtype: str
) -> None:
    source = open_source(write_bag(tmp_path / "flight.bag", messages, kind, dtype=dtype))

    clouds = list(source.clouds())

    assert points_of(clouds) == [message.points.tolist() for message in messages]
    assert [cloud.stamp for cloud in clouds] == [m.nanoseconds / 10**9 for m in messages]
    assert source.expected_keyframes == 4
    assert source.time_span() == (5000 / 10**9, 5003 / 10**9)
    assert not source.losses


@pytest.mark.parametrize("kind", KINDS)
def test_point_clouds_of_the_first_generation_come_back(
    tmp_path: Path, messages: list[Sent], kind: str
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages, kind, message_type=POINT_CLOUD)

    assert points_of(list(open_source(bag).clouds())) == [m.points.tolist() for m in messages]


@pytest.mark.parametrize("message_type", [POINT_CLOUD, "sensor_msgs/msg/PointCloud2"])
def test_a_message_of_several_keyframes_is_split(tmp_path: Path, message_type: str) -> None:
    points = some_points(5)
    message = Sent(points, labels=[4, 2, 4, 4, 2])
    source = open_source(
        write_bag(tmp_path / "a.bag", [message], message_type=message_type, label_name="kf_id")
    )

    assert points_of(list(source.clouds())) == [points[[0, 2, 3]].tolist(), points[[1, 4]].tolist()]
    assert source.expected_keyframes is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["cloud.txt", "cloud", "what?is#this%20.ply", "a.bag", "a.mcap"])
def test_a_bag_of_any_name_is_a_bag(
    tmp_path: Path, messages: list[Sent], kind: str, name: str
) -> None:
    storage = storage_of(write_bag(tmp_path / "flight", messages, kind))
    (tmp_path / "lone").mkdir()
    lone = tmp_path / "lone" / name
    shutil.copy(storage, lone)

    assert len(list(open_source(lone).clouds())) == 4


def test_a_text_named_like_a_bag_is_a_text(tmp_path: Path) -> None:
    (tmp_path / "cloud.bag").write_text("1 2 3\n")

    assert isinstance(open_source(tmp_path / "cloud.bag"), TextCloud)


def test_reading_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))

    clouds = open_source(bag).clouds()
    next(clouds)
    clouds.close()  # type: ignore[attr-defined]
    list(open_source(bag).clouds())

    assert list(scratch.iterdir()) == []


def test_messages_outside_the_time_are_not_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, messages: list[Sent]
) -> None:
    source = open_source(write_bag(tmp_path / "flight.bag", messages))
    stamps = [message.nanoseconds / 10**9 for message in messages]
    decoded: list[object] = []
    read = Deserializer.read

    def noting_read(self: Deserializer, message: Message) -> Any:
        decoded.append(message)
        return read(self, message)

    monkeypatch.setattr(Deserializer, "read", noting_read)

    asked = itertools.count()
    clouds = list(source.clouds(lambda _: next(asked) == 2))

    assert [cloud.stamp for cloud in clouds] == [stamps[2]]
    assert len(decoded) == 1
    assert next(asked) == 4


# Topics


def test_with_several_cloud_topics_the_error_lists_them(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages, topics=["/left", "/right"])

    with pytest.raises(UsageError, match="--topic") as error:
        list(open_source(bag).clouds())
    for words in ("/left", "/right", "PointCloud2 x 4"):
        assert words in str(error.value)
    assert len(list(open_source(bag, Reading(topic="/right")).clouds())) == 4
    assert len(list(open_source(bag, Reading(topic="right")).clouds())) == 4


def test_a_topic_that_is_not_there_lists_those_that_are(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages)

    with pytest.raises(UsageError, match="--topic /cluod: no such topic, found /cloud"):
        list(open_source(bag, Reading(topic="/cluod")).clouds())


@pytest.mark.parametrize("name", ["ros1_tf_example.bag", "ros2_tf_example"])
def test_a_bag_without_clouds_says_what_it_holds_and_what_can_be_mapped(
    shared_data: Path, name: str
) -> None:
    source = open_source(shared_data / "bags" / name)

    with pytest.raises(InputError, match="holds no clouds") as error:
        list(source.clouds())
    for words in ("/tf (tf2_msgs/msg/TFMessage x 517)", "can be mapped: sensor_msgs"):
        assert words in str(error.value)
    assert {(topic.name, topic.count, topic.mappable) for topic in source.topics()} == {
        ("/tf", 517, False),
        ("/tf_static", 1, False),
    }
    with pytest.raises(UsageError, match="--topic /tf: tf2_msgs/msg/TFMessage cannot be mapped"):
        list(open_source(shared_data / "bags" / name, Reading(topic="/tf")).clouds())


def test_a_recorded_bag_is_described_and_read(shared_data: Path) -> None:
    name = "/luminar_pointcloud"
    source = open_source(shared_data / "bags/ros1_luminar_pc2_lz4.bag", Reading(topic=name))

    (topic,) = [topic for topic in source.topics() if topic.name == name]
    clouds = list(source.clouds())

    assert (topic.mappable, topic.count, topic.frame) == (True, 5, "luminar_lidar")
    assert len(clouds) == 5
    assert all(cloud.frame_id == "luminar_lidar" for cloud in clouds)
    assert all(35_000 < len(cloud.points) < 37_000 for cloud in clouds)
    assert all(np.abs(cloud.points).max() < 1000 for cloud in clouds)


def test_a_bag_of_early_ros_2_needs_no_definitions(tmp_path: Path, messages: list[Sent]) -> None:
    bag = write_bag(tmp_path / "flight", messages, "ros2")
    storage = storage_of(bag)
    with sqlite3.connect(storage) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()

    assert isinstance(open_source(storage), TopicSource)
    assert len(list(open_source(storage).clouds())) == 4
