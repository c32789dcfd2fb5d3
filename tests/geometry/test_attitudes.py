"""What attitudes say about the vertical.

How these tests could be cheated: by taking the mean of one axis of the cameras, which is right for
cameras that look ahead, all round; by a world whose z is up; by axes that are told. So cameras look
straight down, or all the same way, or stand on their sides, the world is turned at random, and
what the axes are is withheld.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.attitudes import likelihoods, taken_as
from mlscli.geometry.evidence import half_sphere
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

HALF = half_sphere(2000)
SPHERE = np.concatenate((HALF, -HALF))
Z = np.array([0.0, 0.0, 1.0])
# From a camera that looks along x, in a world with z up: x right, y down, z ahead.
AHEAD = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
WORLD = Rotation.random(random_state=5)


def cameras(
    yaw: Float64, pitch: Float64 | float = 0.0, roll: Float64 | float = 0.0, noise: float = 2.0
) -> Rotation:
    """Return cameras in a world with z up; angles in degrees, pitch upwards."""
    rng = np.random.default_rng(len(yaw))
    angles = [np.broadcast_to(some, yaw.shape) for some in (yaw, -np.asarray(pitch), roll)]
    turns = np.column_stack(angles) + rng.normal(0, noise, (len(yaw), 3))
    return Rotation.from_euler("ZYX", turns, degrees=True) * AHEAD


def likeliest(attitudes: Rotation, axes: Axes) -> tuple[float, float, float]:
    """Return the degrees from the likeliest direction to the true one; how it excels others.

    Others are its opposite, and those 45 degrees away and more.
    """
    said = likelihoods((WORLD * attitudes).as_quat(), axes, SPHERE)
    best = SPHERE[int(said.argmax())]
    along = SPHERE @ best
    off = float(np.degrees(np.arccos(np.clip(best @ WORLD.apply(Z), -1, 1))))
    opposite = float(said[along < -0.999].max())
    return off, said.max() - opposite, said.max() - said[np.abs(along) < np.sqrt(0.5)].max()


ROUND = np.linspace(0, 330, 12)


@pytest.mark.parametrize(
    "attitudes",
    [
        cameras(ROUND),
        cameras(ROUND, 35.0),
        cameras(ROUND, np.linspace(-60, 20, 12)),
        cameras(ROUND, -90.0),
        # A survey from above in lanes there and back: no camera is turned by a quarter.
        cameras(np.tile([0.0, 180.0], 8), -90.0),
        cameras(np.tile([20.0, 200.0], 8), -70.0),
        cameras(np.linspace(-50, 50, 20), -10.0),
    ],
    ids=["level", "up", "up and down", "straight down", "lanes", "lanes ahead", "a sector"],
)
def test_cameras_tell_the_vertical_and_its_side_whichever_way_they_look(
    attitudes: Rotation,
) -> None:
    off, opposite, others = likeliest(attitudes, "camera")

    assert off < 5
    assert opposite > 6
    assert others > 6


def test_one_camera_in_five_that_is_not_upright_changes_nothing() -> None:
    roll = np.zeros(20)
    roll[::5] = (90.0, 180.0, -90.0, 30.0)
    off, opposite, others = likeliest(cameras(np.linspace(0, 340, 20), -20.0, roll), "camera")

    assert off < 5
    assert min(opposite, others) > 6


def test_cameras_on_their_sides_tell_the_axis() -> None:
    for roll in (90.0, -90.0):
        attitudes = cameras(np.linspace(-70, 70, 15), 0.0, roll)
        off, opposite, others = likeliest(attitudes, "camera")
        # To which side they were turned is not known.
        assert min(off, 180 - off) < 5
        assert abs(opposite) < 0.1
        assert others > 1
        said = taken_as((WORLD * attitudes).as_quat(), "camera", WORLD.apply([Z]))
        assert said == "the cameras were held upright, turned by a quarter"


def test_cameras_that_look_all_the_same_way_leave_their_pitch_open() -> None:
    attitudes = (WORLD * cameras(np.zeros(6), noise=0.1)).as_quat()

    def said(pitch: float, roll: float) -> float:
        up = Rotation.from_euler("YX", [-pitch, roll], degrees=True).apply(Z)
        return float(likelihoods(attitudes, "camera", WORLD.apply([up]))[0])

    # Up to where a camera would look down on what it sees straight ahead.
    assert said(0, 0) - 1 < said(25, 0) < said(0, 0)
    assert said(0, 0) - 1 < said(-25, 0) < said(0, 0)
    assert said(-60, 0) > said(0, 25) + 3
    assert said(0, 180) < said(0, 0) - 6


def test_bodies_tell_the_vertical_though_they_tilt() -> None:
    rng = np.random.default_rng(2)
    tilts = np.column_stack((np.linspace(0, 300, 40), rng.normal(0, 12, (40, 2))))
    off, opposite, others = likeliest(Rotation.from_euler("ZYX", tilts, degrees=True), "body")

    assert off < 6
    assert min(opposite, others) > 6


@pytest.mark.parametrize("mount", ["camera", "body", "neither"])
def test_of_unknown_axes_the_turns_tell_the_vertical(mount: str) -> None:
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 30)[:, None], degrees=True)
    sensor = Rotation.from_euler("xyz", [50, 20, 10], degrees=True)
    fixed = {"camera": AHEAD, "body": Rotation.identity(), "neither": sensor}[mount]
    off, opposite, others = likeliest(yaw * fixed, "unknown")
    words = taken_as((WORLD * yaw * fixed).as_quat(), "unknown", WORLD.apply([Z]))

    assert min(off, 180 - off) < 3
    assert others > 3
    if mount == "neither":
        assert abs(opposite) < 0.1
        assert "neither a camera's nor a body's" in words
    else:
        assert off < 3
        assert opposite > 1
        assert f"a {mount}'s" in words


def test_of_unknown_axes_without_a_turn_little_follows() -> None:
    said = likelihoods(np.tile([0.0, 0.0, 0.0, 1.0], (30, 1)), "unknown", SPHERE)

    assert np.ptp(said) < 3.5


@pytest.mark.parametrize("attitudes", [None, np.empty((0, 4)), np.full((3, 4), np.nan)])
def test_without_attitudes_nothing_is_said(attitudes: Float64 | None) -> None:
    for axes in ("camera", "body", "unknown"):
        assert not likelihoods(attitudes, axes, SPHERE).any()
        assert taken_as(attitudes, axes, SPHERE) == ""


def test_more_attitudes_of_the_same_kind_weigh_no_more() -> None:
    few = (WORLD * cameras(np.linspace(0, 342, 20), noise=0.0)).as_quat()
    many = np.repeat(few, 50, axis=0)

    np.testing.assert_allclose(
        likelihoods(many, "camera", SPHERE), likelihoods(few, "camera", SPHERE), atol=1.5
    )
