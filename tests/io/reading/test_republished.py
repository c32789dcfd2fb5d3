"""A map that is published again and again, told from what is ordinary.

How these tests could be cheated: by what is true of one such map (an order of its points, a size
that grows, a shift that never ends), by calling every repetition one (scanners that stand still or
walk in circles, maps whose points never move, windows that move along), or by remembering all
messages. So maps of each kind stand beside their ordinary twins, and real recordings are read.
"""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.io.reading.recording import open_recording
from mlscli.io.reading.republished import Republished
from mlscli.runtime.arrays import Float64
from tests.helpers import craft
from tests.helpers.bags import Sent, write_bag
from tests.helpers.published import Clouds, published, room, scans
from tests.helpers.texts import text


def noticed(clouds: Clouds) -> bool:
    watched = Republished()
    for number, cloud in enumerate(clouds):
        watched.add(cloud, number)
    return watched.is_noticed()


def falls(time: float) -> float:
    return 0.6 * (1 - time)


def closes(time: float) -> float:
    """Jump, as a map does that is corrected once, when a loop is closed."""
    return 0.6 * (time < 0.7)


def never(time: float) -> float:  # noqa: ARG001
    return 0.0


MAPS: dict[str, dict[str, Any]] = {
    "grows, in one order": {},
    "grows, in any order": {"shuffled": True},
    "loses points": {"shuffled": True, "culled": 0.4},
    "is whole, in one order": {"grows": False},
    "is whole, in any order": {"grows": False, "shuffled": True},
    "is noisy": {"shuffled": True, "jitter": 0.003},
}


@pytest.mark.parametrize("kind", MAPS)
def test_a_map_is_noticed_where_it_moves_and_only_there(kind: str) -> None:
    assert noticed(published(16, falls, **MAPS[kind]))
    assert noticed(published(16, closes, **MAPS[kind]))
    assert not noticed(published(16, never, **MAPS[kind]))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_up_may_be_any_axis(axis: int) -> None:
    clouds = published(20, falls)
    assert noticed([np.roll(cloud, axis, axis=1) for cloud in clouds])


@pytest.mark.parametrize("messages", [2, 3, 4, 60])
def test_it_takes_few_messages_or_many(messages: int) -> None:
    assert noticed(published(messages, falls))
    assert not noticed(published(messages, never, jitter=0.01))


def test_what_lies_between_the_maps_is_passed_over() -> None:
    cameras = [0.1 * room(70, seed) for seed in range(16)]
    pairs = zip(cameras, published(16, closes, grows=False), strict=True)
    assert noticed([cloud for pair in pairs for cloud in pair])


def test_points_that_are_no_measurement_tell_nothing() -> None:
    clouds = published(20, falls)
    for cloud in clouds:
        cloud[::5] = np.nan
        cloud[1::5, 2] = 1e33
    assert noticed(clouds)
    for value in (np.nan, np.inf, 1.7e308, 0.0):
        assert not noticed([np.full((500, 3), value)] * 8)
        # Hardly a point of a message is left.
        few = [cloud.copy() for cloud in published(6, falls, grows=False)]
        for cloud in few[:5]:
            cloud[:-5] = value
        assert not noticed(few)


def still(time: float) -> Float64:  # noqa: ARG001
    return np.array([4.0, 3.0, 1.5])


def around(time: float) -> Float64:
    turn = 2 * np.pi * time
    return np.array([5 + 2.5 * np.cos(turn), 3.5 + 1.5 * np.sin(turn), 1.5])


def around_and_still(time: float) -> Float64:
    return around(np.clip((time - 0.4) / 0.3, 0, 1))


def nudged(time: float) -> Float64:
    return still(time) + (np.array([0.15, 0, 0.1]) if time > 0.6 else 0.0)


def takes_off(time: float) -> Float64:
    return np.array([4.0, 3.0, 0.2 + 2 * min(3 * time, 1.0)])


@pytest.mark.parametrize("noise", [0.0, 0.004, 0.03])
@pytest.mark.parametrize("way", [still, around, around_and_still, nudged, takes_off])
def test_a_scanner_that_sees_one_room_all_the_time_is_ordinary(way: Any, noise: float) -> None:
    assert not noticed(scans(60, way, noise=noise))


def test_a_part_of_a_map_that_moves_along_is_ordinary() -> None:
    whole = room(6000)
    rise = np.array([0, 0, 0.1])
    assert not noticed([whole[300 * k : 300 * k + 1500] + k * rise for k in range(15)])
    # Each point once, as SLAM keyframe by keyframe.
    assert not noticed(np.array_split(whole, 30))


def test_a_room_that_is_scanned_with_more_and_more_points_is_ordinary() -> None:
    clouds = scans(20, around, noise=0.01, columns=600)
    rng = np.random.default_rng(1)
    grown = [c[rng.random(len(c)) < 0.2 + 0.04 * k] for k, c in enumerate(clouds)]
    assert not noticed(grown)


def test_the_order_of_points_does_not_matter_where_they_have_twins() -> None:
    rng = np.random.default_rng(2)
    for lifted, expected in ((falls, True), (never, False)):
        clouds = published(20, lifted, shuffled=True)
        for _ in range(3):
            assert noticed([rng.permutation(cloud) for cloud in clouds]) is expected


def test_messages_are_not_remembered() -> None:
    clouds = published(4, never, points=10_000, grows=False)
    watched = Republished()

    def watch(times: int) -> int:
        for number in range(times):
            watched.add(clouds[number % 4].copy(), (times, number))
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        first = watch(30)
        assert watch(120) < first + 3 * clouds[0].nbytes
    finally:
        tracemalloc.stop()


# In recordings


def notes_of(path: Path, **options: Any) -> list[str]:
    recording = open_recording(path, **options)
    for _ in recording:
        pass
    return [note for note in recording.notes if "published again" in note]


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_recording_says_so_in_one_line_with_both_options(tmp_path: Path, kind: str) -> None:
    clouds = [Sent(cloud, 10**9 * k) for k, cloud in enumerate(published(10, falls, points=500))]
    bag = write_bag(tmp_path / "a.bag", clouds, kind)
    (note,) = notes_of(bag)
    assert note.startswith(f"{bag}: /cloud: ")
    assert "`latest`" in note
    assert "`cumulative`" in note
    assert "\n" not in note
    assert notes_of(bag, cumulative=True) == [note]
    assert not notes_of(bag, latest=True)
    # Once the loop is closed, all lies where it stays.
    still = [Sent(cloud, 10**9 * k) for k, cloud in enumerate(published(10, closes, points=500))]
    bag = write_bag(tmp_path / "b.bag", still, kind)
    assert notes_of(bag, end=8.0)
    assert not notes_of(bag, start=7.0)


def test_keyframes_of_one_message_are_one_map(tmp_path: Path) -> None:
    clouds = published(8, falls, points=600, grows=False)
    labels = [number // 100 for number in range(600)]
    messages = [Sent(cloud, 10**9 * k, labels) for k, cloud in enumerate(clouds)]
    assert notes_of(write_bag(tmp_path / "a.bag", messages))


def test_clouds_of_a_sensor_and_of_files_are_not_looked_at(tmp_path: Path) -> None:
    clouds = published(12, falls, points=800)
    rows = [f"{x} {y} {z} {k}" for k, c in enumerate(clouds) for x, y, z in c.tolist()]
    assert not notes_of(text(tmp_path, "\n".join(rows)))
    told = [*craft.moving(), *(craft.cloud(k / 3, "base_link", c) for k, c in enumerate(clouds))]
    recording = craft.opened(tmp_path, told)
    assert [len(points) for points in craft.clouds_of(recording)] == [len(c) for c in clouds]
    assert not any("published again" in note for note in recording.notes)
    # Where the sensor is said to stand still, they are.
    assert notes_of(tmp_path / "flight", frame="base_link")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("ros1_luminar_pc2_lz4.bag", {"topic": "/luminar_pointcloud", "frame": "luminar_lidar"}),
        ("ros1_luminar_pc2_lz4.bag", {"topic": "/base_scan", "frame": "base_laser_link"}),
        ("ros1_ouster_in_mcap_zstd.mcap", {"frame": "os1_lidar"}),
        ("ros1_jackal_scan_pose.bag", {"frame": "velodyne"}),
        ("ros1_jackal_scan_pose.bag", {"pose_topic": "/vrpn_client_node/jackal/pose"}),
        ("ros1_tilt_laser_tf.bag", {"frame": "laser"}),
        ("ros1_tilt_laser_tf.bag", {}),
    ],
)
def test_recordings_of_others_are_ordinary(
    shared_data: Path, name: str, options: dict[str, Any]
) -> None:
    assert not notes_of(shared_data / "bags" / name, **options)


def test_recorded_maps_keyframe_by_keyframe_are_ordinary_and_repeated_they_are_not(
    tmp_path: Path, shared_data: Path
) -> None:
    path = shared_data / "sparse/tello_kf_pointData.csv"
    columns = "x,y,z,-,-,-,-,keyframe,cx,cy,cz"
    flown = [k.points for k in open_recording(path, columns=columns, up="-y")]
    once = write_bag(tmp_path / "once.bag", [Sent(c, 10**9 * k) for k, c in enumerate(flown)])
    assert not notes_of(once)
    size = float(np.ptp(np.concatenate(flown)[:, :2], axis=0).max())
    for rise in (0.0, 0.1 * size):
        up = np.array([0, 0, rise])
        maps = [np.concatenate(flown[: 10 * k]) + up / k for k in range(1, 11)]
        assert noticed(maps) is (rise > 0)
