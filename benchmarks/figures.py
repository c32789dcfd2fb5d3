"""The thesis's figures as scenes with truth, and the claims of their captions, in numbers.

Run it as ``python -m benchmarks.figures``; it takes a few seconds. The data of the figures are
lost: scenes and settings are those that the thesis's text names. Where it names none, a scene is
one of its section 5.2, cells are 0.15 wide, points 0.1 apart with a sigma of 0.05, and a tenth of
them is salt and pepper. Maps are made by stages of the preset ``thesis``, most of them in one pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.shown import Claim, Shown, differing, less, tables
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import CellSet
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.walls import Walls
from mlscli.runtime.arrays import Bool
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter
from mlscli.scoring import score
from mlscli.scoring.comparison import matches
from mlscli.trials.staged import mapped

CALM = Noise(sigma=Scatter(0.02, 0.02), salt_pepper=0.0)

Rows = Iterator[Shown | Claim]
Figure = Callable[[int], Rows]


def main() -> None:
    """Print the tables."""
    for line in tables(figures()):
        print(line)  # noqa: T201


def figures(seed: int = 1) -> Rows:
    """Yield the maps of all figures and the claims about them."""
    for figure in (median, orphans, pyramids, plaster, sparse, batches, beside_the_bridge):
        yield from figure(seed)


def median(seed: int) -> Rows:
    """Yield figures 3.3 to 3.6: three planes with outliers, without and with the median."""
    flight, doubled = cloud("planes", seed), cloud("planes", seed, Noise(salt_pepper=0.2))
    bare = Shown("3.3, 3.5", "no stage", flight, mapped(flight, stages()))
    filtered = Shown("3.4, 3.5", "median", flight, mapped(flight, stages("median")))
    harder = Shown("3.6", "median, 20 % outliers", doubled, mapped(doubled, stages("median")))
    yield from (bare, filtered, harder)
    both = bare, filtered
    false = [shown.score.false_levels for shown in (bare, filtered, harder)]
    yield less("3.3, 3.4", "with the median, fewer false levels", false[:2])
    yield less("3.3, 3.4", "planes are smoother: rmse", [shown.rmse for shown in both])
    yield less("3.3, 3.4", "fewer peaks", [shown.peaks for shown in both])
    hanging = [_hanging_at_steps(shown) for shown in both]
    yield less("3.3, 3.4", "edges stay sharp: less hangs between two planes", hanging)
    yield less("3.5", "fewer depths (none is true)", [len(shown.depths) for shown in both])
    deepest = [float(shown.depths.max(initial=0.0)) for shown in both]
    yield less("3.5", "smaller depths: the largest", deepest)
    yield less("3.3, 3.6", "20 % with it, fewer false levels than 10 % without", false[::2])
    yield less("3.3, 3.6", "20 % with it, smoother than 10 % without", [bare.rmse, harder.rmse])


def orphans(seed: int) -> Rows:
    """Yield figures 3.9 and 3.10: one point in a hundred anywhere between ground and bridge."""
    flight = cloud("bridge", seed, Noise(outliers=0.01), height=3.0)
    before = Shown("3.9", "no stage", flight, mapped(flight, stages()))
    after = Shown("3.10", "orphans", flight, mapped(flight, stages("orphans")))
    yield from (before, after)
    far = before.surface.gap_size / before.surface.cell_size
    astray = [_count(shown.off(far)) for shown in (before, after)]
    claim = "most patches that no surface is near to disappear"
    yield Claim("3.9, 3.10", claim, astray, astray[1] < astray[0] / 2)
    missed = [shown.score.levels_missed for shown in (before, after)]
    yield Claim("3.9, 3.10", "no true level does: missed", missed, missed[0] == missed[1])


def pyramids(seed: int) -> Rows:
    """Yield figures 3.12 and 3.13: peaks that are left on a house by all other stages."""
    flight = cloud("house", seed)
    others = stages("median", "orphans", "plaster")
    before = Shown("3.12", "all but pyramids", flight, mapped(flight, others))
    after = Shown("3.13", "all stages", flight, mapped(flight, load("thesis", ["mode=consistent"])))
    yield from (before, after)
    peaks = [before.peaks, after.peaks]
    yield Claim("3.12, 3.13", "no pyramid is left", peaks, peaks[0] > 0 == peaks[1])
    was, now = matches(before.surface, after.surface)
    lowered = before.surface.height[was] != after.surface.height[now]
    spoilt = [_count(lowered), _count(after.off()[now] & ~before.off()[was])]
    yield Claim("3.13", "of patches lowered, moved off a surface", spoilt, spoilt[1] == 0)
    walls = before.true.take(before.true.depth > 0)
    edges = CellSet.of(walls.ix, walls.iy)
    on_edge = edges.contains(before.surface.ix[was], before.surface.iy[was])
    touched = [_count(lowered), _count(lowered & on_edge)]
    claim = "of patches lowered, in the walls and corners of the house"
    yield Claim("3.13", claim, touched, touched[1] == 0)


def plaster(seed: int) -> Rows:
    """Yield figure 3.17: ground and house, holes 0.7 wide in both, gaps up to 0.4 or 0.7 closed."""
    flight = cloud("house", seed, CALM)
    narrow, wide = (
        load("thesis", ["mode=consistent", f"plaster.max_gap={gap}", "plaster.max_gap_enhanced=0"])
        for gap in (0.4, 0.7)
    )
    left = Shown("3.17 left", "max_gap 0.4", flight, mapped(flight, narrow))
    right = Shown("3.17 right", "max_gap 0.7", flight, mapped(flight, wide))
    # The median makes one height of the wall above the window, 0.4 high: no wall is left to join.
    closing = replace(wide, pipeline=(Walls(max_gap=0.4, max_gap_enhanced=0.9), wide.pipeline[2]))
    ours = Shown("3.17", "walls up to 0.9, max_gap 0.7, no median", flight, mapped(flight, closing))
    yield from (left, right, ours)
    ground = [shown.closed((-2, 2), (-12, -8), (-0.1, 0.1)) for shown in (left, right)]
    small = [_count(left.inserted) - ground[0], _count(right.inserted) - ground[1]]
    yield Claim("3.17", "some small gaps are closed in both", small, min(small) > 0)
    claim = "the hole in the ground is closed with 0.7: of its 16 cells"
    # Noise may move a point or two into the hole.
    yield Claim("3.17", claim, ground, ground[0] == 0 and ground[1] > 12)
    window = [shown.closed((-2, 2), (6, 7), (0.5, 1.0)) for shown in (left, right, ours)]
    claim = "the hole in the wall is closed in neither: of its 4 columns"
    yield Claim("3.17", claim, window[:2], window[:2] == [0, 0])
    claim = "the stage walls, which the thesis had not, closes it"
    yield Claim("3.17", claim, window[1:], window[2] == 4)


def sparse(seed: int) -> Rows:
    """Yield figure 3.18: the same scene with points 0.4 apart, gaps up to 0.75 closed.

    No point has a neighbour within the median's radius, so that plaster runs alone. Both of its
    passes run, as the thesis's plaster joined along one axis what it had inserted along the other.
    """
    dense, flight = cloud("house", seed, CALM), cloud("house", seed, CALM, grid=0.4)
    bare = Shown("3.18", "no stage", flight, mapped(flight, stages()))
    parameters = stages("plaster", settings=["plaster.max_gap=0.75"])
    closed = Shown("3.18", "max_gap 0.75", flight, mapped(flight, parameters))
    yield from (bare, closed)
    claim = "points are 16 times fewer, as on surfaces (text: 64, caption: 4)"
    points = [dense.points, flight.points]
    yield Claim("3.17, 3.18", claim, points, round(points[0] / points[1] / 16) == 1)
    complete = [shown.score.total.completeness_horizontal.share or 0.0 for shown in (bare, closed)]
    yield Claim("3.18", "floors become quite complete", complete, complete[1] > 0.8)
    inserted = _count(closed.inserted)
    claim = "a lot of patches are inserted: more than are measured"
    yield less("3.18", claim, [inserted, closed.surface.size - inserted])
    exact = [
        score(closed.surface, closed.true.take(part)).by_origin["plastered"].heights.rmse or 0.0
        for part in (closed.true.height > 1, closed.true.height < 1)
    ]
    yield less("3.18", "roof, ground: what is inserted is less exact in the roof: rmse", exact)


def batches(seed: int) -> Rows:
    """Yield figure 6.9: the village in batches of 300 and of 80 points, in both modes."""
    flight = fly(make("village-thesis"), 0.2, seed=seed)

    def pair(mode: str, names: Sequence[str] = ()) -> list[Shown]:
        maps = []
        for size in (300, 80):
            parameters = load("thesis", [f"mode={mode}", f"batch.min_points={size}"])
            parameters = only(parameters, names) if names else parameters
            what = f"{mode}, batches of {size}"
            maps.append(Shown("6.9", what, flight, mapped(flight, parameters)))
        return maps

    sequential, consistent = pair("sequential"), pair("consistent")
    yield from (*sequential, *consistent)
    unplastered = pair("sequential", ("median", "orphans", "pyramids"))
    differ = [differing(*maps) for maps in (sequential, unplastered, consistent)]
    yield Claim("6.9", "sequential: patches that differ", _of(sequential, differ[0]), differ[0] > 0)
    claim = "not by hole plastering alone, as was guessed: without it"
    yield Claim("6.9", claim, _of(unplastered, differ[1]), differ[1] > 0)
    yield Claim("6.9", "consistent: patches that differ", _of(consistent, differ[2]), not differ[2])


def beside_the_bridge(seed: int) -> Rows:
    """Yield figure 6.10: a gap of 4 by 4 cells in a deck, which either axis can close."""
    flight = fly(make("bridge-gap"), 0.12, CALM, seed=seed)
    parameters = load("thesis", ["mode=consistent"])
    stage = next(each for each in parameters.pipeline if isinstance(each, Plaster))
    before = mapped(flight, stages("median", "orphans"))
    y_first = Shown(
        "6.10", "along y, then x", flight, along(along(before, stage, "iy"), stage, "ix")
    )
    x_first = Shown(
        "6.10", "along x, then y", flight, along(along(before, stage, "ix"), stage, "iy")
    )
    both = Shown("6.10", "both at once", flight, mapped(flight, parameters))
    yield from (y_first, x_first, both)
    gap = (-2, 2), (2, 6)
    on_deck = [shown.closed(*gap, (-0.075, 0.075)) for shown in (y_first, x_first, both)]
    claim = "y first, x first: of 16 cells, closed at the deck's height"
    yield Claim("6.10", claim, on_deck[:2], on_deck[0] != on_deck[1])
    claim = "y first, both at once: of 16 cells, closed at the deck's height"
    yield Claim("6.10", claim, on_deck[::2], on_deck[2] == 16)
    heights = [shown.closing(*gap, (-0.5, 0.5)).height for shown in (y_first, both)]
    errors = [float(np.abs(part).max(initial=0.0)) for part in heights]
    yield less("6.10", "y first, both at once: greatest error of what closes the gap", errors)
    keyframes = [
        Keyframe(keyframe.points[:, [1, 0, 2]], keyframe.stamp) for keyframe in flight.keyframes
    ]
    turned = mapped(replace(flight, keyframes=keyframes), parameters)
    back = replace(both, surface=replace(turned, ix=turned.iy, iy=turned.ix).sorted())
    claim = "x and y swapped: patches that differ from the mirrored map"
    differ = differing(both, back)
    yield Claim("6.10", claim, _of([both], differ), differ == 0)


# --- flights and settings ---


def cloud(
    scene: str,
    seed: int,
    noise: Noise | None = None,
    *,
    height: float | None = None,
    grid: float = 0.1,
) -> Flight:
    """Return all points of a preset, seen or not, as in the thesis's artificial clouds.

    Parameters
    ----------
    scene : str
        Name of the preset.
    seed : int
    noise : Noise, optional
    height : float, optional
        The preset's crucial dimension.
    grid : float
        Spacing of the points.
    """
    return fly(make(scene, height), grid, noise, seed=seed, visibility=False)


def stages(*names: str, settings: Sequence[str] = ()) -> Parameters:
    """Return the parameters of the preset ``thesis`` in one pass, with the named stages only."""
    return only(load("thesis", ["mode=consistent", *settings]), names)


def only(parameters: Parameters, names: Sequence[str]) -> Parameters:
    """Return the parameters with the named stages only."""
    kept = tuple(stage for stage in parameters.pipeline if stage.name in names)
    return replace(parameters, pipeline=kept)


def along(surface: SurfaceMap, stage: Plaster, axis: str) -> SurfaceMap:
    """Close gaps along one axis only: along the other, cells are moved too far apart."""
    across = "ix" if axis == "iy" else "iy"
    apart: dict[str, Any] = {across: getattr(surface, across) * 1000}
    closed = stage.transform(replace(surface, **apart))
    return closed.with_columns(**{across: getattr(closed, across) // 1000})


def _count(chosen: Bool) -> int:
    return int(np.count_nonzero(chosen))


def _of(maps: Sequence[Shown], number: int) -> list[int]:
    """Return how many patches the first map has, and `number`: those of a claim."""
    return [maps[0].surface.size, number]


def _hanging_at_steps(shown: Shown) -> int:
    """Count patches beside the two steps of `planes`, farther than a cell from the truth."""
    return _count(shown.off(1.0) & np.isin(shown.surface.ix, (-8, -7, 6, 7)))


if __name__ == "__main__":
    main()
