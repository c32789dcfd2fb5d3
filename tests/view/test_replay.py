"""The replay, read back by rosbags and by mcap: the map at every time, and whole in the end.

Ways to pass without being right: the program's own reader alone looks; the end is right and all
before it is not, so states are compared with maps built of the flight up to their times; types
that are known to the reader anyway, so definitions are taken from the file.
"""

from __future__ import annotations

import weakref
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import mlscli
from mlscli.errors import OutputError
from mlscli.io.writing import mcap_states
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.change import Change
from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.uncovering import growth
from mlscli.mesh import build_mesh
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Array, Float64
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.presets import make
from mlscli.view.replay import open_replay, write_replay
from tests.helpers.maps import KEYFRAMES, map_of
from tests.helpers.meshes import a_map, house, plane, soup

CELL = 0.25
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
TYPES = {
    "/mls/patches": "sensor_msgs/msg/PointCloud2",
    "/mls/surface": "visualization_msgs/msg/Marker",
    "/mls/walls": "visualization_msgs/msg/Marker",
    "/mls/artificial": "visualization_msgs/msg/Marker",
    "/mls/route": "nav_msgs/msg/Path",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}


class Told(NamedTuple):
    """A message and when it was told (ns)."""

    time: int
    content: Any


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(make("bridge"), 0.2, seed=2)


def grown(keyframes: Iterable[Keyframe]) -> tuple[SurfaceMap, list[Change]]:
    changes: list[Change] = []
    builder = mlscli.MapBuilder(Parameters().with_cell_size(CELL), follow=changes.append)
    for keyframe in keyframes:
        builder.add(keyframe)
    return builder.finish(), changes


def with_rosbags(path: Path) -> dict[str, list[Told]]:
    told: dict[str, list[Told]] = defaultdict(list)
    with AnyReader([path]) as reader:
        assert {c.topic: c.msgtype for c in reader.connections} == TYPES
        for connection, time, data in reader.messages():
            told[connection.topic].append(Told(time, reader.deserialize(data, connection.msgtype)))
    return told


def with_mcap(path: Path) -> dict[str, list[Told]]:
    """Read with mcap, and with the definitions that the file itself holds."""
    told: dict[str, list[Told]] = defaultdict(list)
    stores: dict[str, Any] = {}
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.name not in stores:
                stores[schema.name] = get_typestore(Stores.EMPTY)
                stores[schema.name].register(get_types_from_msg(schema.data.decode(), schema.name))
            content = stores[schema.name].deserialize_cdr(message.data, schema.name)
            told[channel.topic].append(Told(message.log_time, content))
    return told


READERS = pytest.mark.parametrize("read", [with_rosbags, with_mcap])


def records(cloud: Any) -> Array:
    """Return the points of a cloud by its own description."""
    layout = np.dtype(
        {
            "names": [field.name for field in cloud.fields],
            "formats": [DATATYPES[field.datatype] for field in cloud.fields],
            "offsets": [field.offset for field in cloud.fields],
            "itemsize": cloud.point_step,
        }
    )
    assert len(cloud.data) == cloud.row_step == cloud.width * cloud.point_step
    return np.frombuffer(cloud.data.tobytes(), layout)


def assert_patches(cloud: Any, surface: SurfaceMap, origin: Float64) -> None:
    """Check that a cloud has exactly a map's patches, where they are."""
    points = records(cloud)
    assert cloud.header.frame_id == "mls_map"
    for name in ("ix", "iy", "height", "depth", "variance", "noise", "count", "origin", "moved"):
        assert points[name].tobytes() == getattr(surface, name).tobytes(), name
    mesh = build_mesh(surface, "patches")
    colours = mesh.colours[mesh.points].astype(int)
    assert points["rgb"].tolist() == [r << 16 | g << 8 | b for r, g, b in colours.tolist()]
    place = np.column_stack([points[axis] for axis in "xyz"]) + origin
    centre = (np.column_stack((surface.ix, surface.iy)) + 0.5) * surface.cell_size
    assert np.abs(place - np.column_stack((centre, surface.height))).max(initial=0) < 1e-4


def origin_of(told: dict[str, list[Told]]) -> Float64:
    """Return where the frame of the patches is, which never moves."""
    places = set()
    for message in told["/tf_static"]:
        (transform,) = message.content.transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "mls_map")
        places.add(tuple(xyz(transform.transform.translation).tolist()))
    (place,) = places
    return np.array(place)


def xyz(vector: Any) -> Float64:
    return np.array([vector.x, vector.y, vector.z])


@READERS
def test_after_its_last_message_it_holds_exactly_the_map(
    tmp_path: Path, flight: Flight, read: Any
) -> None:
    surface, changes = grown(flight.keyframes)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = read(tmp_path / "a.mcap")
    assert surface.size > 500
    assert (surface.origin == 2).any()
    assert_patches(told["/mls/patches"][-1].content, surface, origin_of(told))


def test_at_each_time_it_is_the_map_of_the_flight_until_then(
    tmp_path: Path, flight: Flight
) -> None:
    surface, changes = grown(flight.keyframes)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = with_rosbags(tmp_path / "a.mcap")
    clouds = told["/mls/patches"]
    assert len(clouds) > 5
    times = [round(keyframe.stamp * 1e9) for keyframe in flight.keyframes]
    for time, cloud in clouds:
        until = [frame for frame, seen in zip(flight.keyframes, times, strict=True) if seen <= time]
        assert_patches(cloud, grown(until)[0], origin_of(told))
    assert clouds[-1].time == times[-1]


def patch_by_patch() -> SurfaceMap:
    """Return a map of which every keyframe saw one patch more."""
    surface = a_map(*plane(15, 14))
    first = np.random.default_rng(1).permutation(surface.size).astype(np.int32)
    route = np.zeros((surface.size, 4))
    route[:, 0] = np.arange(surface.size) + 1
    return replace(surface, first_keyframe=first, last_keyframe=first, route=route)


def test_no_state_is_more_than_a_sixteenth_of_the_map_behind(tmp_path: Path) -> None:
    surface = patch_by_patch()
    write_replay(tmp_path / "a.mcap", surface, growth(surface))
    clouds = with_mcap(tmp_path / "a.mcap")["/mls/patches"]
    assert [cloud.content.width for cloud in clouds] == [cloud.time // 10**9 for cloud in clouds]
    for seen in range(1, surface.size + 1):
        told = max(cloud.content.width for cloud in clouds if cloud.time <= seen * 10**9)
        assert seen - told < seen / 16
    # Nor is the file as large as all states.
    assert len(clouds) < surface.size / 2


def test_what_comes_late_of_earlier_keyframes_does_not_turn_time_back(tmp_path: Path) -> None:
    surface = patch_by_patch()
    late = [replace(change, route=surface.route[:0]) for change in reversed(list(growth(surface)))]
    late[0] = replace(late[0], route=surface.route)
    write_replay(tmp_path / "a.mcap", surface, late)
    told = with_mcap(tmp_path / "a.mcap")
    assert {cloud.time for cloud in told["/mls/patches"]} == {surface.size * 10**9}
    assert [message.time for message in told["/tf"]] == (surface.route[:, 0] * 10**9).tolist()


def test_what_is_told_goes_to_the_file_and_is_not_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_states, "CHUNK_BYTES", 2**16)
    surface = replace(a_map(*plane(80, 40)), route=np.zeros((40, 4)))
    first = surface.iy.astype(np.int32)
    surface = replace(surface, first_keyframe=first, last_keyframe=first)
    held, written = [], []
    with open_replay(tmp_path / "a.mcap") as replay:
        for change in growth(surface):
            held.append(weakref.ref(change.added))
            replay.follow(change)
            del change
            written.append(sum(file.stat().st_size for file in tmp_path.rglob("*.mcap")))
        assert [alive for alive in held if alive() is not None] == []
        assert len(set(written)) > 3
        replay.finish(surface)
    told = with_mcap(tmp_path / "a.mcap")
    assert_patches(told["/mls/patches"][-1].content, surface, origin_of(told))


def test_a_build_that_fails_leaves_no_replay(tmp_path: Path) -> None:
    def fail() -> None:
        with open_replay(tmp_path / "a.mcap") as replay:
            for change in growth(house()):
                replay.follow(change)
            raise RuntimeError("disk and map are none of its business")

    with pytest.raises(RuntimeError, match="none of its business"):
        fail()
    assert list(tmp_path.iterdir()) == []


@READERS
def test_markers_are_the_mesh(tmp_path: Path, read: Any) -> None:
    surface = house()
    surface = replace(surface, ix=surface.ix + 7000, route=np.full((KEYFRAMES, 4), np.nan))
    write_replay(tmp_path / "a.mcap", surface, growth(surface))
    told = read(tmp_path / "a.mcap")
    mesh = build_mesh(surface)
    corners, colours = [], []
    for name in ("surface", "walls", "artificial"):
        marker = told[f"/mls/{name}"][-1].content
        assert (marker.type, marker.action, marker.header.frame_id) == (11, 0, "mls_map")
        assert marker.color.a == 1
        assert xyz(marker.scale).tolist() == [1, 1, 1]
        assert xyz(marker.pose.position).tolist() == [0, 0, 0]
        assert marker.pose.orientation.w == 1
        assert len(marker.points) == len(marker.colors) > 0
        corners += [xyz(point) + origin_of(told) for point in marker.points]
        colours += [(c.r * 255, c.g * 255, c.b * 255) for c in marker.colors]
        assert all(colour.a == 1 for colour in marker.colors)
    numbered = np.arange(len(corners)).reshape(-1, 3)
    assert soup(np.round(corners, 9), numbered) == soup(np.round(mesh.vertices, 9), mesh.triangles)
    # Each corner has the colour of its vertex.
    found = soup(np.column_stack((np.round(corners, 9), np.rint(colours))), numbered)
    right = np.column_stack((np.round(mesh.vertices, 9), mesh.colours))
    assert found == soup(right, mesh.triangles)


@READERS
def test_a_marker_without_triangles_takes_away_the_one_before(tmp_path: Path, read: Any) -> None:
    surface = a_map(*plane(3, 3))
    write_replay(tmp_path / "a.mcap", surface, growth(surface))
    told = read(tmp_path / "a.mcap")
    for name, action, corners in (("surface", 0, 24), ("walls", 2, 0), ("artificial", 2, 0)):
        marker = told[f"/mls/{name}"][-1].content
        assert (marker.action, len(marker.points), len(marker.colors)) == (action, corners, corners)
        assert (marker.ns, marker.id) == (f"/mls/{name}", 0)
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)


def test_all_but_tf_is_told_also_to_those_who_listen_late(tmp_path: Path) -> None:
    write_replay(tmp_path / "a.mcap", house(), growth(house()))
    with AnyReader([tmp_path / "a.mcap"]) as reader:
        lasting = set()
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            for offered in connection.ext.offered_qos_profiles:
                assert (offered.reliability.name, offered.depth) == ("RELIABLE", 1)
                if offered.durability.name == "TRANSIENT_LOCAL":
                    lasting.add(connection.topic)
    assert lasting == TYPES.keys() - {"/tf"}


def test_who_plays_from_any_time_on_is_told_the_frame_before_what_is_in_it(
    tmp_path: Path, flight: Flight
) -> None:
    surface, changes = grown(flight.keyframes)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = []
    with (tmp_path / "a.mcap").open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            told.append((message.log_time, channel.topic))
    assert told[0] == (flight.keyframes[0].stamp * 10**9, "/tf_static")
    for start in sorted({time for time, topic in told if topic == "/mls/patches"}):
        after = [topic for time, topic in told if time >= start and topic != "/tf"]
        assert after[0] == "/tf_static"


@READERS
def test_the_route_and_the_craft_are_where_they_were(
    tmp_path: Path, flight: Flight, read: Any
) -> None:
    surface, changes = grown(flight.keyframes)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = read(tmp_path / "a.mcap")
    positions = np.array([keyframe.position for keyframe in flight.keyframes])
    transforms = [message.content.transforms[0] for message in told["/tf"]]
    assert np.array([xyz(t.transform.translation) for t in transforms]).tolist() == (
        positions.tolist()
    )
    assert {(t.header.frame_id, t.child_frame_id) for t in transforms} == {("map", "mls_craft")}
    route = told["/mls/route"]
    assert [len(message.content.poses) for message in route] == [
        sum(tf.time <= message.time for tf in told["/tf"]) for message in route
    ]
    passed = [xyz(pose.pose.position) for pose in route[-1].content.poses] + origin_of(told)
    assert np.abs(passed - positions).max() < 1e-9


@READERS
def test_times_are_those_of_the_recording(tmp_path: Path, flight: Flight, read: Any) -> None:
    surface, changes = grown(flight.keyframes)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = read(tmp_path / "a.mcap")
    for messages in told.values():
        for time, content in messages:
            header = (
                content.transforms[0].header if hasattr(content, "transforms") else content.header
            )
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == time
    seen = [message.time for message in told["/tf"]]
    assert seen == [round(keyframe.stamp * 1e3) * 10**6 for keyframe in flight.keyframes]


@pytest.mark.parametrize("stamp", [np.nan, -5.0, 1e12])
def test_a_keyframe_without_a_time_that_ros_can_tell_comes_a_tenth_of_a_second_later(
    tmp_path: Path, stamp: float
) -> None:
    for row, times in ((2, [5, 15, 16, 35, 45, 55, 65]), (0, [1, 2, 3, 4, 5, 6, 7])):
        surface = house()
        route = surface.route.copy()
        route[:, 0] += 0.5
        route[row, 0] = stamp
        surface = replace(surface, route=route)
        write_replay(tmp_path / "a.mcap", surface, growth(surface), overwrite=True)
        told = [message.time for message in with_mcap(tmp_path / "a.mcap")["/tf"]]
        assert told == [time * 10**8 for time in times]


@pytest.mark.parametrize(
    ("stamps", "last"), [([], 10**8), ([np.nan] * 7, 7 * 10**8), (range(7), 6 * 10**9)]
)
def test_nothing_is_at_0_which_is_no_time_to_ros(
    tmp_path: Path, stamps: Sequence[float], last: int
) -> None:
    surface = house()
    route = surface.route[: len(stamps)].copy()
    route[:, 0] = stamps
    surface = replace(surface, route=route)
    write_replay(tmp_path / "a.mcap", surface, growth(surface))
    times = [told.time for messages in with_mcap(tmp_path / "a.mcap").values() for told in messages]
    assert 0 < min(times) <= 10**8
    assert max(times) == last


def test_times_that_run_back_never_do_in_the_file(tmp_path: Path, flight: Flight) -> None:
    stamps = [5.0, 4.0, *range(6, 100)]
    frames = [replace(k, stamp=s) for k, s in zip(flight.keyframes, stamps, strict=False)]
    surface, changes = grown(frames)
    write_replay(tmp_path / "a.mcap", surface, changes)
    told = with_mcap(tmp_path / "a.mcap")
    assert [message.time for message in told["/tf"]][:3] == [5 * 10**9, 5 * 10**9, 6 * 10**9]
    assert_patches(told["/mls/patches"][-1].content, surface, origin_of(told))


def test_far_from_the_origin_nothing_is_lost(tmp_path: Path) -> None:
    surface = house()
    far = replace(surface, ix=surface.ix + 2_000_000, iy=surface.iy - 17_000_000)
    write_replay(tmp_path / "a.mcap", far, growth(far))
    told = with_rosbags(tmp_path / "a.mcap")
    assert_patches(told["/mls/patches"][-1].content, far, origin_of(told))


@pytest.mark.parametrize("cells", [(0, 0, 0), (1_811_000, 20_085_160, 0), (-70, 260, 1528)])
def test_the_origin_of_what_is_drawn_is_in_sight_of_the_map(
    tmp_path: Path, cells: tuple[int, int, int]
) -> None:
    east, north, up = cells
    surface = house()
    size = surface.cell_size
    height = surface.height + up * size
    surface = replace(surface, ix=surface.ix + east, iy=surface.iy + north, height=height)
    write_replay(tmp_path / "a.mcap", surface, growth(surface))
    told = with_mcap(tmp_path / "a.mcap")
    points = records(told["/mls/patches"][0].content)
    middle = np.array([np.median(points[axis]) for axis in "xyz"])
    assert np.abs(middle).max() < 10 * size
    # Whole cells from that of the map frame, so that cells begin at round coordinates in both.
    assert origin_of(told) / size == pytest.approx(np.rint(origin_of(told) / size), abs=1e-6)


def test_what_is_done_in_the_end_is_in_the_last_state(tmp_path: Path, flight: Flight) -> None:
    surface, changes = grown(flight.keyframes)
    finished = surface.take(surface.ix % 5 > 0)
    write_replay(tmp_path / "a.mcap", finished, changes)
    told = with_mcap(tmp_path / "a.mcap")
    assert_patches(told["/mls/patches"][-1].content, finished, origin_of(told))


def test_an_empty_map_is_written_as_such(tmp_path: Path) -> None:
    write_replay(tmp_path / "a.mcap", map_of([]), [])
    told = with_rosbags(tmp_path / "a.mcap")
    assert [message.content.width for message in told["/mls/patches"]] == [0]


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        write_replay(path, house(), [])
    assert path.read_bytes() == b"mine"
    write_replay(path, house(), growth(house()), overwrite=True)
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]
    assert with_mcap(path)["/mls/patches"]
