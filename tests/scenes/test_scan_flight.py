"""Flights over scans: which points are recorded, by which keyframe, from where, with what noise.

Ways to pass without being right: everything is recorded, seen or not; a keyframe finds more than
asked for, or fewer than there are; the same number of features everywhere; a point in two
keyframes; a route through walls or from outside of a room; seeds that are ignored.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import mlscli
import mlscli.runtime.threads
from mlscli.errors import UsageError
from mlscli.keyframes.batches import gather
from mlscli.runtime.arrays import Float64
from mlscli.scenes.discs import sights
from mlscli.scenes.flight import Craft
from mlscli.scenes.free_space import find_places
from mlscli.scenes.noise import Noise
from mlscli.scenes.route import CameraPoses
from mlscli.scenes.scan_flight import ScanFlight, fly_scan
from mlscli.scenes.scan_route import find_route
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Leg, Scatter
from tests.scenes.clouds import level, room, upright

EXACT = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)
ALL = 10**9


def flat(count: int = 4000) -> Scan:
    return Scan.of("flat", level(count, (0, 10), (0, 10), 0.0))


def storeys() -> Scan:
    """Return two rooms, one above the other, on a ground that is larger."""
    lower, upper = room(15, 8, 6, 3), room(15, 8, 6, 3) + np.array([0, 0, 4.0])
    return Scan.of("storeys", np.concatenate((lower, upper, level(3000, (-4, 12), (-4, 10), -1.0))))


def points_of(flight: ScanFlight) -> Float64:
    return gather(flight.keyframes).points.xyz


def rows(points: Float64) -> set[tuple[float, ...]]:
    return set(map(tuple, points.tolist()))


def cameras_of(flight: ScanFlight) -> tuple[Float64, Float64]:
    """Return the points of a flight, and where each was seen from."""
    batch = gather(flight.keyframes)
    return batch.points.xyz, batch.route[batch.points.keyframe, 1:]


# --- what is found ---


def test_all_that_is_seen_is_found_once_by_the_first_keyframe_that_sees_it() -> None:
    scan = storeys().with_legs(Leg((1, 3, 1.5), (7, 3, 1.5), 90), Leg((1, 3, 8), (7, 3, 8)))
    craft = Craft(height=2.0, field_of_view=100.0, range=7.0)
    flight = fly_scan(scan, ALL, EXACT, craft)
    poses = find_route(scan, craft)
    expected: dict[int, list[tuple[float, ...]]] = {}
    seen = sights(scan.xyz, poses.position, 7.0, scan.discs)
    for number, place in enumerate(poses.position):
        away = scan.xyz - place
        ahead = away @ poses.direction[number]
        seen[number] &= ahead >= math.cos(math.radians(50)) * np.linalg.norm(away, axis=1) + 1e-12
    for n in np.flatnonzero(seen.any(axis=0)):
        expected.setdefault(int(seen[:, n].argmax()), []).append(tuple(scan.xyz[n].tolist()))
    found = {
        round(2 * (keyframe.stamp - 1_700_000_000)): rows(keyframe.points)
        for keyframe in flight.keyframes
    }
    assert found == {number: set(points) for number, points in expected.items()}
    assert len(found) > 5
    for keyframe, attitude in zip(flight.keyframes, flight.attitudes, strict=True):
        number = round(2 * (keyframe.stamp - 1_700_000_000))
        assert keyframe.position == tuple(poses.position[number])
        assert attitude.tolist() == poses.attitude[number].tolist()


def test_what_nothing_sees_is_not_recorded_unless_all_points_are_asked_for() -> None:
    ground, cover = level(1500, (0, 10), (0, 10), 0.0), level(2000, (-2, 12), (-2, 12), 1.5, seed=2)
    scan = Scan.of("covered", np.concatenate((ground, cover)))
    found = points_of(fly_scan(scan, ALL, EXACT, survey=True))
    inner = np.abs(found[:, :2] - 5).max(axis=1) < 3
    # Where points lie at random, discs leave gaps.
    assert (found[inner, 2] == 0).mean() < 0.02
    assert (found[:, 2] == 1.5).sum() == len(cover)
    everything = fly_scan(scan, noise=EXACT, survey=True, visibility=False)
    assert rows(points_of(everything)) == rows(scan.xyz)
    xyz, cameras = cameras_of(everything)
    route = gather(everything.keyframes).route[:, 1:]
    nearest = np.linalg.norm(xyz[:, None] - route, axis=2).min(axis=1)
    assert np.linalg.norm(xyz - cameras, axis=1) == pytest.approx(nearest)


@pytest.mark.parametrize("features", [1, 20, 150])
def test_a_keyframe_finds_as_many_features_as_asked_for(features: int) -> None:
    scan = flat()
    # One place, twice: what it finds, it has found before.
    here = scan.with_legs(Leg((5, 5, 3), (5, 5, 3)))
    flight = fly_scan(here, features, EXACT)
    assert [len(keyframe.points) for keyframe in flight.keyframes] == [features]
    # And a way: each sees at most as many, and new ones only where it sees new ground.
    away = scan.with_legs(Leg((3, 5, 2), (7, 5, 2)))
    flight = fly_scan(away, features, EXACT, Craft(height=0.5, field_of_view=60))
    sizes = [len(keyframe.points) for keyframe in flight.keyframes]
    assert sizes[0] == features
    assert max(sizes) == features
    assert features < sum(sizes) < features * (1 + 16 / 2)


def test_features_that_were_found_are_found_again() -> None:
    # Where the second keyframe sees almost the same, it finds almost no others.
    scan = flat().with_legs(Leg((5, 5, 3), (5.02, 5, 3)))
    sizes = [len(k.points) for k in fly_scan(scan, 200, EXACT, Craft(height=2.0)).keyframes]
    assert sizes[0] == 200
    assert sum(sizes[1:]) < 10


def test_more_features_include_the_fewer() -> None:
    few, many = (points_of(fly_scan(flat(), n, EXACT)) for n in (50, 100))
    assert len(few) < len(many)
    assert len(rows(few) - rows(many)) < 0.05 * len(few)


def test_there_are_more_features_at_an_edge_than_on_planes() -> None:
    ground, step = level(9000, (0, 12), (0, 10), 0.0), upright(900, (0, 10), (0, 1), 6.0)
    scan = Scan.of("step", np.concatenate((ground, step))).with_legs(Leg((6, 5, 9), (6, 5, 9)))
    shares = []
    for seed in range(8):
        found = points_of(fly_scan(scan, 300, EXACT, Craft(height=2.0), seed=seed))
        shares.append(np.hypot(found[:, 0] - 6, found[:, 2]) < scan.spacing)
    all_near = np.hypot(scan.xyz[:, 0] - 6, scan.xyz[:, 2]) < scan.spacing
    assert np.mean(np.concatenate(shares)) > 2.5 * all_near.mean()


def test_features_do_not_follow_where_the_scanner_stood() -> None:
    # Left of 5 the scan is nine times as dense.
    both = (level(9000, (0, 5), (0, 10), 0.0), level(1000, (5, 10), (0, 10), 0.0))
    scan = Scan.of("uneven", np.concatenate(both)).with_legs(Leg((5, 5, 9), (5, 5, 9)))
    found = [points_of(fly_scan(scan, 100, EXACT, seed=seed)) for seed in range(10)]
    assert np.mean(np.concatenate(found)[:, 0] < 5) == pytest.approx(0.5, abs=0.06)


def test_features_are_spread_over_the_image() -> None:
    # Ahead and level, most of what is seen lies far away, but near things fill the image.
    scan = flat(8000).with_legs(Leg((0, 5, 1), (0, 5, 1), tilt=70))
    craft = Craft(range=20.0)

    def distance(features: int, seed: int = 0) -> Float64:
        found = points_of(fly_scan(scan, features, EXACT, craft, seed=seed))
        return np.asarray(np.linalg.norm(found[:, :2] - (0, 5), axis=1))

    some = np.concatenate([distance(100, seed) for seed in range(10)])
    assert np.median(some) < 0.6 * np.median(distance(ALL))


def test_holes_have_no_features() -> None:
    whole, holed = (points_of(fly_scan(flat(), ALL, EXACT, holes=h)) for h in ((0, 0.0), (4, 3.0)))
    lost = np.array(sorted(rows(whole) - rows(holed)))
    assert rows(holed) < rows(whole)
    # Four discs of a diameter of 3, some of them beyond the edge or over another.
    assert 0.08 < len(lost) / len(whole) < 4 * math.pi * 1.5**2 / 100


# --- noise ---


def test_both_noises_have_the_spread_asked_for() -> None:
    scan = flat(12000).with_legs(Leg((4, 5, 6), (6, 5, 6)))
    exact, cameras = cameras_of(fly_scan(scan, ALL, EXACT))
    noise = Noise("thesis", Scatter(0.02, 0.05), salt_pepper=0.2)
    moved = points_of(fly_scan(scan, ALL, noise, seed=3)) - exact
    assert moved[:, :2].std() == pytest.approx(0.02, rel=0.05)
    # A fifth of the points have five times the sigma.
    assert moved[:, 2].std() == pytest.approx(0.05 * math.sqrt(0.8 + 0.2 * 25), rel=0.05)
    assert np.median(np.abs(moved[:, 2])) == pytest.approx(0.05 * 0.84, rel=0.08)

    slam = Noise("slam", Scatter(0.02, 0.05), salt_pepper=0.0)
    flight = fly_scan(scan, ALL, slam, seed=3)
    ray = exact - cameras
    far = np.linalg.norm(ray, axis=1)
    ahead = ray / far[:, None]
    moved = points_of(flight) - exact
    along = (moved * ahead).sum(axis=1)
    across = np.linalg.norm(moved - along[:, None] * ahead, axis=1)
    # What is stated holds at the median distance.
    assert flight.range == pytest.approx(np.median(far))
    relative = far / flight.range
    assert relative.max() > 1.3
    assert (along / relative**2).std() == pytest.approx(0.05, rel=0.05)
    assert np.sqrt(np.mean((across / relative) ** 2) / 2) == pytest.approx(0.02, rel=0.05)
    far_ones = relative > 1.15
    assert along[far_ones].std() > 1.3 * along[~far_ones].std()
    # Or at the distance that is asked for.
    other = points_of(fly_scan(scan, ALL, Noise("slam", slam.sigma, 0.0, reference=2.0), seed=3))
    error = ((other - exact) * ahead).sum(axis=1)
    assert (error / (far / 2) ** 2).std() == pytest.approx(0.05, rel=0.05)


def test_outliers_are_at_any_height_of_the_scan() -> None:
    ground, tower = level(4000, (0, 10), (0, 10), 0.0), upright(900, (4, 6), (0, 8), 5.0)
    scan = Scan.of("tower", np.concatenate((ground, tower)))
    scan = scan.with_legs(Leg((2, 5, 9), (8, 5, 9)))
    noise = Noise(sigma=Scatter(0, 0), salt_pepper=0.0, outliers=0.3)
    exact, found = points_of(fly_scan(scan, ALL, EXACT)), points_of(fly_scan(scan, ALL, noise))
    gross = (exact != found).any(axis=1)
    assert gross.mean() == pytest.approx(0.3, abs=0.03)
    quarters = np.quantile(found[gross, 2], (0, 0.25, 0.5, 0.75, 1))
    top = tower[:, 2].max()
    assert quarters == pytest.approx(top * np.array([0, 0.25, 0.5, 0.75, 1]), abs=0.4)


def test_a_seed_gives_the_same_flight_whatever_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    scan = Scan.of("room", room(12, 6, 4, 3))
    noise = Noise("slam", outliers=0.05)
    flights = []
    for processors, seed in ((1, 7), (3, 7), (1, 8)):
        monkeypatch.setattr(mlscli.runtime.threads, "processors", lambda n=processors: n)
        flight = fly_scan(scan, 40, noise, seed=seed, holes=(2, 0.5))
        batch = gather(flight.keyframes)
        flights.append(
            (batch.points.xyz.tobytes(), batch.route.tobytes(), flight.attitudes.tobytes())
        )
    assert flights[0] == flights[1]
    assert flights[0][0] != flights[2][0]


# --- the route ---


def test_an_open_scan_is_surveyed_in_lanes_above_its_top() -> None:
    scan = Scan.of("open", level(8000, (0, 40), (0, 10), 3.0))
    flight = fly_scan(scan, ALL)
    positions = gather(flight.keyframes).route[:, 1:]
    assert positions[:, 2] == pytest.approx(scan.bounds[1][2] + scan.usual_height)
    assert flight.seen == 1
    assert flight.points == len(scan.xyz)
    lower = fly_scan(scan, ALL, craft=Craft(height=1.0))
    assert gather(lower.keyframes).route[:, 3] == pytest.approx(scan.bounds[1][2] + 1.0)


def test_below_a_table_is_not_indoors_though_all_is_seen_from_there() -> None:
    table = (level(2000, (0, 10), (0, 8), 0.0), level(400, (3, 7), (2, 6), 2.0))
    poses = find_route(Scan.of("table", np.concatenate(table)), Craft(height=3.0))
    assert (poses.position[:, 2] == 5.0).sum() > 20


def test_a_room_is_flown_through_within_and_all_of_it_is_seen() -> None:
    scan = Scan.of("room", room(20, 8, 6, 3))
    flight = fly_scan(scan, ALL, EXACT)
    positions = gather(flight.keyframes).route[:, 1:]
    assert (positions > 0.2).all()
    assert (positions < (7.8, 5.8, 2.8)).all()
    assert flight.seen > 0.99
    assert flight.points > 0.98 * len(scan.xyz)


def test_every_storey_is_flown_through_and_nothing_below_the_ground() -> None:
    flight = fly_scan(storeys(), 50, EXACT)
    positions = gather(flight.keyframes).route[:, 1:]
    inside = positions[((positions[:, :2] > 0) & (positions[:, :2] < (8, 6))).all(axis=1)]
    for low, high in ((0.0, 3.0), (4.0, 7.0)):
        assert ((inside[:, 2] > low + 0.2) & (inside[:, 2] < high - 0.2)).sum() > 10
    assert positions[:, 2].min() > 0
    assert flight.seen > 0.97


def test_no_survey_stays_within_and_a_survey_comes_first_if_asked_for() -> None:
    craft = Craft()

    def heights(survey: bool | None) -> Float64:
        return find_route(storeys(), craft, survey).position[:, 2]

    top = storeys().bounds[1][2]
    assert heights(False).max() <= top
    above = heights(True) > top
    assert above[0]
    assert 20 < above.sum() < len(above) - 20
    with pytest.raises(UsageError, match=r"flat: found no place within it .* `survey`"):
        find_route(flat(), craft, False)


def test_ways_through_space_do_not_pass_through_anything() -> None:
    # Two rooms with a door between them.
    wall = upright(4000, (0, 6), (0, 3), 4.0, seed=8)
    door = (np.abs(wall[:, 1] - 3) < 0.7) & (wall[:, 2] < 2.4)
    scan = Scan.of("door", np.concatenate((room(60, 8, 6, 3), wall[~door])))
    places = find_places(scan)
    a, b = places.ways.nonzero()
    assert len(a) > 100
    straight = sights(places.position, places.position, 99.0, scan.discs)
    assert straight[a, b].all()
    left = places.position[:, 0] < 4
    through = left[a] != left[b]
    assert through.any()
    poses = find_route(scan, Craft())
    assert 0.2 < np.mean(poses.position[:, 0] < 4) < 0.8
    steps = np.linalg.norm(np.diff(poses.position, axis=0), axis=1)
    # In one go, but for the steps to and from the rings.
    assert steps.max() < 1.5


def test_a_route_by_hand_is_flown_alone_or_after_a_survey() -> None:
    legs = (Leg((1, 3, 1.5), (7, 3, 1.5), 80, 90), Leg((7, 3, 1.5), (7, 4, 1.5)))
    scan = storeys().with_legs(*legs)
    alone: CameraPoses = find_route(scan, Craft(height=2.0))
    assert alone.position[[0, 6]].tolist() == [[1, 3, 1.5], [7, 3, 1.5]]
    assert np.linalg.norm(np.diff(alone.position[:7], axis=0), axis=1) == pytest.approx(1.0)
    assert np.degrees(alone.tilt[:7]) == pytest.approx(80)
    both = find_route(scan, Craft(height=2.0), True)
    assert np.array_equal(both.position[-len(alone.tilt) :], alone.position)
    assert both.position[0, 2] == scan.bounds[1][2] + 2.0


def test_a_real_airborne_scan_is_seen_from_above(shared_data: Path) -> None:
    path = shared_data / "multilevel" / "als_bridge_samp21.pcd"
    scan = Scan.of("bridge", gather(mlscli.open_recording(path).keyframes()).points.xyz)
    flight = fly_scan(scan, 100, EXACT)
    assert flight.seen > 0.98
    assert rows(points_of(flight)) < rows(scan.xyz)
    assert 400 < flight.points < 2000
    low, high = scan.bounds
    positions = gather(flight.keyframes).route[:, 1:]
    assert positions[:, 2] == pytest.approx(high[2] + scan.usual_height)
    assert (positions[:, :2].min(axis=0) < low[:2]).all()
    assert (positions[:, :2].max(axis=0) > high[:2]).all()


# --- what is refused ---


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"features": 0}, "`features` 0: expected 1 or more"),
        ({"craft": Craft(height=0.0)}, "`route_height` 0"),
        ({"craft": Craft(height=math.nan)}, "`route_height` nan"),
        ({"craft": Craft(height=1e-4)}, "`route_height` 0.0001: so low over flat"),
        ({"craft": Craft(field_of_view=361.0)}, "`field_of_view` 361"),
        ({"craft": Craft(range=-1.0)}, "`range` -1"),
        ({"craft": Craft(range=0.01)}, "sees nothing"),
        ({"noise": Noise(outliers=0.1)}, "flat is flat"),
        ({"noise": Noise("slam", reference=0.0)}, "`reference` 0: expected a distance above 0"),
        ({"noise": Noise(reference=2.0)}, "`reference` 2: goes with noise slam"),
        ({"holes": (-1, 0.5)}, "`holes` -1,0.5"),
        ({"seed": -1}, "`seed` -1"),
    ],
)
def test_values_out_of_range_are_refused_by_name(options: dict[str, object], named: str) -> None:
    with pytest.raises(UsageError) as caught:
        fly_scan(flat(1000), **options)  # type: ignore[arg-type]
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_route_of_too_many_keyframes_is_refused() -> None:
    scan = flat(1000).with_legs(Leg((0, 0, 1), (1e6, 0, 1)))
    with pytest.raises(UsageError, match=r"`route_height` 0\.5: keyframes half of it apart"):
        fly_scan(scan, craft=Craft(height=0.5))
