"""Bags: read back by the program and by the libraries themselves, and never left half written.

Ways to pass without being right: only the program's own reader looks; transforms that are all
the identity; a folder of the user's that is taken for a bag and removed.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import mlscli
from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.bag_messages import BagWriter, Kind
from mlscli.io.writing.flight_bag import refuse_existing_bag, write_bag
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.presets import make

NAMES: dict[Kind, str] = {"ros1": "a.bag", "ros2": "a", "mcap": "a.mcap"}
KINDS = pytest.mark.parametrize("kind", list(NAMES))


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(make("house"), 0.2, seed=4)


def written(folder: Path, flight: Flight, kind: Kind, **options: bool) -> Path:
    path = folder / NAMES[kind]
    write_bag(path, flight.keyframes, flight.attitudes, kind, **options)
    return path


def messages(path: Path) -> list[tuple[str, int, Any]]:
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        return [
            (connection.topic, time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
        ]


def xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def xyzw(quaternion: Any) -> list[float]:
    return [*xyz(quaternion), quaternion.w]


@KINDS
def test_a_bag_reads_back_bit_for_bit(tmp_path: Path, flight: Flight, kind: Kind) -> None:
    recording = mlscli.open_recording(written(tmp_path, flight, kind))
    assert recording.frame_id == "map"
    found = list(recording.keyframes())
    assert len(found) == len(flight.keyframes) > 20
    for one, other in zip(found, flight.keyframes, strict=True):
        assert one.points.tobytes() == other.points.tobytes()
        assert one.stamp == other.stamp
    assert recording.losses == []


@KINDS
def test_odometry_and_transforms_say_where_the_craft_was(
    tmp_path: Path, flight: Flight, kind: Kind
) -> None:
    content = messages(written(tmp_path, flight, kind))
    count = len(flight.keyframes)
    topics = Counter(topic for topic, _, _ in content)
    assert topics == {"/cloud": count, "/odom": count, "/tf": count, "/tf_static": 1}
    odometry = [message for topic, _, message in content if topic == "/odom"]
    transforms = [message.transforms[0] for topic, _, message in content if topic == "/tf"]
    for keyframe, attitude, odom, tf in zip(
        flight.keyframes, flight.attitudes.tolist(), odometry, transforms, strict=True
    ):
        assert xyz(odom.pose.pose.position) == xyz(tf.transform.translation) == [*keyframe.position]
        assert xyzw(odom.pose.pose.orientation) == xyzw(tf.transform.rotation) == attitude
        assert (odom.header.frame_id, odom.child_frame_id) == ("map", "base_link")
        assert (tf.header.frame_id, tf.child_frame_id) == ("map", "base_link")
        for header in (odom.header, tf.header):
            assert header.stamp.sec + header.stamp.nanosec * 1e-9 == keyframe.stamp


@KINDS
def test_messages_are_logged_at_their_own_times(tmp_path: Path, flight: Flight, kind: Kind) -> None:
    for topic, time, message in messages(written(tmp_path, flight, kind)):
        header = message.transforms[0].header if topic.startswith("/tf") else message.header
        assert time == header.stamp.sec * 10**9 + header.stamp.nanosec


def in_map(path: Path) -> list[Float64]:
    """Move the clouds into the map by what the bag itself says."""
    content = messages(path)
    (static,) = (message.transforms[0] for topic, _, message in content if topic == "/tf_static")
    assert (static.header.frame_id, static.child_frame_id) == ("base_link", "camera")
    poses = {
        time: message.transforms[0].transform for topic, time, message in content if topic == "/tf"
    }
    clouds = []
    for topic, time, message in content:
        if topic != "/cloud":
            continue
        assert message.header.frame_id == "camera"
        points = message.data.view("<f8").reshape(-1, 3).copy()
        # A camera looks along its z axis; it sees 60 degrees to each side.
        assert (points[:, 2] > 0.4 * np.linalg.norm(points, axis=1)).all()
        for transform in (static.transform, poses[time]):
            turned = Rotation.from_quat(xyzw(transform.rotation)).apply(points)
            points = turned + xyz(transform.translation)
        clouds.append(points)
    return clouds


@KINDS
def test_clouds_in_the_sensor_frame_are_moved_back_by_the_transforms(
    tmp_path: Path, kind: Kind
) -> None:
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.surfaces import Scatter

    exact = Noise(sigma=Scatter(0, 0), salt_pepper=0)
    flight = fly(make("bridge"), 0.2, exact)
    found = in_map(written(tmp_path, flight, kind, sensor_frame=True))
    for points, keyframe in zip(found, flight.keyframes, strict=True):
        assert np.abs(points - keyframe.points).max() < 1e-12


def test_mcap_is_one_file_with_four_channels(tmp_path: Path, flight: Flight) -> None:
    path = written(tmp_path, flight, "mcap")
    assert path.is_file()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert topics == {"/cloud", "/odom", "/tf", "/tf_static"}


def test_a_ros2_folder_names_its_own_file(tmp_path: Path, flight: Flight) -> None:
    path = written(tmp_path, flight, "ros2")
    assert {file.name for file in path.iterdir()} == {"metadata.yaml", "a.db3"}
    assert "a.db3" in (path / "metadata.yaml").read_text()


@KINDS
def test_times_keep_their_nanoseconds(tmp_path: Path, kind: Kind) -> None:
    stamps = [1_700_000_000.123456, 1_700_000_000.987654, 1_700_000_001.0]
    keyframes = [Keyframe(np.ones((2, 3)), stamp, (0.0, 0.0, 1.0)) for stamp in stamps]
    path = tmp_path / NAMES[kind]
    write_bag(path, keyframes, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)), kind)
    assert [k.stamp for k in mlscli.open_recording(path).keyframes()] == stamps


@KINDS
def test_what_exists_is_replaced_only_on_request(
    tmp_path: Path, flight: Flight, kind: Kind
) -> None:
    path = written(tmp_path, flight, kind)
    with pytest.raises(OutputError, match="exists already"):
        written(tmp_path, flight, kind)
    shorter = Flight(flight.scene, flight.keyframes[:3], flight.attitudes[:3])
    written(tmp_path, shorter, kind, overwrite=True)
    assert len(list(mlscli.open_recording(path).keyframes())) == 3
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@KINDS
def test_a_failure_leaves_what_was_there_and_nothing_else(
    tmp_path: Path, flight: Flight, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(BagWriter, "cloud", full)
        with pytest.raises(OutputError, match=r"a(\..+)?: cannot be written: No space left"):
            written(tmp_path, flight, kind)
    assert list(tmp_path.iterdir()) == []
    path = written(tmp_path, flight, kind)
    with monkeypatch.context() as patched:
        patched.setattr(BagWriter, "cloud", full)
        with pytest.raises(OutputError):
            written(tmp_path, flight, kind, overwrite=True)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert len(list(mlscli.open_recording(path).keyframes())) == len(flight.keyframes)


def test_a_bag_whose_rename_fails_gives_the_old_one_back(
    tmp_path: Path, flight: Flight, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path, flight, "ros2")

    def fails(*_: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(OutputError, match="cannot be written: Input/output error"):
        written(tmp_path, flight, "ros2", overwrite=True)
    monkeypatch.undo()
    assert len(list(mlscli.open_recording(path).keyframes())) == len(flight.keyframes)


def test_a_folder_that_is_no_bag_is_never_replaced(tmp_path: Path, flight: Flight) -> None:
    folder = tmp_path / "a"
    folder.mkdir()
    (folder / "thesis.tex").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(OutputError):
            written(tmp_path, flight, "ros2", overwrite=overwrite)
    assert (folder / "thesis.tex").read_text() == "mine"
    with pytest.raises(OutputError, match="is a folder"):
        refuse_existing_bag(folder, "ros1", overwrite=True)
    (tmp_path / "b").write_text("mine")
    with pytest.raises(OutputError, match="a ROS 2 bag is a folder"):
        refuse_existing_bag(tmp_path / "b", "ros2", overwrite=True)
    with pytest.raises(OutputError, match="does not exist"):
        refuse_existing_bag(tmp_path / "c" / "d", "ros2", overwrite=True)


@KINDS
def test_a_keyframe_without_time_or_place_is_refused_by_its_number(
    tmp_path: Path, kind: Kind
) -> None:
    known = Keyframe(np.ones((1, 3)), 1.0, (0.0, 0.0, 0.0))
    for unknown in (Keyframe(np.ones((1, 3))), Keyframe(np.ones((1, 3)), 2.0)):
        with pytest.raises(UsageError, match="keyframe 1 has the time"):
            write_bag(tmp_path / NAMES[kind], [known, unknown], np.zeros((2, 4)), kind)
    assert list(tmp_path.iterdir()) == []
