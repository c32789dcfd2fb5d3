"""What each stage is worth: synthetic flights, scored against the truth of their scenes.

Every scene is flown with several shares of outliers and several seeds, and mapped with more and
more stages, see `mlscli.trials.staged`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import AUTO, Parameters
from mlscli.pipeline.pipeline import Progress
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.truth import truth
from mlscli.scoring import Score, score
from mlscli.trials.staged import (
    OUTLIER_SHARES,
    WORSE_BY,
    Line,
    as_markdown,
    flown_by_share,
    mapped,
    maps_by_stage,
)

# The thesis's.
CELL_SIZE = 0.15
# Spacing of the points: a cell of a floor holds about 1.5 of them.
GRID = 0.12

# A stage makes a scene worse, too, where it raises the rmse of the heights by more than this share.
WORSE_HEIGHTS = 0.02

SCENES = tuple(preset.name for preset in SCENE_PRESETS if preset.name != "village")


@dataclass(frozen=True)
class StageWorth:
    """Scores of the maps of a scene made with the stages up to one of them, over all seeds.

    Attributes
    ----------
    scene : str
        Name of the preset.
    outliers : float
        The probability of salt and pepper, 0 to 1.
    stages : str
        The stage that was added last, or ``none``; those added before run, too.
    completeness, correctness : float
        Means of the shares of true patches found, and of the map's patches that are correct.
    rmse, bias : float
        Means of the rmse and bias of heights, in `unit`.
    missed, false, phantom : int
        Sums of the true patches not found, of the map's patches not correct, and of the inserted
        ones among these.
    honest_red : float or None
        Mean of the share of artificial patches that are correct; None where there are none.
    flat_called_vertical : float
        Mean of the share of true horizontal patches that the map calls vertical.
    cell_size : float
        Mean of the sides of the cells, in the unit of the scene.
    unit : {"sigma", "cell"}
        That of the heights' errors: the vertical sigma of the points; a cell where that is 0, or
        grows with the distance.
    worse : bool
        Whether the stage that was added last makes the maps worse.
    """

    scene: str
    outliers: float
    stages: str
    completeness: float
    correctness: float
    rmse: float
    bias: float
    missed: int
    false: int
    phantom: int
    honest_red: float | None
    flat_called_vertical: float
    cell_size: float
    unit: Literal["sigma", "cell"]
    worse: bool = False

    @property
    def agreement(self) -> float:
        """Harmonic mean of completeness and correctness."""
        both = self.completeness + self.correctness
        return 2 * self.completeness * self.correctness / both if both else 0.0


def table(
    scenes: Sequence[str] = SCENES,
    shares: Sequence[float] = OUTLIER_SHARES,
    seeds: Iterable[int] = (1,),
    noise: Noise | None = None,
    parameters: Parameters | None = None,
    progress: Progress | None = None,
) -> list[StageWorth]:
    """Return a row for each scene, share of outliers and stage added, over all seeds.

    Parameters
    ----------
    scenes : sequence of str
        Names of presets.
    shares : sequence of float
        Probabilities of salt and pepper.
    seeds : iterable of int
        Seeds of the flights, at least one.
    noise : Noise, optional
        How points are displaced, but for the salt and pepper; by default ``Noise()``.
    parameters : Parameters, optional
        Those of the maps, whose stages are added one by one; the defaults where none are given. A
        cell size of ``auto`` becomes the thesis's with the thesis's noise.
    progress : callable, optional
        As for `flown_by_share`.

    Raises
    ------
    UsageError
        Where there is no seed, no such preset, or `fly` refuses a value.
    """
    noise = noise or Noise()
    parameters = Parameters() if parameters is None else parameters
    if parameters.map.cell_size == AUTO and noise.kind == "thesis":
        parameters = parameters.with_cell_size(CELL_SIZE)

    def fly_over(scene: str, share: float, seed: int) -> Flight:
        return flown(scene, share, seed, noise=noise)

    rows: list[StageWorth] = []
    for scene, share, flights in flown_by_share(scenes, shares, seeds, fly_over, progress):
        before = None
        for stages, maps in maps_by_stage(flights, parameters):
            row = _mean_row(scene, share, stages, noise, flights, maps)
            row = replace(row, worse=before is not None and _is_worse(row, before))
            rows.append(row)
            before = row
    return rows


def flown(
    scene: str, outliers: float, seed: int, grid: float = GRID, noise: Noise | None = None
) -> Flight:
    """Fly over a preset.

    Parameters
    ----------
    scene : str
        Name of the preset.
    outliers : float
        The probability of salt and pepper.
    seed : int
    grid : float
        Spacing of the points, in the unit of the scene.
    noise : Noise, optional
        How points are displaced otherwise; by default ``Noise()``.
    """
    return fly(make(scene), grid, replace(noise or Noise(), salt_pepper=outliers), seed=seed)


def scored(flight: Flight, parameters: Parameters) -> Score:
    """Map a flight and score the map."""
    return _score(flight, mapped(flight, parameters))


def _score(flight: Flight, surface: SurfaceMap) -> Score:
    true = truth(flight.scene, surface.cell_size, surface.gap_size, surface.thickness)
    return score(surface, true)


def _mean_row(
    scene: str,
    share: float,
    stages: str,
    noise: Noise,
    flights: Sequence[Flight],
    maps: Sequence[SurfaceMap],
) -> StageWorth:
    """Return the row of several maps: means of shares and errors, sums of counts.

    Parameters
    ----------
    scene : str
    share : float
        The probability of salt and pepper.
    stages : str
        The stage that was added last.
    noise : Noise
        How points are displaced.
    flights : sequence of Flight
    maps : sequence of SurfaceMap
        Those of the flights.
    """
    scores = [_score(*each) for each in zip(flights, maps, strict=True)]
    totals = [each.total for each in scores]
    reds = [each.honest_red.share for each in scores if each.honest_red.of]
    cells = [surface.cell_size for surface in maps]
    in_sigmas = noise.kind == "thesis" and noise.sigma.vertical > 0
    units = [noise.sigma.vertical] * len(maps) if in_sigmas else cells
    heights = [total.heights for total in totals]
    return StageWorth(
        scene,
        share,
        stages,
        completeness=_mean(total.completeness.share for total in totals),
        correctness=_mean(total.correctness.share for total in totals),
        rmse=_mean(map(_in_unit, (each.rmse for each in heights), units)),
        bias=_mean(map(_in_unit, (each.bias for each in heights), units)),
        missed=sum(each.levels_missed for each in scores),
        false=sum(each.false_levels for each in scores),
        phantom=sum(each.phantom_closings.count for each in scores),
        honest_red=_mean(reds) if reds else None,
        flat_called_vertical=_mean(total.flat_called_vertical.share for total in totals),
        cell_size=_mean(cells),
        unit="sigma" if in_sigmas else "cell",
    )


def _in_unit(error: float | None, unit: float) -> float | None:
    return None if error is None else error / unit


def _mean(values: Iterable[float | None]) -> float:
    """Return the mean of the values that are known; 0 of none."""
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else 0.0


def _is_worse(row: StageWorth, before: StageWorth) -> bool:
    """Return whether a row is worse than the one with a stage less."""
    return row.agreement < before.agreement - WORSE_BY or row.rmse > before.rmse * (
        1 + WORSE_HEIGHTS
    )


# --- reports ---


def to_dict(rows: Sequence[StageWorth]) -> list[dict[str, Any]]:
    """Return the rows, ready for JSON."""
    return [asdict(row) for row in rows]


def to_markdown(rows: Sequence[StageWorth]) -> str:
    """Return the rows as a table for each scene, and a list of the stages that make one worse."""
    unit = rows[0].unit if rows else "sigma"
    heads = (
        *("complete %", "correct %", f"rmse / {unit}", f"bias / {unit}"),
        *("missed", "false", "phantom", "honest red %", "flat called vertical %"),
        *(["cell"] if unit == "cell" else []),
    )
    lines = [
        Line(row.scene, row.outliers, row.stages, row.worse, _score_cells(row)) for row in rows
    ]
    return as_markdown(lines, heads, "scene")


def _score_cells(row: StageWorth) -> tuple[str, ...]:
    return (
        f"{100 * row.completeness:.2f}",
        f"{100 * row.correctness:.2f}",
        f"{row.rmse:.3f}",
        f"{row.bias:+.3f}",
        f"{row.missed:,}",
        f"{row.false:,}",
        f"{row.phantom:,}",
        "" if row.honest_red is None else f"{100 * row.honest_red:.1f}",
        f"{100 * row.flat_called_vertical:.2f}",
        *([f"{row.cell_size:.3g}"] if row.unit == "cell" else []),
    )
