"""What transforms said, when, in the order of their recording: resets, changes, gaps, robots.

How these tests could be cheated: by the last that was said of a time, by the first, or by refusing
what is doubtful. So the craft is elsewhere at the same stamps, each cloud must come out where it
was, and what is left out is counted under its own reason.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.io.reading.recording import Recording, open_recording
from tests.helpers.bags import Told, write_told
from tests.helpers.craft import (
    BEGIN,
    FIRST,
    MOUNT,
    POINTS,
    Pose,
    assert_near,
    at,
    cloud,
    clouds_of,
    matrix,
    moved,
    moving,
    odometry,
    opened,
    positions_of,
    recorded,
    run,
    seen,
    transform,
)


def xs(recording: Recording) -> list[float]:
    """Return how far along x each cloud has been moved."""
    return [round(float(points[0, 0] - POINTS[0, 0]), 6) for points in clouds_of(recording)]


def left_out(recording: Recording) -> dict[str, int]:
    return recording.tally.left_out


# Clocks that begin anew


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_after_a_reset_clouds_go_by_the_transforms_of_their_own_run(
    tmp_path: Path, kind: str
) -> None:
    told = [
        *run(0, 0), *seen(0, 2.5, 7), *run(20, 100), *seen(20, 2.5, 7), *run(40, 200), *seen(40, 7)
    ]  # fmt: skip
    recording = opened(tmp_path, told, kind)

    assert xs(recording) == [2.5, 7, 102.5, 107, 207]
    assert not left_out(recording)
    # Where the craft was goes by the same run.
    assert [position[0] for position in positions_of(recording)] == xs(recording)
    notes = " ".join(recording.notes)
    assert "clock of the transforms jumps back from" in notes
    assert "and 1 more" in notes


def test_a_run_lends_no_transforms_to_another(tmp_path: Path) -> None:
    # After the reset localisation takes 6 s to begin; before it, it ended early.
    told = [*run(0, 0, range(7)), *seen(0, 2, 9), *run(20, 100, range(6, 11)), *seen(20, 2, 9)]
    fast = [
        recorded(transform(k, "base_link", "lidar", at(0)), begin + k)
        for begin in (0, 20)
        for k in range(11)
    ]
    clouds = [message for message in told if message.topic == "/cloud"]
    told = [m for m in told if m not in clouds]
    framed = [*seen(0, 2, 9, frame="lidar"), *seen(20, 2, 9, frame="lidar")]
    recording = opened(tmp_path, [*told, *fast, *framed])

    assert xs(recording) == [2, 109]
    assert left_out(recording) == {"no transform at their time": 2}


def test_poses_of_a_topic_go_by_runs_too(tmp_path: Path) -> None:
    def poses(begin: float, shift: float) -> list[Told]:
        return [
            recorded(odometry(k, at(k + shift), "map"), begin + k)  # the same stamps
            for k in range(11)
        ]

    told = [*poses(0, 0), *seen(0, 2.5), *poses(20, 100), *seen(20, 2.5)]
    recording = opened(tmp_path, told, pose_topic="/odometry")

    assert xs(recording) == [2.5, 102.5]
    assert any("`pose_topic` /odometry: the clock jumps back" in note for note in recording.notes)


@pytest.mark.parametrize("by", ["transforms", "poses"])
def test_poses_whose_clock_is_another_than_that_of_the_clouds_are_told(
    tmp_path: Path, by: str
) -> None:
    if by == "poses":
        late = [recorded(odometry(k, at(k), "map"), k + 30) for k in range(51)]
        options: dict[str, Any] = {"pose_topic": "/odometry"}
    else:
        late, options = run(30, 0, range(51)), {}
    told = [*late, *seen(0, *range(31, 41))]
    recording = opened(tmp_path, told, **options)

    # By the headers each cloud is where the craft was half a minute later.
    assert xs(recording) == list(range(31, 41))
    (note,) = [note for note in recording.notes if "s before their recording" in note]
    assert "`time_source` log" in note
    by_log = open_recording(tmp_path / "flight", time_source="log", **options)
    assert xs(by_log) == pytest.approx([k + 0.01 for k in range(1, 11)], abs=1e-6)
    assert not any("their recording" in note for note in by_log.notes)


@pytest.mark.parametrize("rate", [1.02, 1.0])
def test_a_clock_of_clouds_that_runs_faster_than_that_of_the_poses_is_told(
    tmp_path: Path, rate: float
) -> None:
    clouds = [recorded(cloud(k * rate, "base_link"), k + 0.01) for k in range(100)]
    recording = opened(tmp_path, [*run(0, 0, range(105)), *clouds])

    assert len(xs(recording)) == 100
    told = [note for note in recording.notes if "of the clouds gain 1.7 s on those" in note]
    assert len(told) == (rate > 1)
    assert all("`time_source` log takes the times of recording" in note for note in told)


def test_start_and_end_are_seconds_of_the_recording_across_a_reset(tmp_path: Path) -> None:
    told = [*run(0, 0), *seen(0, 2, 7), *run(20, 100), *seen(20, 2, 7)]

    # The first cloud was recorded at 2 s, those after the reset at 22 and 27 s.
    assert xs(opened(tmp_path, told, end=20.5)) == [2, 7, 102]
    recording = open_recording(tmp_path / "flight", start=10)
    assert xs(recording) == [102, 107]
    assert any("the clock of the clouds jumps from" in note for note in recording.notes)
    assert xs(open_recording(tmp_path / "flight", start=20, end=20)) == [102]


def test_recordings_of_one_clock_are_each_moved_by_their_own_transforms(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    write_told(one, sorted([*run(0, 0), *seen(0, 2.5)], key=lambda told: told.log_time))
    write_told(two, sorted([*run(0, 100), *seen(0, 2.5)], key=lambda told: told.log_time))

    assert xs(open_recording(one, two)) == [2.5, 102.5]
    assert xs(open_recording(two, one)) == [102.5, 2.5]


def test_two_recordings_of_the_same_transforms_are_one(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    write_told(one, [*run(0, 0), *seen(0, 10.2)])
    write_told(two, sorted([*run(0, 0, range(5)), *seen(0, 7)], key=lambda told: told.log_time))
    recording = open_recording(two, one)

    assert xs(recording) == [7, 10]
    assert not any("several sources" in note for note in recording.notes)


# Static transforms


def static(seconds: float, pose: Pose, logged: float, parent: str = "base_link") -> Told:
    return recorded(transform(seconds, parent, "lidar", pose, stays=True), logged)


@pytest.mark.parametrize("stamp", [4.0, -1.0, -BEGIN, 1e9 - BEGIN])
def test_a_static_transform_counts_from_its_stamp_or_else_its_recording(
    tmp_path: Path, stamp: float
) -> None:
    # Stamps that no clock would have, or that come before the first, mean when it was recorded.
    told = [*run(0, 0), static(0, at(0.25), 0), static(stamp, at(0.5), 4.001)]
    recording = opened(tmp_path, [*told, *seen(0, 3, 3.9, 4.1, 7, frame="lidar")])

    assert xs(recording) == [3.25, 4.15, 4.6, 7.5]
    assert any("transform of 'lidar' changes at" in note for note in recording.notes)


def test_the_same_static_transform_again_is_no_change(tmp_path: Path) -> None:
    again = [static(k, MOUNT, k) for k in (0, 3, 3, 6)]
    recording = opened(tmp_path, [*run(0, 0), *again, *seen(0, 2, 8, frame="lidar")])

    first, second = clouds_of(recording)
    assert_near(first, moved(matrix(at(2)), matrix(MOUNT)))
    assert_near(second, moved(matrix(at(8)), matrix(MOUNT)))
    assert not any("static transform of" in note for note in recording.notes)


def test_a_static_transform_may_change_its_parent_and_outlasts_a_reset(tmp_path: Path) -> None:
    told = [
        *run(0, 0), static(0, at(0.25), 0), static(4, at(50), 4.001, parent="map"), *run(20, 100),
        *seen(0, 2, 7, frame="lidar"), *seen(20, 2, frame="lidar"),
    ]  # fmt: skip

    assert xs(opened(tmp_path, told)) == [2.25, 50, 50]


# Gaps


@pytest.mark.parametrize(
    ("pose_gap", "expected"),
    [
        (None, [2.5, 10, 610, 612.5]),
        (599, [2.5, 10, 610, 612.5]),
        (601, [2.5, 10, 300, 610, 612.5]),
    ],
)
@pytest.mark.parametrize("by", ["transforms", "poses"])
def test_nothing_is_interpolated_across_a_gap(
    tmp_path: Path, pose_gap: float | None, expected: list[float], by: str
) -> None:
    times = [*range(11), *range(610, 621)]
    # A pose holds for half a period at the ends of a gap.
    when = [2.5, 10.4, 300, 609.6, 612.5]
    if by == "transforms":
        told = [transform(k, "map", "base_link", at(k)) for k in times]
        options: dict[str, Any] = {}
    else:
        told = [odometry(k, at(k), "map") for k in times]
        options = {"pose_topic": "/odometry"}
    clouds = [cloud(k, "base_link") for k in when]
    recording = opened(tmp_path, [*told, *clouds], pose_gap=pose_gap, **options)

    if pose_gap == 601:
        assert xs(recording) == pytest.approx([2.5, 10.4, 300, 609.6, 612.5])
        assert not left_out(recording)
    else:
        assert xs(recording) == expected
        assert recording.tally.dropped == {"within a gap of the transforms": 3}
        assert any("`pose_gap` says how long" in note for note in recording.notes)


def test_poses_that_come_seldom_have_no_gaps(tmp_path: Path) -> None:
    told = [transform(k, "map", "base_link", at(k)) for k in (0, 20, 40, 90, 110)]

    assert xs(opened(tmp_path, [*told, cloud(65, "base_link")])) == [65]


@pytest.mark.parametrize("gap", [0, -1, float("nan")])
def test_a_gap_must_be_a_time(tmp_path: Path, gap: float) -> None:
    with pytest.raises(UsageError, match="`pose_gap`"):
        opened(tmp_path, [*moving(), cloud(1, "base_link")], pose_gap=gap)


# Several robots


def fleet(topic: str, frame: str = "base_link") -> list[Told]:
    return [
        *run(0, 0, topic="/robot1/tf"), *run(0, 50, topic="/robot2/tf"),
        recorded(cloud(2, frame, topic=topic), 2),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("topic", "expected"),
    [("/robot1/points", 2), ("/robot2/points", 52), ("/robot2/front/points", 52)],
)
def test_the_name_space_of_the_clouds_decides_whose_transforms_count(
    tmp_path: Path, topic: str, expected: float
) -> None:
    recording = opened(tmp_path, fleet(topic))

    assert xs(recording) == [expected]
    other = "/robot2/tf" if expected == 2 else "/robot1/tf"
    assert any(f"not taken: {other}: the name space" in note for note in recording.notes)


def test_the_inner_name_space_counts_before_the_one_around_it(tmp_path: Path) -> None:
    told = [*run(0, 0, topic="/tf"), *run(0, 50, topic="/robot1/tf")]

    assert xs(opened(tmp_path, [*told, recorded(cloud(2, "base_link", topic="/a/p"), 2)])) == [2]
    (tmp_path / "b").mkdir()
    inner = [*told, recorded(cloud(2, "base_link", topic="/robot1/p"), 2)]
    assert xs(opened(tmp_path / "b", inner)) == [52]


def test_where_no_name_space_decides_clouds_that_must_be_moved_are_refused(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match=r"/points is in the name space of none of them"):
        opened(tmp_path, fleet("/points"))
    (tmp_path / "map").mkdir()
    # Those in the map frame need no transforms; where the craft was is not known.
    recording = opened(tmp_path / "map", fleet("/points", "map"))
    assert xs(recording) == [0]
    assert np.isnan(positions_of(recording)).all()


def test_name_spaces_that_tell_of_different_frames_serve_together(tmp_path: Path) -> None:
    mounted = recorded(transform(0, "base_link", "lidar", at(0.5)), 0, "/robot/tf_static")
    recording = opened(tmp_path, [*run(0, 0), mounted, *seen(0, 2, frame="lidar")])

    assert xs(recording) == [2.5]
    assert not any("not taken" in note for note in recording.notes)


@pytest.mark.parametrize(("topic", "expected"), [("/b/points", 50), ("/points", None)])
def test_of_several_crafts_that_of_the_clouds_tells_where_it_was(
    tmp_path: Path, topic: str, expected: float | None
) -> None:
    told = [
        transform(k, "map", f"{robot}/base_link", at(k + shift))
        for robot, shift in (("a", 0), ("b", 48))
        for k in range(5)
    ]
    ((x, _, _),) = positions_of(opened(tmp_path, [*told, cloud(2, "map", topic=topic)]))

    assert np.isnan(x) if expected is None else x == expected


# Several frames, and none


def test_a_stray_cloud_in_no_frame_is_left_out(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*moving(), cloud(-0.1, ""), cloud(0, "base_link")])

    assert_near(clouds_of(recording), [moved(matrix(FIRST))])
    assert left_out(recording) == {"in no frame, unlike others": 1}


def test_clouds_whose_frame_nothing_leads_from_are_left_out_wherever_they_stand(
    tmp_path: Path,
) -> None:
    told = [cloud(-0.1, "nowhere"), cloud(0, "base_link"), cloud(1, "nowhere"), cloud(4, "map")]
    recording = opened(tmp_path, [*moving(), *told])

    assert_near(clouds_of(recording), [moved(matrix(FIRST)), POINTS])
    assert left_out(recording) == {"no transform from their frame": 2}
