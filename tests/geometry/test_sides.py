"""Which way along a vertical is up.

How these tests could be cheated: by counting points, by custom where the axis is z; by a rule that
favours one of the two directions of an axis. So ceilings have more points than floors, axes are at
any angle, and all is turned over.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.sides import Reason, Scene, customary, decide
from mlscli.geometry.surroundings import all_planes
from mlscli.runtime.arrays import Float64

TURN = Rotation.from_euler("xyz", [100, 40, -70], degrees=True)


def level(rng: np.random.Generator, size: float, height: float, count: int) -> Float64:
    return np.column_stack((rng.uniform(0, size, (count, 2)), np.full(count, height)))


def scene(points: Float64, up: tuple[float, float, float] = (0, 0, 1)) -> Scene:
    """Return points with z up, turned, seen along their vertical."""
    return Scene(all_planes(TURN.apply(points)), TURN.apply(np.array(up, dtype=float)))


def both(points: Float64, route: Float64 | None = None) -> tuple[float, float]:
    """Return the weights of route and scene, and check that they turn over with the axis."""
    seen, upside_down = scene(points), scene(points, (0, 0, -1))
    flown = None if route is None else TURN.apply(route)
    weights = (seen.flown(flown).weight, seen.lies().weight)
    others = (upside_down.flown(flown).weight, upside_down.lies().weight)
    np.testing.assert_allclose(others, np.negative(weights), atol=0.35)
    return weights


def hall(rng: np.random.Generator, below: int, above: int) -> Float64:
    return np.concatenate((level(rng, 8, 0, below), level(rng, 8, 3, above)))


ALONG = np.column_stack((np.linspace(1, 7, 20), np.full(20, 4.0), np.full(20, 1.0)))


@pytest.mark.parametrize(("below", "above"), [(600, 4000), (4000, 600), (3000, 3000)])
def test_a_ceiling_is_not_a_floor_because_it_was_seen_better(below: int, above: int) -> None:
    flown, lies = both(hall(np.random.default_rng(1), below, above), ALONG)

    assert abs(flown) < 0.35
    assert abs(lies) < 0.35


def test_a_floor_that_was_hardly_seen_is_one_all_the_same() -> None:
    # One point in a hundred: alone, the ceiling would lie above all of the flight.
    rng = np.random.default_rng(7)
    seen, alone = (both(hall(rng, count, 4000), ALONG) for count in (60, 0))

    assert alone[0] < -2
    assert all(weight > -0.9 for weight in seen)


def test_few_level_surfaces_among_many_others_are_level_by_chance() -> None:
    rng = np.random.default_rng(8)
    walls = level(rng, 20, 0, 8000)[:, [0, 2, 1]]
    ledge = level(rng, 1.5, 19, 150) * (1, 0.3, 1)

    flown, lies = both(np.concatenate((walls, ledge)), np.add(ALONG, (0, -8, 9)))

    assert abs(flown) < 0.5
    assert abs(lies) < 0.8


def test_scene_and_flight_look_at_the_same_surfaces_and_together_count_no_more() -> None:
    rng = np.random.default_rng(9)
    trees = np.column_stack((rng.uniform(1, 7, (900, 2)), rng.exponential(0.5, 900)))
    seen = scene(np.concatenate((level(rng, 8, 0, 4000), trees)))
    route = TURN.apply(np.add(ALONG, (0, 0, 15)))

    apart = seen.flown(route).weight + seen.lies().weight
    together = sum(reason.weight for reason in seen.reasons(route))

    assert apart > 3.5
    assert together == pytest.approx(2.5)


def test_a_craft_outside_of_all_that_it_saw_is_above_it() -> None:
    rng = np.random.default_rng(2)
    roofs = np.concatenate((level(rng, 3, 4, 2000), level(rng, 10, 0, 1000)))
    flown, _ = both(roofs, np.add(ALONG, (0, 0, 9)))

    assert flown > 2
    # Where it was is not known of some poses.
    some = np.where(np.arange(20)[:, None] % 3 == 0, np.nan, np.add(ALONG, (0, 0, 9)))
    assert both(roofs, some)[0] > 2


def test_a_scanner_whose_beams_are_level_is_neither_above_nor_below_what_it_sees() -> None:
    # It is mounted a little above the pose that is told.
    turn = np.linspace(0, 2 * np.pi, 3000)
    walls = np.column_stack((9 * np.cos(turn), 9 * np.sin(turn), np.full(3000, 0.05)))
    walls += np.random.default_rng(3).normal(0, 0.01, walls.shape)
    flown, lies = both(walls, np.zeros((5, 3)))

    assert abs(flown) < 0.1
    assert abs(lies) < 0.1


def test_what_stands_on_the_ground_tells_its_side() -> None:
    rng = np.random.default_rng(4)
    trees = np.column_stack((rng.uniform(1, 19, (900, 2)), rng.exponential(1.0, 900)))
    _, lies = both(np.concatenate((level(rng, 20, 0, 4000), trees)))

    assert lies > 1.5


def test_where_nothing_is_known_to_be_level_the_smoother_side_is_the_ground() -> None:
    rng = np.random.default_rng(5)
    ground = level(rng, 20, 0, 6000) + rng.normal(0, 0.3, (6000, 3)) * (0, 0, 1)
    crowns = rng.uniform(0, 20, (150, 2))
    trees = np.concatenate([np.append(c, 5) + rng.normal(0, 0.8, (20, 3)) for c in crowns])
    seen = scene(np.concatenate((ground, trees)))

    assert seen.lies().weight > 0.4
    assert "smoother below" in seen.lies().why


def test_custom_has_z_up_and_y_down_and_says_nothing_of_other_axes() -> None:
    def weight(*axis: float) -> float:
        direction = np.array(axis) / np.linalg.norm(axis)
        assert customary(-direction).weight == -customary(direction).weight
        return customary(direction).weight

    tilted_y, plumb_y = weight(0, -1, 0.3), weight(0, -1, 0.01)
    assert weight(0, 0.2, 1) == weight(0, 0, 1) > tilted_y > plumb_y > 0
    assert weight(1, 0, 0) == weight(0, 1, 1) == weight(0.9, -0.5, 0) == 0


def test_the_sum_of_the_reasons_decides_and_the_weightiest_are_told_first() -> None:
    reasons = [Reason(1.0, "A"), Reason(-2.0, "B"), Reason(1.5, "C"), Reason(0.2, "D")]

    for sign in (1, -1):
        total, why = decide([Reason(sign * weight, words) for weight, words in reasons])
        assert total == pytest.approx(sign * 0.7)
        assert why == "C, and A; for the opposite speaks that B"


def test_a_sum_that_is_small_is_not_certain() -> None:
    for sign in (1, -1):
        total, why = decide([Reason(sign * 1.4, "A"), Reason(sign * -1.1, "B")])
        assert total == pytest.approx(sign * 0.3)
        assert why.startswith("A; for the opposite speaks that B")
        assert why.endswith("is not certain")


@pytest.mark.parametrize(
    "reasons", [[], [Reason(0.0, "A")], [Reason(0.05, "A")], [Reason(1.0, "A"), Reason(-1.0, "B")]]
)
def test_no_evidence_decides_nothing_and_says_so(reasons: list[Reason]) -> None:
    total, why = decide(reasons)

    assert total == 0
    assert "which way along it is up is not known" in why
