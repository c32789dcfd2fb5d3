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
from mlscli.io.clouds.text import TextCloud
from mlscli.io.containers.container import Message
from mlscli.io.containers.opening import open_container
from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.topic import TopicSource
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from mlscli.io.source import Cloud, Reading
from tests.helpers.bags import Sent, Told, write_bag, write_told

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
    clouds = list(source.clouds(lambda _stamp, _logged=0.0: next(asked) == 2))

    assert [cloud.stamp for cloud in clouds] == [stamps[2]]
    assert len(decoded) == 1
    assert next(asked) == 4


# Topics


def test_with_several_cloud_topics_the_error_lists_them(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages, topics=["/left", "/right"])

    with pytest.raises(UsageError, match="`topic`") as error:
        list(open_source(bag).clouds())
    for words in ("/left", "/right", "PointCloud2 x 4"):
        assert words in str(error.value)
    assert len(list(open_source(bag, Reading(topic="/right")).clouds())) == 4
    assert len(list(open_source(bag, Reading(topic="right")).clouds())) == 4


@pytest.mark.parametrize("topic", [None, "/cloud"])
def test_of_two_types_on_one_topic_that_with_most_messages_is_taken(
    tmp_path: Path, topic: str | None
) -> None:
    points = [dict(zip("xyz", (k, 0.0, 0.0), strict=True)) for k in range(3)]
    few = Told("/cloud", POINT_CLOUD, {"points": points[:1]})
    many = Told("/cloud", "geometry_msgs/msg/PoseArray", {"poses": [{"position": points[2]}]})
    source = open_source(write_told(tmp_path / "a.bag", [few, many, many]), Reading(topic=topic))

    assert points_of(list(source.clouds())) == [[[2.0, 0.0, 0.0]]] * 2
    (note,) = source.notes
    assert note.endswith(
        "/cloud holds messages of other types, not taken: sensor_msgs/msg/PointCloud x 1"
    )


def test_a_topic_that_is_not_there_lists_those_that_are(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = write_bag(tmp_path / "flight.bag", messages)

    with pytest.raises(UsageError, match="`topic` /cluod: no such topic, found /cloud"):
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
    with pytest.raises(UsageError, match="`topic` /tf: tf2_msgs/msg/TFMessage cannot be mapped"):
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


# Messages that cannot be read


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


def test_a_damaged_chunk_of_transforms_is_told_though_no_cloud_is_lost(tmp_path: Path) -> None:
    told = [
        Told("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [hanging("map", "base_link", k)]}, k)
        for k in range(4000)
    ]
    clouds = {"header": {"frame_id": "map"}, "points": [{"x": 1.0}]}
    told += [Told("/cloud", POINT_CLOUD, clouds, 10_000)]
    bag = write_told(tmp_path / "a.bag", told)
    content = bytearray(bag.read_bytes())
    record = content.index(b"op=\x02", 100_000)
    content[record : record + 3] = b"xx="
    bag.write_bytes(content)

    recording = open_recording(bag)

    assert len(list(recording.keyframes())) == 1
    assert ["damaged" in loss for loss in recording.losses] == [True]


def test_transforms_that_cannot_be_read_are_told(tmp_path: Path) -> None:
    clouds = {"header": {"frame_id": "map"}, "points": [{"x": 1.0}]}
    transforms = [
        Told("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [hanging("map", "base", k)]}, k)
        for k in range(3)
    ]
    bag = write_told(tmp_path / "flight", [*transforms, Told("/c", POINT_CLOUD, clouds)], "ros2")
    with sqlite3.connect(storage_of(bag)) as database:
        database.execute("UPDATE messages SET data = substr(data, 1, 40) WHERE timestamp = 1")
    database.close()

    recording = open_recording(bag)

    assert len(list(recording.keyframes())) == 1
    assert ["/tf: 1 message cannot be read" in loss for loss in recording.losses] == [True]


def test_poses_that_tell_nothing_are_told(tmp_path: Path) -> None:
    clouds = {"header": {"frame_id": "map"}, "points": [{"x": 1.0}]}
    good, bad = hanging("map", "base", 1), hanging("map", "base", 2)
    bad["transform"] = {"rotation": {"w": 0.0}}
    transforms = [
        Told("/tf", "tf2_msgs/msg/TFMessage", {"transforms": told}, time)
        for time, told in enumerate(([good, bad], [bad], [good]))
    ]
    bag = write_told(tmp_path / "flight", [*transforms, Told("/c", POINT_CLOUD, clouds)], "ros2")

    recording = open_recording(bag)

    assert len(list(recording.keyframes())) == 1
    assert sum("/tf: 2 poses left out" in note for note in recording.notes) == 1
    assert recording.losses == []


def hanging(parent: str, child: str, nanoseconds: int) -> dict[str, Any]:
    """Return the content of a transform."""
    return {
        "header": {"stamp": {"sec": 1, "nanosec": nanoseconds}, "frame_id": parent},
        "child_frame_id": child,
        "transform": {"rotation": {"w": 1.0}},
    }


def test_where_a_cut_took_the_topic_the_error_says_that_the_bag_breaks_off(
    shared_data: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.bag"
    content = (shared_data / "bags/ros1_luminar_pc2_lz4.bag").read_bytes()
    cut.write_bytes(content[:400_000])

    with pytest.raises(UsageError, match=r"no such topic, found .*; .*breaks off in the chunk"):
        list(open_source(cut, Reading(topic="/luminar_pointcloud")).clouds())


def test_what_messages_contradict_themselves_in_is_told_once_with_how_often(
    tmp_path: Path, messages: list[Sent]
) -> None:
    wrong = [Sent(m.points, nanoseconds=m.nanoseconds, changes={"height": 0}) for m in messages[1:]]
    bag = write_bag(tmp_path / "flight.bag", [messages[0], *wrong])
    source = TopicSource(open_container(bag))

    assert not source.first_doubts
    assert points_of(list(source.clouds())) == [message.points.tolist() for message in messages]
    notes = [note for note in source.notes if "height is 0" in note]
    assert len(notes) == 1
    assert notes[0].startswith(f"{bag}: /cloud: in 3 of 4 messages, width or height is 0")
    again = TopicSource(open_container(write_bag(tmp_path / "wrong.bag", wrong)))
    assert "/cloud: in the first message, width or height is 0" in again.first_doubts[0]
    assert not again.notes
