"""Stage lists and clouds for properties that must hold whatever is configured and recorded.

Lists have any stages that may stand together, in any order, twice, too, with parameters beside
the defaults and with limits. Clouds have something for every stage: floors with gaps, a wall with
a hole and missing columns, a deck, peaks, pits and outliers; and half of them equal distances.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import cycle, islice
from typing import Any

import numpy as np
from hypothesis import strategies as st

from mlscli.keyframes.batches import Points
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.parameters import MapParameters, Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.stage import MapStage, Stage
from mlscli.pipeline.stages.walls import Walls
from mlscli.runtime.arrays import Bool, Float64, Int64
from tests.helpers.maps import CELL, GAP, THICKNESS

GRID = MapParameters(CELL, GAP, THICKNESS)

# Whole cells, parts of them, and none; the wide ones are never less than the narrow.
_narrow = st.sampled_from([0.4, 0.5, Cells(1), 1.1, 0.0])
_wide = st.sampled_from([1.6, 1.1, Cells(4), 0.0])
_slope = st.sampled_from([0.0, 0.5, 1.0])

_of_median: dict[str, Any] = {
    "nb_radius": st.sampled_from([0.4, 0.8, Cells(2)]),
    "max_nb": st.sampled_from([0, 3, 6]),
    "min_nb": st.integers(0, 3),
    "recentre": st.sampled_from([0.0, 0.1, Cells(0.75)]),
}
_median = (
    st.builds(Median, **_of_median)
    | st.builds(
        Median,
        **_of_median,
        level=st.sampled_from([0.3, Cells(1)]),
        min_share=st.sampled_from([0.0, 0.3, 0.6]),
        max_slope=st.sampled_from([0.0, 0.4, 2.0]),
        layer_share=st.sampled_from([0.0, 0.3, 0.9]),
    )
    | st.builds(
        Median,
        **_of_median,
        max_slope=st.sampled_from([0.4, 2.0]),
        across=st.sampled_from([0.3, 0.0]),
    )
)
_orphans = st.builds(
    Orphans,
    horizontal=st.sampled_from([1.3, 0.5, 0.0]),
    vertical=st.sampled_from([0.3, 0.0]),
    min_neighbours=st.integers(1, 2),
    min_share=st.sampled_from([0.0, 0.1, 0.4]),
    share_horizontal=st.sampled_from([1.3, 0.5]),
    share_vertical=st.sampled_from([0.3, 0.0]),
)
_walls = st.builds(
    Walls,
    max_gap=_narrow,
    max_gap_enhanced=_wide,
    height_thresh=_slope,
    join=st.sampled_from([0.0, 0.5, 2.0]),
    along=st.sampled_from([0.0, 0.5, Cells(3)]),
    support=st.integers(0, 2),
    pieces=st.sampled_from([0.0, 2.0, Cells(8)]),
)
_plaster = st.builds(
    Plaster,
    max_gap=_narrow,
    max_gap_enhanced=_wide,
    height_thresh=_slope,
    height_clearance=st.sampled_from([0.0, 0.2]),
    slope_reach=st.sampled_from([0.0, 0.8]),
    support=st.integers(0, 2),
    over_lower=st.booleans(),
)
_pyramids = st.builds(
    Pyramids,
    height_factor_thresh=st.sampled_from([0.0, 0.5, 1.5]),
    max_height=st.sampled_from([0.6, GAP]),
    # Pits are rare.
    pits=st.sampled_from([True, True, True, False]),
)
_regions = st.builds(
    Regions,
    height_thresh=st.sampled_from([0.1, 0.3]),
    min_size=st.integers(1, 3),
    snap=st.booleans(),
)
MAP_STAGES: dict[str, st.SearchStrategy[MapStage]] = {
    "orphans": _orphans,
    "walls": _walls,
    "plaster": _plaster,
    "pyramids": _pyramids,
    "regions": _regions,
}
"""What `stage_lists` draws from."""


@st.composite
def _within_limits(draw: st.DrawFn, stages: st.SearchStrategy[MapStage]) -> MapStage:
    """Draw a stage, one in four with limits on some of the sides."""
    stage = draw(stages)
    if draw(st.integers(0, 3)) < 3:
        return stage
    low, high = st.none() | st.integers(-4, 0), st.none() | st.integers(0, 4)
    return replace(stage, min_x=draw(low), max_x=draw(high), min_y=draw(low), max_y=draw(high))


@st.composite
def stage_lists(draw: st.DrawFn, *, limits: bool = True) -> tuple[Stage, ...]:
    """Draw the stages of a configuration, those on points first."""
    every = list(MAP_STAGES.values())
    kinds = draw(st.permutations(every) | st.lists(st.sampled_from(every), max_size=4))
    on_points = draw(st.lists(_median, max_size=2))
    on_map = [draw(_within_limits(kind) if limits else kind) for kind in kinds]
    parameters_of((*on_points, *on_map)).check()
    return *on_points, *on_map


def parameters_of(stages: Sequence[Stage], mode: str = "consistent") -> Parameters:
    """Return the parameters of a map of the tests' grid with these stages."""
    assert mode in ("consistent", "sequential")
    return Parameters(mode=mode, map=GRID, pipeline=tuple(stages))  # type: ignore[arg-type]


def eventful_points(seed: int, size: int) -> Points:
    """Return a cloud of 7 x 7 cells, somewhere on the grid, in random order."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-2, -2, 0), (1.5, 1.5, 0), (size, 3))
    kinds = ["floor", "wall", "deck", "outlier"]
    what = rng.choice(kinds, size, p=(0.48, 0.32, 0.16, 0.04))
    floor, wall, deck, outlier = (what == kind for kind in kinds)
    # The wall stands along y and has a hole all along; the deck lies across, passed below.
    xyz[wall, 0] = rng.uniform(0.5, 0.99, _count(wall))
    xyz[deck, 1] = rng.uniform(-1, 0, _count(deck))
    ix, iy = np.floor(xyz[:, :2] / CELL).T
    xyz[:, 2] = rng.normal(0, 0.04, size) + 0.3 * rng.random() * xyz[:, 0]
    xyz[wall, 2] = rng.choice([0.0, 1.8], _count(wall)) + rng.uniform(0, 1, _count(wall))
    xyz[deck, 2] += 3.4
    xyz[outlier, 2] += rng.uniform(-3, 5, _count(outlier))
    # Cells of the floor stand out, some of them above another surface.
    for step, below in ((-0.6, 0.0), (0.45, 0.0), (0.6, 1.0), (0.6, 1.0)):
        at = floor & (ix == rng.integers(-3, 0)) & (iy == rng.integers(-3, 2))
        xyz[at, 2] += step - rng.choice([0, below], _count(at))
    # Each surface has a gap; there is no floor below the wall, or there is.
    missing = floor & (_some(iy, rng, 2) | (ix == 1) & (rng.random() < 0.5))
    missing |= wall & _some(iy, rng, 2) | deck & _some(ix, rng, 3)
    xyz = xyz[~missing]
    if rng.random() < 0.5:
        # Many heights and distances are equal; off the edges of cells.
        xyz = np.round(xyz * 8) / 8
        xyz[:, :2] += 0.03
    xyz[:, :2] += CELL * rng.choice([0, 0, -40, 29], 2)
    stray = rng.random(len(xyz)) < 0.01
    xyz[stray, :2] += rng.choice([-(2.0**20), 40.0, 2.0**20], (_count(stray), 2))
    return Points.of(xyz + 0.0, np.zeros(len(xyz), dtype=np.int32))


def _some(index: Float64, rng: np.random.Generator, most: int) -> Bool:
    """Tell which indices are in a random range of so many at most."""
    first = rng.integers(-3, 3)
    inside: Bool = (index >= first) & (index < first + rng.integers(1, most + 1))
    return inside


def _count(chosen: Bool) -> int:
    return int(np.count_nonzero(chosen))


@st.composite
def clouds(draw: st.DrawFn) -> Points:
    """Draw a cloud; one in three is a row of them, farther across than most stages reach."""
    seed = draw(st.integers(0, 2**32 - 1))
    points = eventful_points(seed, draw(st.integers(0, 280) | st.integers(100, 280)))
    if draw(st.integers(0, 2)) < 2:
        return points
    side_by_side = [points.xyz + np.array([x, 0.0, 0.0]) for x in (-7.0, -3.5, 0.0, 3.5, 7.0)]
    chosen = np.random.default_rng(seed).permutation(5 * points.size)[: 2 * points.size]
    return Points.of(np.concatenate(side_by_side)[chosen], np.zeros(len(chosen), dtype=np.int32))


@st.composite
def flights(draw: st.DrawFn) -> list[Points]:
    """Draw a cloud in batches, each a keyframe of its own: in any order, of any sizes."""
    points = draw(clouds())
    order = draw(st.sampled_from(["at random", "along x", "along y"]))
    if order != "at random":
        points = points_at(points, np.argsort(points.xyz[:, "xy".index(order[-1])]))
    sizes = draw(
        st.sampled_from([[1], [2, 1], [10**6]])
        | st.lists(st.integers(1, 70) | st.sampled_from([0, 1, 30]), min_size=1, max_size=5).filter(
            any
        )
    )
    return list(islice(in_batches(points, sizes), 100))


def in_batches(points: Points, sizes: Sequence[int]) -> Iterator[Points]:
    """Yield points so many at a time, the sizes in turn, each batch a keyframe of its own."""
    begin = 0
    for number, size in enumerate(cycle(sizes)):
        if begin >= points.size:
            return
        xyz = points.xyz[begin : begin + size]
        yield Points.of(xyz, np.full(len(xyz), number, dtype=np.int32))
        begin += size


def points_at(points: Points, places: Int64) -> Points:
    """Return the points at places, in their order."""
    return points.take(places)
