"""What each stage is worth: synthetic flights, mapped with more and more stages of the pipeline.

Every scene is flown with several shares of outliers and several seeds. Each flight is mapped with
no stage, then with one stage more at a time, each in its place in the pipeline. The maps are scored
against the truth of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from mlscli.building.builder import MapBuilder
from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import AUTO, Parameters
from mlscli.pipeline.stages.stage import Stage
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.truth import truth
from mlscli.scoring import Score, score

# In the order in which the thesis has them; last, the one that it does not have.
ADDED = ("median", "orphans", "plaster", "pyramids", "walls")
NO_STAGE = "none"
OUTLIER_SHARES = (0.0, 0.1, 0.2, 0.3)
CELL_SIZE = 0.15
# Spacing of the points: a cell of a floor holds about 1.5 of them.
GRID = 0.12

# A stage makes a scene worse where it lowers the harmonic mean of completeness and correctness
# by more than the first, or raises the rmse of the heights by more than the second, a share of it.
WORSE_BY, WORSE_HEIGHTS = 0.002, 0.02

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
        The stage that was added last, or `NO_STAGE`; those added before run, too.
    completeness, correctness : float
        Means of the shares of true patches found, and of the map's patches that are correct.
    rmse, bias : float
        Means of the rmse and bias of heights, in vertical sigmas of the points.
    missed, false, phantom : int
        Sums of the true patches not found, of the map's patches not correct, and of the inserted
        ones among these.
    honest_red : float or None
        Mean of the share of artificial patches that are correct; None where there are none.
    flat_called_vertical : float
        Mean of the share of true horizontal patches that the map calls vertical.
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
    parameters: Parameters | None = None,
    progress: Callable[[str, int, int | None], None] | None = None,
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
    parameters : Parameters, optional
        Those of the maps, whose stages are added one by one; the defaults where none are given. A
        cell size of ``auto`` becomes the thesis's.
    progress : callable, optional
        Called with the scene and share that come next, how many scenes are done, and how many
        there are.

    Raises
    ------
    UsageError
        Where there is no seed or no such preset.
    """
    parameters = Parameters() if parameters is None else parameters
    if parameters.map.cell_size == AUTO:
        parameters = parameters.with_cell_size(CELL_SIZE)
    pipelines = list(_growing(parameters.pipeline))
    seeds = list(seeds)
    if not seeds:
        raise UsageError("`seeds`: expected at least one")
    rows: list[StageWorth] = []
    for number, scene in enumerate(scenes):
        for share in shares:
            if progress is not None:
                progress(f"{scene}, {share:.0%}", number, len(scenes))
            flights = [flown(scene, share, seed) for seed in seeds]
            before = None
            for name, pipeline in pipelines:
                staged = replace(parameters, pipeline=pipeline)
                scores = [scored(flight, staged) for flight in flights]
                row = _mean_row(scene, share, name, scores)
                row = replace(row, worse=before is not None and _is_worse(row, before))
                rows.append(row)
                before = row
    return rows


def flown(scene: str, outliers: float, seed: int, grid: float = GRID) -> Flight:
    """Fly over a preset with the thesis's noise, `outliers` the probability of salt and pepper."""
    return fly(make(scene), grid, Noise(salt_pepper=outliers), seed=seed)


def mapped(flight: Flight, parameters: Parameters) -> SurfaceMap:
    """Return the map of a flight."""
    builder = MapBuilder(parameters)
    for keyframe in flight.keyframes:
        builder.add(keyframe)
    return builder.finish()


def scored(flight: Flight, parameters: Parameters) -> Score:
    """Map a flight and score the map."""
    surface = mapped(flight, parameters)
    true = truth(flight.scene, surface.cell_size, surface.gap_size, surface.thickness)
    return score(surface, true)


def _growing(stages: Sequence[Stage]) -> Iterator[tuple[str, tuple[Stage, ...]]]:
    """Yield pipelines, each with one more kind of stage than the last: its name, and all stages.

    Stages are added in the order of `ADDED`, then those not in it; each pipeline has its stages in
    the order of the whole one.
    """
    yield NO_STAGE, ()
    added = [name for name in ADDED if any(stage.name == name for stage in stages)]
    others = list(dict.fromkeys(stage.name for stage in stages if stage.name not in ADDED))
    names: set[str] = set()
    for name in added + others:
        names.add(name)
        yield name, tuple(stage for stage in stages if stage.name in names)


def _mean_row(scene: str, share: float, stages: str, scores: Sequence[Score]) -> StageWorth:
    """Return the row of several scores: means of shares and errors, sums of counts."""

    def mean(values: Iterable[float | None]) -> float:
        known = [value for value in values if value is not None]
        return sum(known) / len(known) if known else 0.0

    sigma = Noise().sigma.vertical
    totals = [each.total for each in scores]
    reds = [each.honest_red.share for each in scores if each.honest_red.of]
    return StageWorth(
        scene,
        share,
        stages,
        completeness=mean(total.completeness.share for total in totals),
        correctness=mean(total.correctness.share for total in totals),
        rmse=mean(total.heights.rmse for total in totals) / sigma,
        bias=mean(total.heights.bias for total in totals) / sigma,
        missed=sum(each.levels_missed for each in scores),
        false=sum(each.false_levels for each in scores),
        phantom=sum(each.phantom_closings.count for each in scores),
        honest_red=mean(reds) if reds else None,
        flat_called_vertical=mean(total.flat_called_vertical.share for total in totals),
    )


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
    lines = []
    for scene in dict.fromkeys(row.scene for row in rows):
        lines += [f"## {scene}", "", _HEAD, _RULE]
        lines += [_markdown_row(row) for row in rows if row.scene == scene]
        lines.append("")
    worse = [row for row in rows if row.worse]
    lines += ["## Stages that make a scene worse", ""]
    lines += [f"- {row.stages}: {row.scene} with {row.outliers:.0%} outliers" for row in worse]
    if not worse:
        lines.append("None.")
    return "\n".join(lines) + "\n"


_COLUMNS = (
    *("outliers", "stages", "complete %", "correct %", "rmse / sigma", "bias / sigma"),
    *("missed", "false", "phantom", "honest red %", "flat called vertical %"),
)
_HEAD = f"| {' | '.join(_COLUMNS)} |"
_RULE = f"|{'|'.join(['--:', ':--', *['--:'] * (len(_COLUMNS) - 2)])}|"


def _markdown_row(row: StageWorth) -> str:
    red = "" if row.honest_red is None else f"{100 * row.honest_red:.1f}"
    stage = row.stages if row.stages == NO_STAGE else f"+ {row.stages}"
    cells = (
        f"{row.outliers:.0%}",
        f"{stage} (worse)" if row.worse else stage,
        f"{100 * row.completeness:.2f}",
        f"{100 * row.correctness:.2f}",
        f"{row.rmse:.3f}",
        f"{row.bias:+.3f}",
        f"{row.missed:,}",
        f"{row.false:,}",
        f"{row.phantom:,}",
        red,
        f"{100 * row.flat_called_vertical:.2f}",
    )
    return f"| {' | '.join(cells)} |"
