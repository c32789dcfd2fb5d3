"""How far apart distinct points lie.

How one could cheat: count equal points only, and not those a little off; take what lies far out for
clusters; see clusters in every cloud, or in those of one size only; compare looks by their number
alone, so that a flight over new ground, or one that sees more and more of the same place, is taken
for a repetition.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mlscli.geometry.spacing import (
    Neighbourhoods,
    Spacing,
    distinct,
    of_one_look,
    spacing,
    without_clusters,
)
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import symmetries


def fourth(points: Float64) -> float:
    return float(np.median(cKDTree(points).query(points, k=[5])[0]))


def found(points: Float64) -> Spacing:
    whole = spacing(points)
    assert whole is not None
    return whole


def clustered(points: Float64, farthest: float = np.inf) -> float:
    return without_clusters(found(points), farthest).distance


def floor(rng: np.random.Generator, size: int, side: float = 10.0) -> Float64:
    return np.column_stack([rng.uniform(0, side, (size, 2)), rng.normal(0, 0.01, size)])


def test_it_is_the_median_distance_to_the_fourth_neighbour_of_distinct_points() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3000, 3))
    assert found(points).distance == fourth(points)
    repeated = points[rng.integers(0, 3000, 20_000)]
    assert found(repeated).distance == fourth(np.unique(repeated, axis=0))
    zeros = np.zeros((5, 3))
    zeros[1::2] = -0.0
    assert len(distinct(zeros)) == 1


@pytest.mark.parametrize("size", [0, 1, 4])
def test_fewer_points_than_neighbours_have_none(size: int) -> None:
    points = np.random.default_rng(1).normal(size=(size, 3))
    assert spacing(points) is None
    assert spacing(np.tile(points, (9, 1))) is None


def test_points_that_are_asked_are_chosen_alike_in_a_cloud_turned_or_mirrored() -> None:
    rng = np.random.default_rng(2)
    points = np.round(rng.uniform(-3, 3, (4000, 3)), 1)
    asked = {}
    for swap, negate_x, negate_y in symmetries():
        turned = points * (-1 if negate_x else 1, -1 if negate_y else 1, 1)
        turned = rng.permutation(turned[:, [1, 0, 2]] if swap else turned)
        cloud = Neighbourhoods(turned)
        rows = cloud.some(500)
        assert 500 <= len(rows) < 700
        back = cloud.points[rows]
        back = (back[:, [1, 0, 2]] if swap else back) * (
            -1 if negate_x else 1, -1 if negate_y else 1, 1
        )  # fmt: skip
        asked[swap, negate_x, negate_y] = np.unique(back + 0.0, axis=0)
    for each in asked.values():
        np.testing.assert_array_equal(each, asked[False, False, False])


@pytest.mark.parametrize("times", [6, 12, 60])
def test_points_seen_again_a_little_off_count_as_one(times: int) -> None:
    rng = np.random.default_rng(times)
    points = floor(rng, 900)
    apart = fourth(points)
    again = np.concatenate(
        [points + rng.normal(0, 0.01 * apart, points.shape) for _ in range(times)]
    )
    assert found(again).distance < 0.6 * apart
    assert clustered(again) == pytest.approx(apart, rel=0.15)


@pytest.mark.parametrize("share", [0.6, 0.7])
def test_one_dense_cluster_does_not_stand_for_the_cloud(share: float) -> None:
    rng = np.random.default_rng(3)
    points = floor(rng, 1500)
    many = int(1500 * share / (1 - share))
    ball = rng.normal((5, 5, 0), 0.005, (many, 3))
    cloud = np.concatenate([points, ball])
    assert found(cloud).distance < 0.1 * fourth(points)
    assert clustered(cloud) == pytest.approx(fourth(points), rel=0.15)


def test_a_cloud_without_clusters_keeps_its_spacing() -> None:
    rng = np.random.default_rng(4)
    line = np.column_stack([np.linspace(0, 10, 2000), np.zeros((2000, 2))])
    lattice = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0), [0.0]), axis=-1).reshape(-1, 3)
    uneven = floor(rng, 3000)
    uneven[:, 0] = uneven[:, 0] ** 2
    # Fewer than a quarter lie anywhere: they are outliers, not what the clusters are.
    scattered = np.concatenate([floor(rng, 3000), rng.uniform(-1e4, 1e4, (600, 3))])
    space = rng.uniform(0, 1, (3000, 3))
    at_random = np.column_stack([rng.uniform(0, 10, 2000), np.zeros((2000, 2))])
    for cloud in (floor(rng, 3000), space, line, at_random, lattice, uneven, scattered):
        assert clustered(cloud) == found(cloud).distance


def test_the_largest_clusters_count_up_to_what_is_believed() -> None:
    rng = np.random.default_rng(5)
    places = floor(rng, 400, 100.0)
    middle = np.concatenate([places + rng.normal(0, 0.05, places.shape) for _ in range(8)])
    small = np.concatenate([middle + rng.normal(0, 1e-5, middle.shape) for _ in range(8)])
    assert clustered(small) == pytest.approx(fourth(places), rel=0.15)
    assert clustered(small, farthest=2.0) < 0.2
    assert clustered(small, farthest=1e-6) == found(small).distance


def test_clusters_are_found_alike_in_a_cloud_shuffled_turned_or_mirrored() -> None:
    rng = np.random.default_rng(6)
    places = floor(rng, 300) - (5.0, 5.0, 0.0)
    cloud = np.concatenate([places + rng.normal(0, 0.002, places.shape) for _ in range(9)])
    expected = clustered(cloud)
    assert expected > 2 * found(cloud).distance
    for swap, negate_x, negate_y in symmetries():
        turned = cloud * (-1 if negate_x else 1, -1 if negate_y else 1, 1)
        assert clustered(rng.permutation(turned[:, [1, 0, 2]] if swap else turned)) == expected


# --- looks ---


def one_look(looks: list[Float64]) -> Spacing | None:
    return of_one_look(found(np.concatenate(looks)), looks)


def test_looks_at_the_same_points_count_as_one() -> None:
    rng = np.random.default_rng(7)
    points = floor(rng, 500)
    # Off by as much as the points lie apart: there are no clusters left.
    looks = [points + rng.normal(0, 0.1, points.shape) for _ in range(50)]
    whole = np.concatenate(looks)
    assert clustered(whole) < 0.5 * fourth(points)
    line = np.column_stack([np.linspace(0, 20, 400), np.zeros((400, 2))])
    scans = [line + rng.normal(0, (0.005, 0.005, 0), line.shape) for _ in range(100)]
    one = one_look(scans)
    assert one is not None
    assert one.distance == pytest.approx(fourth(line), rel=0.2)


def test_a_flight_over_new_ground_is_no_repetition() -> None:
    rng = np.random.default_rng(8)
    strips = [floor(rng, 300, 3.0) + np.array([2.0 * k, 0, 0]) for k in range(20)]
    assert one_look(strips) is None


def test_looks_that_find_other_points_of_a_place_are_no_repetition() -> None:
    rng = np.random.default_rng(9)
    assert one_look([floor(rng, 200) for _ in range(40)]) is None
    # Nor is a cloud that is sent whole again and again, which equal points tell.
    points = floor(rng, 800)
    assert one_look([points[: 40 * k] for k in range(1, 21)]) is None


def test_one_look_or_looks_of_few_points_are_not_compared() -> None:
    rng = np.random.default_rng(10)
    points = floor(rng, 500)
    assert one_look([points]) is None
    assert one_look([points[:10] + rng.normal(0, 0.1, (10, 3)) for _ in range(50)]) is None
