"""Where to fly next.

How one could cheat: to list views from which nothing is seen, so what each settles is counted anew
by loops; to put one inside of a wall, or where the craft does not fit; to list the same cells for
several views; to call the edge of the world a hole; to leave out what the map does not know.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import mlscli
from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.errors import UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import unpack
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.queries.clearance import FITS, clearance
from mlscli.queries.exploration import FREE, HIGH, Camera, Exploration
from mlscli.queries.explore import explore
from mlscli.queries.sights import Hiding, in_sight
from mlscli.queries.uncertain import EDGE, HOLE, RED, UNSEEN, uncertain
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import floor
from mlscli.scenes.route import CameraPoses
from mlscli.scenes.surfaces import Scatter, Scene
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of

EXACT = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)
ROUTE = np.linspace((0.0, -5.0, -5.0, 6.0), (6.0, 5.0, 5.0, 6.0), 7)


def yard(*, seen: bool = True, refuted: int = -12) -> SurfaceMap:
    """Return a yard with a hole, a red corner, and a roof with a wall along its west.

    All was seen but what is under the roof. Up to the column `refuted`, the red was looked through.
    """
    patches: list[Patch] = []
    lines: dict[tuple[int, int, int], int] = {}
    for ix in range(-12, 12):
        for iy in range(-12, 12):
            under = ix in range(4, 10) and iy in range(-4, 4)
            wall = ix == 4 and under
            if ix in range(-8, -4) and iy in range(-8, -4):
                continue
            if wall:
                patches.append(Patch(ix, iy, 3.0, 3.0, 0, 9))
            elif under:
                patches += [Patch(ix, iy, 3.0, 0.0, 0, 9), Patch(ix, iy, 0.0, 0.0, 0, 9)]
            else:
                red = ix < -7 and iy > 7
                patches.append(Patch(ix, iy, 0.0, 0.0, 2 if red else 0, 0 if red else 9))
                lines |= {(ix, iy, iz): 2 for iz in (-1, 0) if red and ix < refuted}
            lines |= {(ix, iy, iz): 2 for iz in range(13 if under else 1, 30)}
    return replace(map_of(patches), free=free_space_of(lines if seen else {}), route=ROUTE)


def cells_of(found: Exploration, kind: int) -> set[tuple[int, int]]:
    ix, iy = unpack(found.uncertain.key[found.uncertain.kind == kind])
    return set(zip(ix.tolist(), iy.tolist(), strict=True))


def test_each_kind_of_uncertainty_is_where_it_is() -> None:
    found = explore(yard(), 0.5, 0.5)
    assert cells_of(found, RED) == {(ix, iy) for ix in range(-12, -7) for iy in range(8, 12)}
    hole = {(ix, iy) for ix in range(-8, -4) for iy in range(-8, -4)}
    # Of a hole those beside the map; the rest is seen with them.
    assert cells_of(found, HOLE) == hole - {(-7, -7), (-7, -6), (-6, -7), (-6, -6)}
    assert cells_of(found, UNSEEN) == {(ix, iy) for ix in range(5, 10) for iy in range(-4, 4)}
    assert len(cells_of(found, EDGE)) == 4 * 24
    assert found.cells == (20, 12, 40, 96)


def test_red_that_sight_lines_refute_is_settled() -> None:
    found = explore(yard(refuted=-9), 0.5, 0.5)
    assert cells_of(found, RED) == {(ix, iy) for ix in (-9, -8) for iy in range(8, 12)}


def test_views_see_what_they_say_and_are_reached_without_meeting_anything() -> None:
    surface = yard()
    found = explore(surface, 0.5, 0.5, Camera(90.0, 8.0))
    place, hiding = found.uncertain.places(CELL), Hiding.of(surface, 2)
    waiting = set(range(len(place)))
    for view in found.views:
        turn, up = math.radians(view.yaw), math.radians(view.tilt)
        axis = (math.sin(up) * math.cos(turn), math.sin(up) * math.sin(turn), -math.cos(up))
        seen = set()
        for n in waiting:
            off = place[n] - view.place
            far = np.linalg.norm(off)
            if far <= 8.0 and off @ axis >= math.cos(math.radians(45)) * far:
                lines = in_sight(hiding, CELL, np.array([view.place]), place[n : n + 1], 8.0)
                seen |= {n} if lines.all() else set()
        counts = np.bincount(found.uncertain.kind[sorted(seen)], minlength=4)
        assert view.sees == tuple(counts.tolist())
        waiting -= seen
        way = np.array([(*view.place[:2], max(found.safe, view.place[2])), view.place])
        assert view.way == HIGH or clearance(surface, way, 0.5, 0.5).overall == FITS
        assert view.place[2] >= found.safe or view.way == FREE
        assert view.ground == pytest.approx(view.place[2] - (3.0 if near_roof(view.place) else 0.0))
    assert not {found.uncertain.kind[n] for n in waiting} & {RED, HOLE, UNSEEN}
    kinds = [found.regions[view.region].kind for view in found.views]
    assert EDGE not in kinds[: kinds.index(EDGE)]
    assert found.safe == 3.0 + 2 * 0.5


def near_roof(place: tuple[float, float, float]) -> bool:
    x, y, z = place
    return 2.0 <= x < 5.0 and -2.0 <= y < 2.0 and z > 3.0


def test_a_look_under_a_roof_comes_from_its_open_sides() -> None:
    found = explore(yard(), 0.5, 0.5)
    under = next(view for view in found.views if view.sees[UNSEEN] > 20)
    x, y, _ = under.place
    # Beside the roof, and not beyond the wall at its west.
    assert x > 2.5
    assert x >= 5.0 or abs(y) >= 2.0
    assert under.tilt > 45


def test_the_way_begins_at_the_end_of_the_route_and_goes_up_between_views() -> None:
    found = explore(yard(), 0.5, 0.5, most=3)
    assert found.begin == (5.0, 5.0, 6.0)
    position, yaw, tilt = found.way()
    assert len(position) == 9
    for n, view in enumerate(found.views):
        assert tuple(position[3 * n + 1]) == view.place
        assert (yaw[3 * n + 1], tilt[3 * n + 1]) == (view.yaw, view.tilt)
        for between in (3 * n, 3 * n + 2):
            assert position[between, 2] == max(found.safe, view.place[2])
            assert tuple(position[between, :2]) == view.place[:2]
            assert tilt[between] == 0
    legs = np.diff(np.vstack((found.begin, position)), axis=0)
    assert found.length == pytest.approx(np.linalg.norm(legs, axis=1).sum())
    assert explore(yard(), 0.5, 0.5, most=1).views == found.views[:1]


def test_a_view_does_not_stand_where_the_craft_does_not_fit() -> None:
    # A second wall in front of the open side, three cells away: wide crafts stay out of between.
    surface = yard()
    wall = map_of([Patch(13, iy, 4.0, 4.0, 0, 9) for iy in range(-12, 12)])
    both = replace(surface.union(wall), free=surface.free, route=ROUTE)
    for width in (0.3, 3.0):
        for view in explore(both, width, 0.5).views:
            x, _, z = view.place
            assert z >= 4.0 or x + width / 2 <= 6.5 + 1e-9 or x - width / 2 >= 7.0 - 1e-9


def test_a_flight_along_the_views_looks_into_what_was_not_seen() -> None:
    scene = floor(floor(Scene("deck"), (-4, 4), (-4, 4), 0.0), (-2, 2), (-2, 2), 2.0)
    first = fly(scene, 0.2, EXACT).keyframes
    before = explore(mapped(first), 0.3, 0.3)
    position, yaw, tilt = before.way()
    route = CameraPoses(position, np.radians(yaw), np.radians(tilt))
    second = fly(scene, 0.2, EXACT, seed=1, route=route, anew=True).keyframes
    assert {keyframe.position for keyframe in second} <= set(map(tuple, position.tolist()))
    after = explore(mapped([*first, *second]), 0.3, 0.3)
    assert before.cells[UNSEEN] > 40
    assert after.cells[UNSEEN] < before.cells[UNSEEN] / 2


def mapped(keyframes: list[Keyframe]) -> SurfaceMap:
    parameters = Parameters().with_cell_size(0.25).with_free_space()
    builder = MapBuilder(settled(parameters, keyframes, Report()))
    for keyframe in keyframes:
        builder.add(keyframe)
    return builder.finish()


def test_without_free_space_nothing_is_said_of_space() -> None:
    found = explore(replace(yard(), free=None), 0.5, 0.5)
    assert found.cells == (20, 12, 0, 96)
    assert {view.way for view in found.views} <= {HIGH, 2}


def test_regions_are_no_wider_than_a_look_and_small_ones_are_left_out() -> None:
    found = uncertain(yard(), 2.0)
    for region in range(int(found.region.max()) + 1):
        own = found.region == region
        ix, iy = unpack(found.key[own])
        assert np.ptp(ix) < 4
        assert np.ptp(iy) < 4
        assert len(set(found.kind[own].tolist())) == 1
        assert own.sum() >= 4
    three = map_of([Patch(ix, 0, 0.0, 0.0, 2, 0) for ix in range(3)])
    assert RED not in uncertain(three, 2.0).kind
    far = [Patch(ix, 0, height, 0.0, 2, 0) for ix in range(3) for height in (0.0, 5.0)]
    assert RED not in uncertain(map_of(far), 9.0).kind


def test_a_camera_that_stood_low_sees_by_default_what_it_has_measured() -> None:
    facade = map_of([Patch(20, iy, 9.0, 9.0, 0, 4) for iy in range(-9, 9)])
    low = replace(facade, route=np.array([[0.0, 0.25, 0.25, 0.5]]))
    far = Camera().settled(low).reach
    assert 12 < far < 16


def test_the_camera_sees_by_default_as_far_as_that_of_a_synthetic_flight() -> None:
    assert explore(yard(), 0.5, 0.5).camera == Camera(120.0, 12.0)
    with pytest.raises(UsageError, match=r"^`range`: say .*; the map does not tell how high the "):
        explore(replace(yard(), route=ROUTE * np.nan), 0.5, 0.5)


def test_an_empty_map_has_nothing_to_look_at() -> None:
    found = mlscli.explore(map_of([]), 0.5, 0.5, Camera(range=5.0))
    assert (found.views, found.regions, found.length) == ((), (), 0.0)


@pytest.mark.parametrize(
    ("camera", "fault"),
    [
        (Camera(0.0), "`field_of_view` 0: expected above 0, at most 180 degrees"),
        (Camera(math.nan), "`field_of_view` nan: expected above 0, at most 180 degrees"),
        (Camera(90.0, 0.5), "`range` 0.5: expected more than a cell, 0.5"),
        (Camera(90.0, math.inf), "`range` inf: expected more than a cell, 0.5"),
    ],
)
def test_other_cameras_are_refused(camera: Camera, fault: str) -> None:
    with pytest.raises(UsageError) as refused:
        explore(yard(), 0.5, 0.5, camera)
    assert str(refused.value) == fault


def test_a_map_with_a_stray_level_far_above_is_refused() -> None:
    stray = map_of([Patch(0, 0, 1e6, 0.0, 0, 1), *(Patch(ix, 0, 0, 0, 2, 0) for ix in range(9))])
    with pytest.raises(UsageError, match=r"^the map reaches from z 0 to 1e\+06, 2e\+06 cells; "):
        explore(stray, 0.5, 0.5, Camera(range=5.0))
