"""Views in an MCAP file, read back by rosbags, and as a plan of QGroundControl.

How one could cheat: to write places and not where the camera looks; to turn headings the wrong way
round; to take a degree for the same length everywhere; to leave the cells out that are uncertain.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from mlscli.errors import UsageError
from mlscli.io.writing.explored import KIND_COLOURS, drawing, write_explored
from mlscli.io.writing.plan import OnEarth, Origin, write_plan
from mlscli.maps.georeference import Georeference
from mlscli.queries.exploration import Camera, Exploration
from mlscli.queries.explore import explore
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import CELL, map_of
from tests.queries.test_explore import yard


def found() -> Exploration:
    return explore(yard(), 0.5, 0.5, most=4)


def directions(yaw: Float64, tilt: Float64) -> Float64:
    turn, up = np.radians(yaw), np.radians(tilt)
    return np.column_stack((np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), -np.cos(up)))


def test_the_way_its_views_and_the_uncertain_cells_are_read_back(tmp_path: Path) -> None:
    right = found()
    write_explored(tmp_path / "views.mcap", right, "world", CELL)
    with AnyReader([tmp_path / "views.mcap"]) as reader:
        read: dict[str, Any] = {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }
    poses = [pose.pose for pose in read["/mls/explore"].poses]
    position, yaw, tilt = right.way()
    places = [(p.position.x, p.position.y, p.position.z) for p in poses]
    np.testing.assert_array_equal(places, position)
    turns = [(q.x, q.y, q.z, q.w) for q in (pose.orientation for pose in poses)]
    looks = Rotation.from_quat(turns).apply([0.0, 0.0, -1.0])
    assert looks == pytest.approx(directions(yaw, tilt), abs=1e-12)
    stamps = [pose.header.stamp.sec for pose in read["/mls/explore"].poses]
    assert stamps == sorted(stamps)
    marker = read["/mls/explore_views"]
    assert (marker.type, marker.header.frame_id) == (5, "world")
    shown = drawing(right)
    ends = np.array([[point.x, point.y, point.z] for point in marker.points]).reshape(-1, 2, 3)
    np.testing.assert_array_equal(ends, shown.vertices[shown.ends])
    for view in right.views:
        to = (view.place, right.regions[view.region].middle)
        assert (ends == np.array(to)).all(axis=(1, 2)).any()
    cloud = read["/mls/explore_cells"]
    assert cloud.width == len(right.uncertain.kind)
    fields = {field.name: field.offset for field in cloud.fields}
    rows = np.frombuffer(cloud.data.tobytes(), dtype=np.uint8).reshape(cloud.width, -1)
    assert rows[:, fields["kind"]].tolist() == right.uncertain.kind.tolist()
    xyz = np.ascontiguousarray(rows[:, :12]).view("<f4")
    np.testing.assert_allclose(xyz, right.uncertain.places(CELL), atol=1e-5)


def test_the_rim_of_a_view_has_its_field_of_view_and_its_kind() -> None:
    right = explore(yard(), 0.5, 0.5, Camera(80.0, 8.0), most=1)
    shown, view = drawing(right), right.views[0]
    of_view = shown.vertices[1 + 3 :]
    corners = of_view[2:] - of_view[0]
    cosine = corners @ directions(np.array([view.yaw]), np.array([view.tilt]))[0]
    angles = np.degrees(np.arccos(cosine / np.linalg.norm(corners, axis=1)))
    assert angles == pytest.approx(40.0)
    kind = right.regions[view.region].kind
    assert (shown.colours[1 + 3 :] == KIND_COLOURS[kind]).all()


def on_earth(latitude: float, longitude: float, altitude: float) -> Float64:
    """Return a place in axes that turn with the Earth, from the definition of WGS84."""
    flat = 1 / 298.257223563
    square = flat * (2 - flat)
    up, east = math.radians(latitude), math.radians(longitude)
    bend = 6378137.0 / math.sqrt(1 - square * math.sin(up) ** 2)
    level = (bend + altitude) * math.cos(up)
    return np.array([level * math.cos(east), level * math.sin(east),
                     (bend * (1 - square) + altitude) * math.sin(up)])  # fmt: skip


@pytest.mark.parametrize("latitude", [-33.0, 0.0, 47.4])
def test_a_plan_leads_to_the_places_and_looks_where_the_views_do(
    latitude: float, tmp_path: Path
) -> None:
    right, origin = found(), Origin(latitude, 8.5, 400.0)
    write_plan(tmp_path / "views.plan", right, origin)
    plan = json.loads((tmp_path / "views.plan").read_text())
    assert (plan["fileType"], plan["version"], plan["mission"]["version"]) == ("Plan", 1, 2)
    items = plan["mission"]["items"]
    assert [item["doJumpId"] for item in items] == list(range(1, len(items) + 1))
    mounts, waypoints = items[::2], items[1::2]
    assert {item["command"] for item in mounts} == {205}
    assert {(item["command"], item["frame"], item["AltitudeMode"]) for item in waypoints} == {
        (16, 0, 2)
    }
    position, yaw, tilt = right.way()
    assert [item["params"][0] for item in mounts] == pytest.approx(tilt - 90)
    # A compass turns from north towards east.
    heading = np.radians([item["params"][3] for item in waypoints])
    assert np.sin(heading) == pytest.approx(np.cos(np.radians(yaw)), abs=1e-9)
    assert np.cos(heading) == pytest.approx(np.sin(np.radians(yaw)), abs=1e-9)
    begin = on_earth(*origin)
    up = on_earth(latitude, 8.5, 401.0) - begin
    north = on_earth(latitude + 1e-6, 8.5, 400.0) - begin
    north /= np.linalg.norm(north)
    axes = np.stack((np.cross(north, up), north, up))
    for item, place in zip(waypoints, position, strict=True):
        off = axes @ (on_earth(*item["params"][4:]) - begin)
        assert off == pytest.approx(place, abs=0.02)
        assert item["Altitude"] == item["params"][6]


def test_a_map_in_a_projection_is_flown_to_in_degrees_and_by_true_north(tmp_path: Path) -> None:
    pyproj = pytest.importorskip("pyproj")
    right = found()
    # In a corner of its zone, where its north is 2 degrees off, heights in feet of its own.
    offset = (690_000.0, 5_250_000.0, 500.0)
    place = OnEarth(Georeference("EPSG:32632+6360", offset))
    write_plan(tmp_path / "views.plan", right, place)
    items = json.loads((tmp_path / "views.plan").read_text())["mission"]["items"][1::2]
    back = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    position, yaw, _ = right.way()
    for item, (x, y, z), turn in zip(items, position.tolist(), yaw.tolist(), strict=True):
        latitude, longitude, altitude = item["params"][4:]
        at = back.transform(longitude, latitude)
        assert at == pytest.approx((x + offset[0], y + offset[1]), abs=1e-5)
        assert altitude == pytest.approx((z + 500) * 1200 / 3937)
        geod, heading = pyproj.Geod(ellps="WGS84"), item["params"][3]
        ahead = back.transform(*geod.fwd(longitude, latitude, heading, 1.0)[:2])
        drawn = math.degrees(math.atan2(ahead[1] - at[1], ahead[0] - at[0]))
        assert (drawn - turn + 180) % 360 - 180 == pytest.approx(0, abs=1e-4)
        assert abs((heading - (90 - turn) + 180) % 360 - 180) > 1.5
    with pytest.raises(UsageError, match="no lengths on a plane"):
        OnEarth(Georeference("EPSG:4326")).at(8.0, 47.0, 0.0)


def test_what_no_plan_can_say_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^`origin` 95,8: expected degrees of latitude"):
        write_plan(tmp_path / "views.plan", found(), Origin(95.0, 8.0, 0.0))
    with pytest.raises(UsageError, match=r"is farther than 10,000 m from the origin of the map"):
        Origin(47.0, 8.0, 0.0).at(465_000.0, 5_247_000.0, 500.0)
    nothing = explore(map_of([]), 0.5, 0.5, Camera(range=5.0))
    with pytest.raises(UsageError, match="no view was found"):
        write_plan(tmp_path / "views.plan", nothing, Origin(47.0, 8.0, 0.0))
    assert not list(tmp_path.iterdir())
