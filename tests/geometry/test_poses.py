"""Poses.

How these tests could be cheated: by rotations about one axis, by quaternions of one sign, or by
times that are all between two poses. So poses are drawn at random, chained as 4 by 4 matrices,
and interpolated by scipy a pair at a time.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from mlscli.geometry.poses import (
    Pose,
    Poses,
    PoseTrack,
    apply,
    identity,
    looking,
    looks_of,
    matrices,
    turn,
)
from mlscli.runtime.arrays import Float64

IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def random_poses(rng: np.random.Generator, count: int) -> Poses:
    rotations = rng.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return Poses(rng.normal(size=(count, 3)), rotations, np.ones(count, dtype=np.bool_))


def as_matrices(poses: Poses) -> Float64:
    matrices = np.tile(np.eye(4), (len(poses.known), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(poses.rotation).as_matrix()
    matrices[:, :3, 3] = poses.translation
    return matrices


def track_of(stamps: list[float], xs: list[float]) -> PoseTrack:
    translations = np.zeros((len(xs), 3))
    translations[:, 0] = xs
    return PoseTrack(np.array(stamps, float), translations, np.tile(IDENTITY, (len(xs), 1)))


def xs_at(track: PoseTrack, *stamps: float) -> list[float]:
    return [float(x) for x in track.at(np.array(stamps, float)).translation[:, 0]]


def test_attitudes_look_where_they_are_asked_to() -> None:
    yaw, tilt = np.random.default_rng(5).uniform((-np.pi, 0), (np.pi, np.pi), (50, 2)).T
    tilt[:3] = 0.0, np.pi / 2, 1e-3
    turned = Rotation.from_quat(looking(yaw, tilt))
    right = (np.sin(tilt) * np.cos(yaw), np.sin(tilt) * np.sin(yaw), -np.cos(tilt))
    assert turned.apply([0.0, 0.0, -1.0]) == pytest.approx(np.stack(right, axis=1))
    # The craft does not roll.
    assert turned.apply([0.0, 1.0, 0.0])[:, 2] == pytest.approx(0.0)
    assert np.stack(looks_of(looking(yaw, tilt))) == pytest.approx(np.stack((yaw, tilt)))


# Chains


def test_chains_and_inverses_are_those_of_4_by_4_matrices() -> None:
    rng = np.random.default_rng(1)
    a, b = random_poses(rng, 500), random_poses(rng, 500)

    np.testing.assert_allclose(
        as_matrices(a.chained(b)), as_matrices(a) @ as_matrices(b), atol=1e-13
    )
    np.testing.assert_allclose(as_matrices(a.inverse), np.linalg.inv(as_matrices(a)), atol=1e-13)


def test_quaternions_of_any_length_are_the_matrices_that_scipy_makes() -> None:
    quaternions = np.random.default_rng(3).normal(size=(500, 4))
    quaternions[0], quaternions[1] = 2 * IDENTITY, (1.0, 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(
        matrices(quaternions), Rotation.from_quat(quaternions).as_matrix()
    )


def test_one_pose_is_chained_with_many() -> None:
    rng = np.random.default_rng(2)
    one, many = random_poses(rng, 1), random_poses(rng, 5)

    np.testing.assert_allclose(
        as_matrices(one.chained(many)), as_matrices(one) @ as_matrices(many), atol=1e-13
    )
    np.testing.assert_allclose(
        as_matrices(many.chained(one)), as_matrices(many) @ as_matrices(one), atol=1e-13
    )


# Points


def test_points_are_rotated_then_moved() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(1000, 3)) * 1e4
    for row in range(20):
        pose = random_poses(rng, 20).pose(row)
        expected = Rotation.from_quat(pose.rotation).apply(points) + pose.translation
        np.testing.assert_allclose(apply(pose, points), expected, rtol=0, atol=1e-10)


def test_the_identity_leaves_every_bit_as_it_is() -> None:
    points = np.array([[0.1, -0.0, 1e33], [np.nan, np.inf, 5e-324], [1 / 3, 1e8, -7.0]])

    for sign in (1.0, -1.0):
        moved = apply(Pose(np.zeros(3), sign * IDENTITY), points)
        assert moved.tobytes() == points.tobytes()
    moved = apply(Pose(np.array([1.0, 0.0, 0.0]), IDENTITY), points)
    np.testing.assert_array_equal(moved, points + np.array([1.0, 0.0, 0.0]))


def test_a_point_that_is_not_finite_spoils_no_other() -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(10, 3))
    broken = points.copy()
    broken[3] = [np.inf, 1.0, np.nan]
    pose = random_poses(rng, 1).pose(0)

    others = np.arange(10) != 3
    np.testing.assert_array_equal(apply(pose, broken)[others], apply(pose, points)[others])
    assert not np.isfinite(apply(pose, broken)[3]).all()


def test_a_turn_does_not_depend_on_how_many_points_there_are() -> None:
    rng = np.random.default_rng(5)
    points, matrix = rng.normal(size=(10_000, 3)), rng.normal(size=(3, 3))
    x, y, z = points[777].tolist()

    one_by_one = [(a * x + b * y) + c * z for a, b, c in matrix.tolist()]
    assert turn(matrix, points)[777].tolist() == one_by_one
    assert turn(matrix, points[777:778])[0].tolist() == one_by_one


# Interpolation


def test_between_two_poses_it_is_linear_and_slerp() -> None:
    rng = np.random.default_rng(6)
    stamps = np.sort(rng.uniform(0, 100, 200))
    poses = random_poses(rng, 200)
    wanted = rng.uniform(stamps[0], stamps[-1], 300)
    order = rng.permutation(200)
    # Quaternions of any sign and length stand for the same rotations.
    scaled = poses.rotation * rng.choice([-3.0, 0.5, 1.0], (200, 1))

    track = PoseTrack(stamps[order], poses.translation[order], scaled[order])
    found = track.at(wanted)

    assert found.known.all()
    for row, stamp in enumerate(wanted.tolist()):
        high = int(np.searchsorted(stamps, stamp))
        pair = slice(high - 1, high + 1)
        turned = Slerp(stamps[pair], Rotation.from_quat(poses.rotation[pair]))(stamp)
        between = Rotation.from_quat(found.rotation[row]) * turned.inv()
        assert between.magnitude() < 1e-9
        for axis in range(3):
            x = np.interp(stamp, stamps[pair], poses.translation[pair, axis])
            assert found.translation[row, axis] == pytest.approx(x, abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.rotation, axis=1), 1, atol=1e-12)


def test_at_its_own_time_a_pose_is_exact() -> None:
    rng = np.random.default_rng(7)
    stamps, poses = np.linspace(0.0, 4.9, 50), random_poses(rng, 50)

    found = PoseTrack(stamps, poses.translation, poses.rotation).at(stamps)

    np.testing.assert_array_equal(found.translation, poses.translation)
    np.testing.assert_allclose(
        np.abs(np.sum(found.rotation * poses.rotation, axis=1)), 1, rtol=0, atol=1e-15
    )


def test_half_turns_and_rests_are_no_trouble() -> None:
    half_turn = np.array([1.0, 0.0, 0.0, 0.0])
    track = PoseTrack(
        np.array([0.0, 1.0, 2.0]), np.zeros((3, 3)), np.array([IDENTITY, half_turn, -half_turn])
    )

    quarter, resting = track.at(np.array([0.5, 1.7])).rotation

    assert Rotation.from_quat(quarter).magnitude() == pytest.approx(np.pi / 2)
    assert Rotation.from_quat(resting).magnitude() == pytest.approx(np.pi)


def test_outside_it_holds_for_half_a_period() -> None:
    # The spacings are 1, 1, 1 and 6: the median is 1.
    track = track_of([10, 11, 12, 13, 19], [0, 1, 2, 3, 4])

    assert xs_at(track, 9.5, 19.5) == [0, 4]
    assert np.isnan(xs_at(track, np.nextafter(9.5, 0), np.nextafter(19.5, 20))).all()
    assert (
        track.at(np.array([9.5, 9.4, np.nan, np.inf, -np.inf])).known.tolist()
        == [True] + [False] * 4
    )
    assert np.isnan(track.at(np.array([9.4])).rotation).all()


def test_gaps_within_are_bridged() -> None:
    assert xs_at(track_of([10, 11, 12, 13, 19], [0, 1, 2, 3, 4]), 16) == [3.5]


def test_a_single_pose_is_known_at_its_own_time_only() -> None:
    track = track_of([5], [7])

    assert xs_at(track, 5) == [7]
    assert not track.at(np.array([np.nextafter(5, 6), np.nextafter(5, 4)])).known.any()


def test_no_pose_tells_nothing() -> None:
    poses = track_of([], []).at(np.array([1.0, 2.0]))

    assert poses.translation.shape == (2, 3)
    assert poses.rotation.shape == (2, 4)
    assert not poses.known.any()


def test_of_equal_time_stamps_the_last_counts() -> None:
    assert xs_at(track_of([1, 0, 1, 2, 1], [5, 0, 6, 2, 1]), 1, 0.5, 1.5) == [1, 0.5, 1.5]
    stamps = np.random.default_rng(8).integers(0, 10, 1000).astype(float).tolist()
    last = dict(zip(stamps, range(1000), strict=True))
    track = track_of(stamps, list(map(float, range(1000))))
    assert xs_at(track, *map(float, range(10))) == [last[stamp] for stamp in range(10)]


def test_poses_that_are_none_are_left_out() -> None:
    translations = np.zeros((6, 3))
    translations[:, 0] = [0, 1, 2, np.inf, 4, 5]
    rotations = np.tile(IDENTITY, (6, 1))
    rotations[2] = 0
    rotations[4, 1] = np.nan

    track = PoseTrack(np.array([0.0, np.nan, 2.0, 3.0, 4.0, 5.0]), translations, rotations)

    assert track.stamps.tolist() == [0, 5]
    assert xs_at(track, 1, 2.5) == [1, 2.5]


def test_from_one_series_to_another_the_earlier_pose_holds() -> None:
    translations = np.arange(12.0).reshape(4, 3)
    track = PoseTrack(
        np.arange(4.0), translations, np.tile(IDENTITY, (4, 1)), np.array([7, 7, 8, 8])
    )
    wanted = np.array([0.5, 1.0, 1.9, 2.0, 2.5, 3.2])

    assert track.at(wanted).translation[:, 0].tolist() == [1.5, 3, 3, 6, 7.5, 9]
    assert track.series_at(wanted).tolist() == [7, 7, 7, 8, 8, 8]
    pair = PoseTrack(np.arange(2.0), translations[:2], np.tile(IDENTITY, (2, 1)), np.array([7, 8]))
    wanted = np.array([-np.inf, 0.9, 1.0, 1.4, np.inf])
    assert pair.at(wanted[1:4]).translation[:, 0].tolist() == [0, 3, 3]
    assert pair.series_at(wanted).tolist() == [7, 7, 8, 8, 8]


def test_the_identity_is_known_at_all_times() -> None:
    poses = identity(3)

    np.testing.assert_array_equal(as_matrices(poses), np.tile(np.eye(4), (3, 1, 1)))
    assert poses.known.all()
