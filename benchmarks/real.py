"""Sparse, noisy samples of real dense scans, mapped, and scored against the scan.

Run it as ``python -m benchmarks.real``; it takes half an hour, with ``--how drawn`` five minutes,
and needs the scans that `benchmarks/scans.py` names. Whatever is made of a sample is scored by
`mlscli.scoring` over the whole scan, at one distance: the cell that suits the sample's points
without noise (`cell_of`). So coarser cells win nothing. Figures are means over the seeds. Rules are
tuned on seeds 1 to 3; by default, others are shown.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import mean
from typing import TypeAlias

import click
import numpy as np

from benchmarks.instead import INSTEAD, mesh
from benchmarks.scans import (
    DATA,
    FEATURES,
    GROUND,
    SCANS,
    Sample,
    cell_of,
    drawn,
    flown,
    read,
)
from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.commands.options import configured
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.runtime.arrays import Float64
from mlscli.scoring import ColumnScore, MeshScore, Share, score_columns, score_mesh, score_scan
from mlscli.scoring.kernels import nearby, nearest

SHOWN = (4, 5, 6)
RANDOM, FLOWN, SLAM = HOW = "drawn", "flown", "slam"
DEFAULT, PLAIN, THESIS = "default", "plain", "thesis"
DRAWN = "points as drawn"
# No filter, but without the points that err by more than a cell, which only the trial knows.
KNOWN = "outliers known"
THESIS_CELL = 0.15

# Levels of the default pipeline. F must also be above that of all that is used instead.
LEAST_F = {"footbridge": 0.92}
LEAST_F_ELSEWHERE = 0.97
MOST_LOST, LEAST_RIGHT = 0.01, 0.7
MOST_LOWERED = 0.01
LEAST_GROUND = 0.97

LEVEL_HEAD = (
    *("scan", "how", "points", "F", "at least", "best other", "its F"),
    *("red costs", "right", "known tops lowered", "missed"),
)
HEAD = (
    *("scan", "how", "points", "what", "cell", "precision", "recall", "F", "found"),
    *("red", "right", "costs", "wins", "tops missed", "lowered", "feet raised"),
    *("known tops missed", "lowered", "feet raised", "levels agree"),
)

# Makes a map of a sample; and by how much the scene was scaled for it.
Pipeline: TypeAlias = Callable[[Sample], tuple[SurfaceMap, float]]


@dataclass(frozen=True)
class Scored:
    """What was made of a sample, and how right it is.

    Attributes
    ----------
    scan : str
        The scan that was sampled.
    how : str
        One of `HOW`: points drawn at random, or those of a flight, with the same noise or that of
        triangulation.
    points, seed : int
        How many points; of flights, how many a keyframe finds at most.
    what : str
        A pipeline, or what was used instead.
    cell : float
        The size of its cells, where it has any.
    mesh : MeshScore
        How right it is.
    columns : ColumnScore or None
        How right its columns are by the scan; None for what is no map.
    known : ColumnScore or None
        The same by what can be known from the sample, see `Sample.evidence`: an end is not lost by
        a map where no point shows it.
    """

    scan: str
    how: str
    points: int
    seed: int
    what: str
    cell: float
    mesh: MeshScore
    columns: ColumnScore | None = None
    known: ColumnScore | None = None


def pipelines(config: str | None = None, settings: Sequence[str] = ()) -> dict[str, Pipeline]:
    """Return the pipelines by name, the default one as configured."""

    def mapped(sample: Sample, parameters: Parameters, scale: float = 1.0) -> SurfaceMap:
        parameters = settled(parameters, sample.keyframes, Report())
        builder = MapBuilder(parameters)
        for keyframe in sample.keyframes:
            x, y, z = (scale * axis for axis in keyframe.position)
            builder.add(Keyframe(scale * keyframe.points, keyframe.stamp, (x, y, z)))
        return builder.finish()

    def thesis(sample: Sample) -> tuple[SurfaceMap, float]:
        # Its lengths are in metres, for cells of 0.15: the scene is scaled to have such cells.
        scale = THESIS_CELL / cell_of(sample.noisy)
        return mapped(sample, load("thesis"), scale), scale

    default, plain = load(config, settings), load("plain", ["map.cell_size=auto"])
    return {
        DEFAULT: lambda sample: (mapped(sample, default), 1.0),
        PLAIN: lambda sample: (mapped(sample, plain), 1.0),
        THESIS: thesis,
    }


ALL = (DRAWN, *pipelines(), *INSTEAD)


def made_of(
    sample: Sample, scan: Float64, what: str, chosen: Mapping[str, Pipeline], within: float
) -> tuple[float, MeshScore, ColumnScore | None, ColumnScore | None]:
    """Return the size of cells and the scores of what is made of a sample.

    Parameters
    ----------
    sample : Sample
    scan : float64 (N, 3)
        The scan that it was drawn from.
    what : str
        What to make, one of `ALL`, or `KNOWN`.
    chosen : mapping of str to Pipeline
        The pipelines.
    within : float
        The distance, in the unit of the scan.
    """
    if what == DRAWN:
        # Triangles of one point each, all right: so much can be found without closing a gap.
        own = np.arange(len(sample.clean))
        dots = mesh(sample.clean, np.column_stack((own, own, own)))
        score = score_mesh(dots, scan, within, whole=True)
        score = replace(score, precision=1.0, f=2 * score.recall / (1 + score.recall))
        return sample.cell, score, None, None
    if what == KNOWN:
        right = np.linalg.norm(sample.noisy - sample.clean, axis=1) <= cell_of(sample.noisy)
        # Where cameras were plays no part: `plain` follows no sight line.
        sample = sample._replace(keyframes=[Keyframe(sample.noisy[right])])
        what = PLAIN
    if what in INSTEAD:
        cell = cell_of(sample.noisy)
        score = score_mesh(INSTEAD[what](sample.noisy, cell), scan, within, whole=True)
        return cell, score, None, None
    surface, scale = chosen[what](sample)
    scaled, evidence, within = scale * scan, scale * sample.evidence, scale * within
    scored = score_scan(surface, scaled, within, whole=True)
    known = score_columns(surface, evidence, within)
    return surface.cell_size / scale, scored.mesh, scored.columns, known


# --- the tables ---


def cells(scores: Sequence[Scored]) -> tuple[str, ...]:
    """Return the cells of a row: means over the seeds."""
    first, red = scores[0], [score.mesh.by_origin["artificial"] for score in scores]
    return (
        first.scan,
        first.how,
        f"{first.points:,}",
        first.what,
        f"{mean(score.cell for score in scores):.3g}",
        _percent([score.mesh.precision for score in scores]),
        _percent([score.mesh.recall for score in scores]),
        _percent([score.mesh.f for score in scores]),
        _percent([score.mesh.points_found for score in scores]),
        *(
            [
                _percent([each.share for each in red]),
                _percent([each.precision for each in red]),
                _percent([each.precision_lost for each in red]),
                _percent([each.recall_won for each in red]),
            ]
            if any(each.share for each in red)
            else [""] * 4
        ),
        *_ends([score.columns for score in scores if score.columns is not None]),
        *_ends([score.known for score in scores if score.known is not None]),
        _all([score.columns.levels_agree for score in scores if score.columns is not None]),
    )


def _ends(columns: Sequence[ColumnScore]) -> tuple[str, str, str]:
    return (
        _all([each.uprights_missed for each in columns]),
        _all([each.upper_ends.too_low for each in columns]),
        _all([each.lower_ends.too_high for each in columns]),
    )


def _percent(shares: Sequence[float | None]) -> str:
    known = [share for share in shares if share is not None]
    return f"{100 * mean(known):.2f}" if known else ""


def _all(shares: Sequence[Share]) -> str:
    """Return the share of all seeds together, and of how many."""
    share = together(shares)
    return "" if share is None else f"{100 * share:.1f} of {sum(each.of for each in shares):,}"


def together(shares: Sequence[Share]) -> float | None:
    """Return the share of several counts together; None of nothing."""
    of = sum(share.of for share in shares)
    return sum(share.count for share in shares) / of if of else None


def summary(found: Sequence[Scored]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each sample: the F-scores of what was made of it, as means over the seeds."""
    for sample, by_what in by_sample(found).items():
        yield (*sample, *(_percent([score.mesh.f for score in each]) for each in by_what.values()))


def by_sample(found: Sequence[Scored]) -> dict[tuple[str, str, str], dict[str, list[Scored]]]:
    """Return the scores by scan, how it was sampled and number, and there by what was made."""
    result: dict[tuple[str, str, str], dict[str, list[Scored]]] = {}
    for score in found:
        sample = result.setdefault((score.scan, score.how, f"{score.points:,}"), {})
        sample.setdefault(score.what, []).append(score)
    return result


def levels(by_what: Mapping[str, Sequence[Scored]]) -> tuple[str, ...]:
    """Return the row of a sample in the table of levels, the last cell those that are missed.

    Parameters
    ----------
    by_what : mapping of str to sequence of Scored
        What was made of the sample, by name, a score for each seed.
    """
    mine = by_what[DEFAULT]
    least = LEAST_F.get(mine[0].scan, LEAST_F_ELSEWHERE)
    f = {what: mean(score.mesh.f for score in scores) for what, scores in by_what.items()}
    others = {what: f[what] for what in f if what not in (DEFAULT, DRAWN, KNOWN)}
    best = max(others, key=lambda what: others[what], default="")
    red = [score.mesh.by_origin["artificial"] for score in mine]
    lost = mean(each.precision_lost for each in red)
    right = [each.precision for each in red if each.precision is not None]
    known = [score.known.upper_ends.too_low for score in mine if score.known is not None]
    lowered = together(known)
    missed = {
        "F": f[DEFAULT] < least,
        "other": f[DEFAULT] <= others.get(best, 0.0),
        "costs": lost > MOST_LOST,
        "right": bool(right) and mean(right) < LEAST_RIGHT,
        "tops": (lowered or 0.0) > MOST_LOWERED,
    }
    return (
        *(mine[0].scan, mine[0].how, f"{mine[0].points:,}"),
        *(_percent([f[DEFAULT]]), f"{100 * least:g}"),
        *(best, _percent([others[best]]) if best else ""),
        *(_percent([lost]), _percent(right), _all(known)),
        ", ".join(name for name, is_missed in missed.items() if is_missed),
    )


def ground_found(surface: SurfaceMap, ground: Float64) -> float:
    """Return the share of points on the ground that have an upper end within a cell, in their cell.

    Parameters
    ----------
    surface : SurfaceMap
    ground : float64 (N, 3)
        Points that are truly on the ground.
    """
    ix, iy = cells_of(ground, surface.cell_size)
    order = np.lexsort((iy, ix))
    ix, iy, height = ix[order], iy[order], ground[order, 2]
    near = nearby(ix, iy, surface.ix, surface.iy, 0)
    found = nearest(height, near, surface.height, surface.height, surface.cell_size)
    return float(np.mean(found >= 0))


@click.command()
@click.argument("data", type=click.Path(path_type=Path), default=DATA)
@click.option("--scan", "scans", multiple=True, type=click.Choice(list(SCANS)), help="Only this.")
@click.option("--how", multiple=True, type=click.Choice(HOW), help="Only samples of this kind.")
@click.option("--row", "chosen", multiple=True, type=click.Choice((*ALL, KNOWN)), help="Only this.")
@click.option(
    "--seed", "seeds", multiple=True, type=int, default=SHOWN, show_default=True, help="Of samples."
)
@click.option(
    "--noisy-cell", is_flag=True, help="Score at the cell of the noisy points, which is greater."
)
@configured
@click.option("--json", "target", type=click.Path(path_type=Path), help="Write all scores there.")
def main(
    data: Path,
    scans: tuple[str, ...],
    how: tuple[str, ...],
    chosen: tuple[str, ...],
    seeds: tuple[int, ...],
    noisy_cell: bool,
    config: str | None,
    settings: tuple[str, ...],
    target: Path | None,
) -> None:
    """Print the tables; -c and --set configure the default pipeline."""
    if not data.is_dir():
        sys.exit(f"{data}: no such folder; the scans are not a part of the project")
    made, found = pipelines(config, settings), list[Scored]()

    def rows() -> Iterator[tuple[str, ...]]:
        for name in scans or SCANS:
            scan = SCANS[name].points(data)
            for way, points, samples in _samples(scan, SCANS[name].sizes, how or HOW, seeds):
                within = [cell_of(each.noisy) if noisy_cell else each.cell for each in samples]
                for what in chosen or ALL:
                    scores = [
                        Scored(name, way, points, seed, what, *made_of(sample, scan, what, made, x))
                        for seed, sample, x in zip(seeds, samples, within, strict=True)
                    ]
                    found.extend(scores)
                    yield cells(scores)

    for line in lines(HEAD, rows()):
        click.echo(line)
    click.echo("\nF-scores\n")
    for line in lines(("scan", "how", "points", *(chosen or ALL)), summary(found)):
        click.echo(line)
    click.echo(
        f"\nLevels: red costs at most {100 * MOST_LOST:g} and is right to {100 * LEAST_RIGHT:g}, "
        f"at most {100 * MOST_LOWERED:g} of the known tops are lowered\n"
    )
    reached = [levels(each) for each in by_sample(found).values() if DEFAULT in each]
    for line in lines(LEVEL_HEAD, reached):
        click.echo(line)
    for name in scans or SCANS:
        if name in GROUND:
            share = _percent([_ground(data, name, made[DEFAULT])])
            click.echo(f"\n{name}, whole: ground found {share}, at least {100 * LEAST_GROUND:g}")
    if target is not None:
        target.write_text(json.dumps([asdict(score) for score in found], indent=1))


def _samples(
    scan: Float64, sizes: Sequence[int], how: Sequence[str], seeds: Sequence[int]
) -> Iterator[tuple[str, int, list[Sample]]]:
    """Yield how samples were made, how many points were asked for, and a sample for each seed.

    Parameters
    ----------
    scan : float64 (N, 3)
    sizes : sequence of int
        How many points are drawn at random.
    how : sequence of str
        Which kinds of samples to make, of `HOW`.
    seeds : sequence of int
    """
    if RANDOM in how:
        for size in sizes:
            yield RANDOM, size, [drawn(scan, size, seed) for seed in seeds]
    if FLOWN in how or SLAM in how:
        for features in FEATURES:
            flights = [flown(scan, features, seed) for seed in seeds]
            for way, samples in zip((FLOWN, SLAM), zip(*flights, strict=True), strict=True):
                if way in how:
                    yield way, features, list(samples)


def _ground(data: Path, name: str, pipeline: Pipeline) -> float:
    """Return how much of the true ground is found in the map of a whole airborne scan."""
    points = SCANS[name].points(data)
    surface, _ = pipeline(Sample(points, points, points, cell_of(points), [Keyframe(points)]))
    return ground_found(surface, read(data / "multilevel" / GROUND[name]))


if __name__ == "__main__":
    main()
