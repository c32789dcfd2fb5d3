"""Which levels of quality the default pipeline reaches on scenes with truth.

Run it as ``python benchmarks/levels.py``; it takes about half a minute. Printed are the means over
the seeds, each beside the level to reach.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import mean

import numpy as np

from mlscli.config import Parameters, load
from mlscli.keyframes import Keyframe
from mlscli.pipeline.builder import MapBuilder
from mlscli.quality import flown, scored
from mlscli.scenes.presets import PRESETS
from mlscli.scoring import Score
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Float64

SEEDS = (1, 2, 3)
SIGMA, CELL = 0.05, 0.15
THESIS = tuple(preset.name for preset in PRESETS if preset.number)


def main() -> None:
    """Print the table."""
    print("| what | level | found | |")  # noqa: T201
    print("|:--|--:|--:|:--|")  # noqa: T201
    for what, level, found, reached in rows():
        print(f"| {what} | {level} | {found} | {'reached' if reached else 'MISSED'} |")  # noqa: T201


def rows() -> Iterator[tuple[str, str, str, bool]]:
    """Yield what is measured, the level, what was found, and whether it is reached."""
    parameters = Parameters().with_cell_size(CELL)
    for scene in THESIS:
        for outliers in (0.1, 0.2):
            scores = [scored(flown(scene, outliers, seed), parameters) for seed in SEEDS]
            yield from _scene_rows(f"{scene}, {outliers:.0%} outliers", scores)
    for density, side in ((4, 60), (40, 30), (200, 16)):
        yield from _floor_rows(density, side)
    yield from _deck_rows()


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


def _built(xyz: Float64, parameters: Parameters) -> SurfaceMap:
    builder = MapBuilder(parameters)
    builder.add(Keyframe(xyz))
    return builder.finish()


def _floor_rows(density: int, side: int) -> Iterator[tuple[str, str, str, bool]]:
    """Measure a flat floor: more points must not lift it, nor make it a wall."""
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
    """Measure ground 5 m below a deck, 5 % of the points anywhere between."""
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


if __name__ == "__main__":
    main()
