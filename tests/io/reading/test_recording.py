"""Recordings: sources told by content, turned, cut and counted.

How these tests could be cheated: by formats told by their endings, by turns that are right for
one axis, by counts that add up only when one reason occurs, or by a second pass that remembers
the first. So wrong names are everywhere, turns are checked against the rule written out as
functions, every reason occurs in one recording, and passes are repeated.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, MlsError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.keyframes.keyframe import Keyframe
from tests.helpers.bags import Sent, write_bag
from tests.helpers.craft import (
    FIRST,
    POINTS,
    SECOND_POSE,
    assert_near,
    between,
    cloud,
    clouds_of,
    moved,
    moving,
    opened,
)
from tests.helpers.keyframes import xs
from tests.helpers.texts import text

ROOT = Path(__file__).resolve().parents[3]


def test_the_tello_flight_is_the_same_from_text_and_from_every_kind_of_bag(
    tmp_path: Path, shared_data: Path
) -> None:
    path = shared_data / "sparse/tello_kf_pointData.csv"
    columns = "x,y,z,-,-,-,-,keyframe,cx,cy,cz"
    original = list(open_recording(path, columns=columns).keyframes())
    messages = [Sent(k.points, nanoseconds=n * 10**8) for n, k in enumerate(original)]
    for kind in ("ros1", "ros2", "mcap"):
        recording = open_recording(write_bag(tmp_path / kind, messages, kind))
        keyframes = list(recording.keyframes())

        assert recording.expected_keyframes == len(keyframes) == 102
        assert recording.tally.points_read == 13_859
        for ours, theirs in zip(keyframes, original, strict=True):
            assert ours.points.tobytes() == theirs.points.tobytes()
        assert [k.stamp for k in keyframes] == [n / 10 for n in range(102)]


# Frames


@pytest.mark.parametrize("frame", ["map", "/odom", "world", "uav1/local_origin"])
def test_clouds_in_a_world_frame_are_taken_as_they_are(tmp_path: Path, frame: str) -> None:
    recording = open_recording(
        write_bag(tmp_path / "a.bag", [Sent(np.ones((1, 3)), frame_id=frame)])
    )

    assert xs(recording) == [1]
    assert recording.frame_id == frame.lstrip("/")
    assert ["taken as they are" in note for note in recording.notes] == [True]


def test_clouds_that_state_no_frame_are_taken_as_they_are(tmp_path: Path) -> None:
    recording = open_recording(write_bag(tmp_path / "a.bag", [Sent(np.ones((1, 3)), frame_id="")]))

    assert xs(recording) == [1]
    assert recording.frame_id == "map"


def test_a_keyframe_tells_whether_lasers_measured_it(tmp_path: Path) -> None:
    sent = [Sent(np.ones((2, 3)), labels=[0, 1])]
    for name in ("ring", "intensity"):
        bag = write_bag(tmp_path / f"{name}.bag", sent, label_name=name)
        assert [each.is_ranged for each in open_recording(bag)] == [name == "ring"]


def test_clouds_of_a_sensor_need_their_frame_declared(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", [Sent(np.ones((1, 3)), frame_id="lidar")])

    with pytest.raises(InputError, match=r"/cloud: .*'lidar'.* world frame .*`frame` lidar"):
        open_recording(bag)
    assert open_recording(bag, frame="/lidar").frame_id == "lidar"
    assert xs(open_recording(bag, frame="lidar")) == [1]
    with pytest.raises(InputError, match="'lidar', expected the map frame 'map'"):
        xs(open_recording(bag, frame="map"))


def test_clouds_in_a_frame_that_nothing_leads_from_are_left_out_and_counted(
    tmp_path: Path,
) -> None:
    frames = ["map", "odom", "", "map"]
    clouds = [Sent(np.full((2, 3), x), frame_id=frame) for x, frame in enumerate(frames)]
    recording = open_recording(write_bag(tmp_path / "a.bag", clouds))

    assert xs(recording) == [0, 0, 3, 3]
    assert recording.tally.dropped == {
        "no transform from their frame": 2,
        "in no frame, unlike others": 2,
    }
    notes = [note for note in recording.notes if "1 of 4 keyframes is left out" in note]
    assert len(notes) == 2


@pytest.mark.parametrize(("unset", "told"), [(3, True), (1, False), (9, False)])
def test_clouds_before_a_clock_is_set_are_told(tmp_path: Path, unset: int, told: bool) -> None:
    times = [0] * unset + [50_000_000_000 + k for k in range(9 - unset)]
    clouds = [Sent(np.ones((2, 3)), nanoseconds=time) for time in times]
    recording = open_recording(write_bag(tmp_path / "a.bag", clouds))

    assert len(clouds_of(recording)) == 9
    assert any("3 of 9 keyframes have the time 0" in note for note in recording.notes) == told


# Turning, dropping, counting

TURNS: dict[str, Callable[[float, float, float], tuple[float, float, float]]] = {
    "z": lambda x, y, z: (x, y, z),
    "-z": lambda x, y, z: (x, -y, -z),
    "y": lambda x, y, z: (x, -z, y),
    "-y": lambda x, y, z: (x, z, -y),
    "x": lambda x, y, z: (-z, y, x),
    "-x": lambda x, y, z: (z, y, -x),
}


@pytest.mark.parametrize("up", TURNS)
def test_points_and_route_are_turned_so_that_up_is_z(tmp_path: Path, up: str) -> None:
    path = text(tmp_path, "1 2 3 4 5 6\n")
    (keyframe,) = open_recording(path, columns="x,y,z,cx,cy,cz", up=up).keyframes()

    assert keyframe.points.tolist() == [list(TURNS[up](1, 2, 3))]
    assert keyframe.position == TURNS[up](4, 5, 6)


@pytest.mark.parametrize("up", TURNS)
def test_no_coordinate_is_a_negative_zero(tmp_path: Path, up: str) -> None:
    path = text(tmp_path, "0 -0.0 0 -0.0 0 -0.0\n-0.0 0 -0.0 0 0 0\n")
    (keyframe,) = open_recording(path, columns="x,y,z,cx,cy,cz", up=up).keyframes()

    assert not np.signbit(keyframe.points).any()
    assert not np.signbit(keyframe.position).any()


def test_a_keyframe_is_a_contiguous_array_whatever_the_turn(tmp_path: Path) -> None:
    (keyframe,) = open_recording(text(tmp_path, "1 2 3\n4 5 6\n"), up="-y").keyframes()

    assert keyframe.points.flags.c_contiguous
    assert keyframe.points.dtype == np.float64


def test_points_are_dropped_and_counted_by_the_first_reason(tmp_path: Path) -> None:
    path = text(
        tmp_path,
        "1 1 1 0\nnan 0 0 0\ninf 1e9 0 0\n1e8 0 0 0\n-1.00000001e8 0 0 0\n0 0 1e33 1\n"
        "5 0 0 1\n1 1 1 1\n5 0 0 1\n2 2 2 2\n2 2 2 2\n",
    )
    recording = open_recording(path, crop=(-9, 4, -9, 9, -9, 9), cumulative=True)

    for _ in range(2):
        clouds = [keyframe.points.tolist() for keyframe in recording.keyframes()]
        assert clouds == [[[1, 1, 1]], [], [[2, 2, 2]]]
        assert recording.tally.points_read == 11
        assert recording.tally.keyframes == 3
        assert recording.tally.dropped == {
            "not finite": 2,
            "beyond 1e8": 2,
            "outside the crop": 3,
            "repeated": 2,
        }


@pytest.mark.parametrize(("garbage", "is_doubted"), [(5, False), (6, True)])
def test_where_most_points_are_no_coordinates_the_others_are_doubted(
    tmp_path: Path, garbage: int, is_doubted: bool
) -> None:
    path = text(tmp_path, "-1.7e9 -213.5 1e-11\n" * garbage + "1 2 3\n" * (10 - garbage))
    recording = open_recording(path)
    assert sum(len(keyframe.points) for keyframe in recording.keyframes()) == 10 - garbage
    doubt = "6 of 10 points are dropped, as they lie beyond 1e8"
    assert any(note.startswith(doubt) for note in recording.notes) == is_doubted


def test_the_crop_is_inclusive_and_of_the_turned_points(tmp_path: Path) -> None:
    path = text(tmp_path, "1 -3 2\n1 -3.5 2\n")
    (keyframe,) = open_recording(path, up="-y", crop=(1, 1, 2, 2, 3, 3)).keyframes()

    assert keyframe.points.tolist() == [[1, 2, 3]]


def test_repeated_points_are_known_across_sources(tmp_path: Path) -> None:
    one = text(tmp_path, "1 0 0\n2 0 0\n1 0 0\n", "one.txt")
    two = text(tmp_path, "2 0 0\n3 0 0\n0.0 0 0\n-0.0 0 0\n", "two.txt")

    assert xs(open_recording(one, two, cumulative=True)) == [1, 2, 3, 0]
    assert xs(open_recording(one, two)) == [1, 2, 1, 2, 3, 0, 0]


def test_points_are_repeated_as_recorded_however_they_are_moved(tmp_path: Path) -> None:
    # The map frame of the SLAM system drifts below the map of the recording.
    more = np.r_[POINTS, [[7.0, 8.0, 9.0]]]
    again = [cloud(1, "slam", more), cloud(4, "slam", more)]
    messages = [*moving("map", "slam"), cloud(0, "slam"), *again]
    recording = opened(tmp_path, messages, cumulative=True)
    clouds = clouds_of(recording)
    assert [len(points) for points in clouds] == [3, 1, 0]
    assert recording.tally.dropped == {"repeated": 7}
    assert_near(clouds[1], moved(between(FIRST, SECOND_POSE, 0.25), points=more[3:]))
    assert not any("nothing was dropped" in note for note in recording.notes)


def test_a_point_is_repeated_only_where_it_was_taken(tmp_path: Path) -> None:
    # It lies outside the crop at first.
    messages = [*moving("map", "slam"), cloud(0, "slam"), cloud(4, "slam"), cloud(4, "slam")]
    whole = np.concatenate(clouds_of(opened(tmp_path, messages)))[3:6]
    low, high = whole.min(axis=0) - 0.1, whole.max(axis=0) + 0.1
    crop = [float(bound) for pair in zip(low, high, strict=True) for bound in pair]
    recording = open_recording(tmp_path / "flight", cumulative=True, crop=crop)
    assert [len(points) for points in clouds_of(recording)] == [0, 3, 0]
    assert recording.tally.dropped == {"outside the crop": 3, "repeated": 3}


def test_it_is_said_where_no_point_is_repeated(tmp_path: Path) -> None:
    path = text(tmp_path, "1 0 0 0\n2 0 0 0\n1 0 0.001 1\n")
    recording = open_recording(path, cumulative=True)
    for _ in range(2):
        assert xs(recording) == [1, 2, 1]
        assert recording.notes[-1] == (
            "`cumulative`: nothing was dropped, as no point came again unchanged"
        )
    recording = open_recording(path, path, cumulative=True)
    assert xs(recording) == [1, 2, 1]
    assert not any("cumulative" in note for note in recording.notes)


# Several sources, wrong options, and nothing left


def test_several_sources_are_one_flight_in_the_order_given(tmp_path: Path) -> None:
    two = text(tmp_path, "2 0 0\n", "two.txt")
    one = text(tmp_path, "1 0 0\n", "one.txt")
    recording = open_recording(two, str(one))

    assert xs(recording) == [2, 1]
    assert recording.sources == [str(two), str(one)]


def test_options_that_fit_no_source_are_wrong_usage(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="`topic` /cloud: no source is a bag"):
        open_recording(text(tmp_path, "1 2 3\n"), topic="/cloud")
    bag = write_bag(tmp_path / "a.bag", [Sent(np.ones((1, 3)))])
    with pytest.raises(UsageError, match="`columns` x,y,z: no source is a text cloud"):
        open_recording(bag, columns="x,y,z")
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    with pytest.raises(UsageError, match="`columns` x,y,z: no source is a text cloud"):
        open_recording(tmp_path / "a.ply", columns="x,y,z")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"crop": (50, 60, 0, 0, 0, 0)}, "all 6 were dropped, 6 outside the crop"),
        ({"start": 99.0}, "holds no keyframes between `start` and `end`"),
    ],
)
def test_a_pass_that_yields_nothing_ends_in_an_error_that_says_why(
    timed: Path, options: dict[str, Any], words: str
) -> None:
    keyframes: list[Keyframe] = []
    with pytest.raises(InputError, match=words):
        keyframes.extend(open_recording(timed, **options).keyframes())
    assert sum(len(keyframe.points) for keyframe in keyframes) == 0


def test_losses_of_all_sources_are_those_of_the_last_pass(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "flight", [Sent(np.ones((2, 3)), nanoseconds=1)] * 3, "ros2")
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 3", "message_count: 5"))
    recording = open_recording(bag, text(tmp_path, "1 2 3\n"))

    for _ in range(2):
        assert len(list(recording.keyframes())) == 4
        assert ["declares 5 messages, the files hold 3" in loss for loss in recording.losses] == [
            True
        ]


def test_errors_of_reading_are_errors_of_the_program(tmp_path: Path) -> None:
    for content in ("1 2\n", "a b c\n1 2 3\n", "1 2 x\n"):
        with pytest.raises(MlsError):
            xs(open_recording(text(tmp_path, content)))


def test_text_is_read_without_the_libraries_for_bags_and_kernels(tmp_path: Path) -> None:
    path = text(tmp_path, "1 2 3\n")
    program = (
        "import sys; from mlscli.io.reading.recording import open_recording; "
        f"assert len(list(open_recording({str(path)!r}).keyframes())) == 1; "
        "print([name for name in ('rosbags', 'numba', 'scipy', 'mcap') if name in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT
    )

    assert run.stdout.strip() == "[]"


def test_points_that_pile_up_at_zero_are_dropped_in_every_frame_and_elsewhere_told(
    tmp_path: Path,
) -> None:
    scene = np.random.default_rng(4).uniform(1, 5, (60, 3))
    zeros = np.concatenate((scene, np.zeros((20, 3))))
    bag = write_bag(tmp_path / "flight.bag", [Sent(zeros), Sent(scene)])
    cloud_path = text(tmp_path, "".join(f"{x} {y} {z}\n" for x, y, z in zeros.tolist()))
    for recording in (open_recording(bag), open_recording(cloud_path)):
        assert all(np.array_equal(cloud, scene) for cloud in clouds_of(recording))
        assert recording.tally.dropped == {"no return": 20}
        assert any("20 points pile up at exactly (0, 0, 0)" in note for note in recording.notes)
    # As moved by a node, with the others.
    bag = write_bag(tmp_path / "moved.bag", [Sent(scene), Sent(zeros + 1)])
    recording = open_recording(bag)
    assert [len(cloud) for cloud in clouds_of(recording)] == [60, 80]
    (note,) = [note for note in recording.notes if "pile up" in note]
    assert "at (1, 1, 1) exactly, 20 of the 80 of keyframe 1" in note
