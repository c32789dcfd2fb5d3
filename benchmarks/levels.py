"""Which levels of quality the default pipeline reaches on scenes with truth.

Run it as ``python benchmarks/levels.py``; it takes half a minute. It prints means over the seeds,
and sums of phantom closings, each beside the level to reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import mean

import numpy as np

from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import cell, cells, floor, wall
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.surfaces import Leg, Scatter, Scene
from mlscli.scoring import Score
from mlscli.trials.quality import GRID, SCENES, flown, scored

SEEDS = (1, 2, 3)
SIGMA, CELL = 0.05, 0.15
OUTLIERS = (0.1, 0.2)
THESIS = tuple(preset.name for preset in SCENE_PRESETS if preset.number)
# By the sigma of depths at a distance of 2: correctness, completeness, flat called vertical.
SLAM = {0.02: (0.95, 0.97, 0.03), 0.05: (0.85, 0.95, 0.08)}


def narrow_passage() -> Scene:
    """Return a deck over a passage that is 4 cells wide, between two walls."""
    banks = [(cells(-15, -3), cells(-5, 5)), (cells(3, 15), cells(-5, 5))]
    scene = floor(Scene("narrow passage"), cells(-15, 15), cells(-15, 15), 0.0, openings=banks)
    scene = floor(scene, cells(-15, 15), cells(-6, 6), 1.2)
    for x in (cell(-2.5), cell(2.5)):
        scene = wall(scene, (x, cell(-5.5)), (x, cell(5.5)), (0.0, 1.2))
    return scene.with_legs(
        Leg((0.0, -3.0, 0.6), (0.0, 3.0, 0.6), tilt=85),
        Leg((0.0, 3.0, 0.6), (0.0, -3.0, 0.6), tilt=85),
    )


# Name, scene, places with openings wider than max_gap_enhanced, 5 cells, and with narrower or lower
# ones.
OPENINGS: tuple[tuple[str, Scene, tuple[str, ...], tuple[str, ...]], ...] = (
    ("bridge 12 cells wide", make("bridge"), ("under_deck",), ()),
    ("passage 10 cells wide", make("bridge-walls"), ("under_deck",), ()),
    ("house, holes of 7.3 cells", make("house", 1.1), ("under_deck", "in_window", "in_hole"), ()),
    ("house, holes of 4.7 cells", make("house", 0.7), ("under_deck",), ("in_window", "in_hole")),
    ("passage 4 cells high", make("bridge-walls", 0.6), (), ("under_deck",)),
    ("passage 4 cells wide", narrow_passage(), (), ("under_deck",)),
)


def main() -> None:
    """Print the table."""
    print("| what | level | found | |")  # noqa: T201
    print("|:--|--:|--:|:--|")  # noqa: T201
    for what, level, found, reached in rows():
        print(f"| {what} | {level} | {found} | {'reached' if reached else 'MISSED'} |")  # noqa: T201


def rows() -> Iterator[tuple[str, str, str, bool]]:
    """Yield what is measured, the level to reach, the figure, and whether it reaches the level."""
    parameters = Parameters().with_cell_size(CELL)
    for scene in THESIS:
        for outliers in OUTLIERS:
            scores = [scored(flown(scene, outliers, seed), parameters) for seed in SEEDS]
            yield from _scene_rows(f"{scene}, {outliers:.0%} outliers", scores)
    yield from _opening_rows(parameters)
    for density, side in ((4, 60), (40, 30), (200, 16)):
        yield from _floor_rows(density, side)
    yield from _deck_rows()
    for sigma, levels in SLAM.items():
        yield from _slam_rows(sigma, *levels)


def _scene_rows(name: str, scores: Sequence[Score]) -> Iterator[tuple[str, str, str, bool]]:
    totals = [score.total for score in scores]
    rmse = mean(total.heights.rmse or 0.0 for total in totals) / SIGMA
    yield f"{name}: rmse / sigma", "0.5", f"{rmse:.3f}", rmse <= 0.5
    for what, level, shares in (
        ("completeness", 0.995, [total.completeness for total in totals]),
        ("completeness of floors", 0.995, [total.completeness_horizontal for total in totals]),
        ("correctness", 0.99, [total.correctness for total in totals]),
    ):
        share = mean(each.share for each in shares if each.share is not None)
        yield f"{name}: {what}", f"{level:.1%}", f"{share:.2%}", share >= level


def _opening_rows(parameters: Parameters) -> Iterator[tuple[str, str, str, bool]]:
    """Count phantom closings in openings wider than `max_gap_enhanced`, and in narrower ones.

    In narrower ones, only plastered patches count: artificial ones may close them.
    """
    for name, scene, wide, narrow in OPENINGS:
        for outliers in OUTLIERS:
            flights = [fly(scene, GRID, Noise(salt_pepper=outliers), seed=seed) for seed in SEEDS]
            scores = [scored(flight, parameters) for flight in flights]
            for place, closing, origins in (
                *((place, "closed", ("plastered", "artificial")) for place in wide),
                *((place, "closed as if sure", ("plastered",)) for place in narrow),
            ):
                by_origin = [score.phantom_places[place] for score in scores]
                count = sum(each[origin] for each in by_origin for origin in origins)
                what = f"{name}, {outliers:.0%} outliers: {place.replace('_', ' ')}, {closing}"
                yield what, "0", str(count), count == 0


def _built(xyz: Float64, parameters: Parameters) -> SurfaceMap:
    builder = MapBuilder(parameters)
    builder.add(Keyframe(xyz))
    return builder.finish()


def _floor_rows(density: int, side: int) -> Iterator[tuple[str, str, str, bool]]:
    """Measure a flat floor: many points must neither lift it nor make it a wall."""
    rng = np.random.default_rng(1)
    sigma, size = CELL / 6, density * side * side
    xyz = np.c_[rng.uniform(0, side * CELL, (size, 2)), rng.normal(0, sigma, size)]
    surface = _built(xyz, Parameters().with_cell_size(CELL))
    bias = abs(float(surface.height.mean())) / sigma
    vertical = float(np.mean(surface.depth > 0))
    name = f"flat floor, {density} points a cell"
    yield f"{name}: bias / sigma", "0.1", f"{bias:.3f}", bias < 0.1
    yield f"{name}: called vertical", "1.0%", f"{vertical:.2%}", vertical <= 0.01


def _deck_rows() -> Iterator[tuple[str, str, str, bool]]:
    """Measure ground 5 m below a deck, with 5 % of the points anywhere in between."""
    rng, cell, size = np.random.default_rng(1), 0.2, 1_000_000
    side = np.sqrt(size / 2 / 4) * cell
    z = np.repeat([0.0, 5.0], size // 2)
    xyz = np.c_[rng.uniform(0, side, (size, 2)), z] + rng.normal(0, 0.03, (size, 3))
    gross = rng.random(size) < 0.05
    xyz[gross, 2] = rng.uniform(0, 5, np.count_nonzero(gross))
    surface = _built(xyz, load(None, [f"map.cell_size={cell}"]))
    cells = surface.cells
    edge = int(side / cell) - 2
    inside = (cells.ix > 1) & (cells.iy > 1) & (cells.ix < edge) & (cells.iy < edge)
    below = np.add.reduceat((surface.height < 2.5).astype(int), cells.start[:-1])
    ground = surface.height[cells.start[:-1]]
    good = inside & (below == 1) & (np.abs(ground) <= 0.15)
    share = float(good.sum() / inside.sum())
    rmse = float(np.sqrt(np.mean(ground[good] ** 2)))
    name = "ground under a deck, 5 % gross outliers"
    yield f"{name}: one patch within 15 cm", "99.8%", f"{share:.3%}", share >= 0.998
    yield f"{name}: rmse", "0.010 m", f"{rmse:.4f} m", rmse <= 0.01


def _slam_rows(
    sigma: float, correct: float, complete: float, vertical: float
) -> Iterator[tuple[str, str, str, bool]]:
    """Map flights whose depths err with the square of the distance, cells of the size of auto."""
    totals = []
    for scene in SCENES:
        for seed in SEEDS:
            flight = fly(make(scene), GRID, Noise("slam", Scatter(sigma, sigma)), seed=seed)
            parameters = settled(Parameters(), flight.keyframes, Report())
            totals.append(scored(flight, parameters).total)
    name = f"noise slam {sigma}, {len(SCENES)} scenes, cells of auto"
    for what, least, shares in (
        ("correctness", correct, [total.correctness for total in totals]),
        ("completeness", complete, [total.completeness for total in totals]),
    ):
        share = mean(each.share for each in shares if each.share is not None)
        yield f"{name}: {what}", f"{least:.1%}", f"{share:.2%}", share >= least
    wrong = [total.flat_called_vertical.share for total in totals]
    share = mean(each for each in wrong if each is not None)
    yield f"{name}: flat called vertical", f"{vertical:.1%}", f"{share:.2%}", share <= vertical


if __name__ == "__main__":
    main()
