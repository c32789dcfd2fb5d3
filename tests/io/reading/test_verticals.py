"""The vertical of recordings: found, doubted, and told with the way back.

How these tests could be cheated: by points that tell as much as what is tested, by attitudes of a
sensor that are those of the craft, by notes that come of every recording. So points are too few or
tell the contrary, sensors hang askew, and right recordings must be without a note.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.recording import Recording, open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.bags import Told, write_told
from tests.helpers.craft import Pose, cloud, odometry, pose_stamped, transform

Z = np.array([0.0, 0.0, 1.0])
# The world of these recordings has its up at 20 degrees from -y, as that of a camera.
WORLD = Rotation.from_euler("x", 90 + 20, degrees=True)
UP = WORLD.apply(Z)
# From a camera that looks along x, in a world with z up: x right, y down, z ahead.
CAMERA = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def degrees_from(recording: Recording, up: Float64) -> float:
    along = float(np.clip(recording.map_from_recording[2, :3] @ up, -1, 1))
    return float(np.degrees(np.arccos(along)))


def doubts(recording: Recording) -> list[str]:
    for _ in recording.keyframes():
        pass
    return [note for note in recording.notes if "is doubtful" in note]


# Bags


def flown(number: int, mount: Rotation) -> Pose:
    """Return the pose of something mounted on a craft that turns and keeps upright, in WORLD."""
    turn = WORLD * Rotation.from_euler("z", 40 * number, degrees=True) * mount
    x, y, z = WORLD.apply([2.0 * number, 1.0, 3.0]).tolist()
    roll, pitch, yaw = turn.as_euler("xyz", degrees=True).tolist()
    return (x, y, z), (roll, pitch, yaw)


STRAIGHT, ASKEW = Rotation.identity(), Rotation.from_euler("xyz", [70, 30, 10], degrees=True)
FEW = np.random.default_rng(1).normal(size=(4, 3))


def mounted(child: str, mount: Rotation) -> Told:
    roll, pitch, yaw = mount.as_euler("xyz", degrees=True).tolist()
    return transform(0, "base_link", child, ((0.1, 0.0, 0.2), (roll, pitch, yaw)), stays=True)


def tf(child: str = "base_link", mount: Rotation = STRAIGHT) -> list[Told]:
    return [transform(n, "map", child, flown(n, mount)) for n in range(9)]


def clouds(frame: str) -> list[Told]:
    return [cloud(n, frame, FEW + n) for n in range(9)]


@pytest.mark.parametrize(
    ("messages", "options"),
    [
        # The craft's own frame, whether the clouds are in that of the map or of a sensor askew.
        ([*tf(), *clouds("map")], {}),
        ([*tf(), mounted("lidar", ASKEW), *clouds("lidar")], {}),
        ([*(odometry(n, flown(n, STRAIGHT), "map") for n in range(9)), *clouds("map")],
         {"pose_topic": "/odometry"}),
        # A camera's frame, though the craft's is not known.
        ([*tf("front_optical_frame", CAMERA), *clouds("front_optical_frame")], {}),
        # Poses of what is not known, but turns.
        ([*(pose_stamped(n, flown(n, CAMERA), "map") for n in range(9)), *clouds("map")],
         {"pose_topic": "/pose"}),
    ],
    ids=["body", "sensor on body", "odometry", "optical", "poses"],
)  # fmt: skip
def test_the_attitudes_of_a_bag_tell_its_vertical(
    tmp_path: Path, messages: list[Told], options: dict[str, Any]
) -> None:
    bag = write_told(tmp_path / "flight", sorted(messages, key=lambda told: told.log_time))
    recording = open_recording(bag, up="auto", **options)

    assert degrees_from(recording, UP) < 5
    assert any("upright" in note for note in recording.notes)
    assert len(doubts(open_recording(bag, **options))) == 1


def test_a_sensor_that_turns_on_a_craft_without_a_name_tells_nothing(tmp_path: Path) -> None:
    swept = [
        transform(n, "stand", "laser", ((0.1 * n, 0.0, 0.5), (0.0, 20.0 * n, 0.0)))
        for n in range(9)
    ]
    messages = sorted([*swept, *clouds("laser")], key=lambda told: told.log_time)
    bag = write_told(tmp_path / "flight", messages)

    assert doubts(open_recording(bag)) == []
    with pytest.raises(InputError, match="flat surroundings"):
        open_recording(bag, up="auto")


# Files


def grid(x: float, y: float, step: float) -> Float64:
    across, along = np.mgrid[0:x:step, 0:y:step].reshape(2, -1)
    return np.column_stack((across, along, np.zeros(across.size)))


def room() -> Float64:
    """Return a room whose ceiling was seen better than its floor."""
    rng = np.random.default_rng(2)
    sides = [grid(10, 3, 0.17)[:, [0, 2, 1]] + (0, y, 0) for y in (0, 6)]
    points = np.concatenate((grid(10, 6, 0.32), np.add(grid(10, 6, 0.12), (0, 0, 3)), *sides))
    return points + rng.normal(0, 0.01, points.shape)


def written(folder: Path, points: Float64, name: str = "cloud.xyz") -> Path:
    np.savetxt(folder / name, points, fmt="%.4f")
    return folder / name


@pytest.mark.parametrize("route", ["", "0 0 0 1", "0 0 0.707107 0.707107", "places only"])
def test_a_room_keeps_its_floor_though_the_ceiling_was_seen_better(
    tmp_path: Path, route: str
) -> None:
    path, trajectory = written(tmp_path, room()), tmp_path / "room.tum"
    attitude = "" if route == "places only" else route
    trajectory.write_text("".join(f"{n} {1 + n * 0.8} 3 1 {attitude}\n" for n in range(11)))
    flown = trajectory if route else None
    recording = open_recording(path, up="auto", route=flown)

    assert degrees_from(recording, Z) < 1
    assert doubts(open_recording(path, route=flown)) == []


def test_the_columns_of_a_text_tell_attitudes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    rows = []
    for number in range(12):
        turn = WORLD * Rotation.from_euler("z", 30 * number, degrees=True) * CAMERA
        place = WORLD.apply([0.3 * number, 0.0, 1.0])
        for point in rng.normal(size=(3, 3)):
            rows.append([*point, *turn.as_quat(), number, *place])
    path = written(tmp_path, np.array(rows))
    recording = open_recording(path, columns="x,y,z,qx,qy,qz,qw,keyframe,cx,cy,cz", up="auto")

    assert degrees_from(recording, UP) < 3
    assert "the axes of its attitudes are a camera's" in recording.notes[-1]
    with pytest.raises(InputError, match="flat surroundings"):
        open_recording(path, columns="x,y,z,-,-,-,-,keyframe,cx,cy,cz", up="auto")


def tower(folder: Path) -> Path:
    """Write a COLMAP model: a tower that is all wall, its cameras on the ground around it."""
    rng = np.random.default_rng(4)
    around, height = rng.uniform(0, 2 * np.pi, 1500), rng.uniform(1, 10, 1500)
    points = np.column_stack((2 * np.cos(around), -height, 2 * np.sin(around)))
    folder.mkdir()
    (folder / "points3D.txt").write_text(
        "".join(f"{n} {x} {y} {z} 0 0 0 0.5 {n % 12 + 1} 0\n" for n, (x, y, z) in enumerate(points))
    )
    lines = []
    for n in range(12):
        x, y, z, w = Rotation.from_euler("y", -30 * n, degrees=True).as_quat()
        lines.append(f"{n + 1} {w} {x} {y} {z} 0 0 12 1 {n:02d}.jpg\n\n")
    (folder / "images.txt").write_text("".join(lines))
    return folder


def test_a_tower_has_the_side_of_its_cameras_and_a_map_that_lies_says_so(tmp_path: Path) -> None:
    path = tower(tmp_path / "tower")
    recording = open_recording(path, up="auto")
    keyframes = list(recording.keyframes())

    assert recording.up == "-y"
    assert min(keyframe.points[:, 2].min() for keyframe in keyframes) > 0.9
    assert all(abs(keyframe.position[2]) < 0.1 for keyframe in keyframes)
    (doubt,) = doubts(open_recording(path))
    assert doubt.startswith("`up` z is doubtful, try `up` auto: it seems that up is -y")
    assert doubts(open_recording(path, up="-y")) == []


@pytest.mark.parametrize("keyframes", [1, 12])
def test_coordinates_of_a_map_projection_stay_where_they_are(
    tmp_path: Path, keyframes: int
) -> None:
    ground = np.add(grid(100, 100, 1.3), (513_000, 5_403_000, 300))
    ground[:, 2] += 0.003 * (ground[:, 0] - 513_000) + 4 * (np.arange(len(ground)) % 10 == 0)
    numbers = np.arange(len(ground)) % keyframes
    path = written(tmp_path, np.column_stack((ground, numbers)), "utm.csv")
    plain = list(open_recording(path, columns="x,y,z,keyframe").keyframes())
    recording = open_recording(path, columns="x,y,z,keyframe", up="auto")

    assert len(plain) == keyframes
    for ours, theirs in zip(recording.keyframes(), plain, strict=True):
        assert ours.points.tobytes() == theirs.points.tobytes()
    assert recording.map_from_recording.tolist() == np.eye(4).tolist()


def test_a_cloud_far_away_turns_about_its_own_middle(tmp_path: Path) -> None:
    away = np.array([40_000.0, -3000.0, 500.0])
    slope = Rotation.from_euler("x", 4, degrees=True)
    ground = np.concatenate((grid(60, 60, 1.1), np.add(grid(8, 8, 0.6), (20, 20, 3))))
    recorded = slope.apply(ground - (30, 30, 0)) + away
    (plain,) = open_recording(written(tmp_path, recorded)).keyframes()
    recording = open_recording(tmp_path / "cloud.xyz", up="auto")
    (keyframe,) = recording.keyframes()

    assert degrees_from(recording, slope.apply(Z)) < 0.2
    # Nothing moves by more than its distance from the middle, times the angle.
    assert np.abs(keyframe.points - plain.points).max() < 45 * np.radians(4.5)
    whole = recording.map_from_recording
    back = (keyframe.points - whole[:3, 3]) @ whole[:3, :3]
    np.testing.assert_allclose(back, plain.points, atol=1e-8)


def test_the_crop_is_of_the_map_and_hides_nothing_from_the_search(tmp_path: Path) -> None:
    # Of the recording, these bounds hold nothing.
    path = written(tmp_path, room()[:, [0, 2, 1]] * (1, -1, 1))
    crop = (0, 10, 0, 6, -1, 4)
    (keyframe,) = open_recording(path, up="auto", crop=crop).keyframes()
    (named,) = open_recording(path, up="-y", crop=crop).keyframes()

    assert len(keyframe.points) > 0.99 * len(named.points) > 5000


def test_a_doubt_is_told_once_a_pass_has_ended_and_not_before(tmp_path: Path) -> None:
    recording = open_recording(tower(tmp_path / "tower"))
    assert recording.notes == []
    passing = recording.keyframes()
    next(passing)
    assert recording.notes == []
    for _ in passing:
        pass
    (note,) = recording.notes
    for _ in recording.keyframes():
        pass
    assert recording.notes == [note]


def test_a_glance_may_doubt_as_well(tmp_path: Path) -> None:
    path = tower(tmp_path / "tower")

    assert len(doubts(open_recording(path, glance=Glance(points=900)))) == 1


@pytest.mark.parametrize("turn", [60, 150])
@pytest.mark.parametrize("w", ["first", "last"])
def test_the_scene_tells_the_order_of_quaternions_that_no_name_tells(
    tmp_path: Path, w: str, turn: float
) -> None:
    ground = np.concatenate((grid(10, 6, 0.2), grid(10, 2, 0.25)[:, [0, 2, 1]] + (0, 6, 0)))
    path = written(tmp_path, ground + np.random.default_rng(6).normal(0, 0.01, ground.shape))
    trajectory = tmp_path / "flight.tum"
    lines = []
    for n in range(12):
        angles = (0.5 + n % 2, -0.5 + n % 3, turn * n / 11)
        attitude = Rotation.from_euler("xyz", angles, degrees=True).as_quat()
        numbers = np.roll(attitude, 1) if w == "first" else attitude
        lines.append(f"{n} {0.8 * n} 2 5 {' '.join(map(str, numbers))}\n")
    trajectory.write_text("".join(lines))
    recording = open_recording(path, up="auto", route=trajectory)

    assert degrees_from(recording, Z) < 3
    told = [note for note in recording.notes if "the quaternions are taken as w x y z" in note]
    assert len(told) == (w == "first")
    assert doubts(open_recording(path, route=trajectory)) == []


def test_an_order_of_quaternions_that_nothing_tells_is_noted_with_the_way_to_say_it(
    tmp_path: Path,
) -> None:
    path, trajectory = written(tmp_path, room()), tmp_path / "room.tum"
    # A turn about the diagonal of all axes is the same in either order.
    trajectory.write_text("".join(f"{n} {1 + n * 0.8} 3 1 0.5 0.5 0.5 0.5\n" for n in range(11)))
    named = "stamp x y z qx qy qz qw\n"
    recording = open_recording(path, up="auto", route=trajectory)

    (note,) = [note for note in recording.notes if "quaternions" in note]
    assert "taken as x y z w: the scene does not tell; a first line that names the columns" in note
    trajectory.write_text(named + trajectory.read_text())
    recording = open_recording(path, up="auto", route=trajectory)
    assert not any("quaternions" in note for note in recording.notes)
