"""What each stage is worth on real places: flights over dense scans, scored by these.

Every scan is flown over by `fly_scan` and mapped with more and more stages, see
`mlscli.trials.staged`. The whole scan counts, also what no flight has seen, and all of the mesh is
judged: a map wins nothing by what it leaves out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import mean
from typing import Any

from mlscli.errors import InputError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Progress
from mlscli.scenes.noise import Noise
from mlscli.scenes.scan_flight import FEATURES, ScanFlight, fly_scan
from mlscli.scenes.scans import Scan
from mlscli.scoring import MeshScore, score_scan
from mlscli.trials.staged import (
    OUTLIER_SHARES,
    WORSE_BY,
    Line,
    as_markdown,
    flown_by_share,
    maps_by_stage,
)


@dataclass(frozen=True)
class StageWorth:
    """Scores of the maps of a scan made with the stages up to one of them, means over all seeds.

    Attributes
    ----------
    cloud : str
        Name of the scan.
    outliers : float
        The probability of salt and pepper, 0 to 1.
    stages : str
        The stage that was added last, or ``none``; those added before run, too.
    cell_size : float
        Side of a cell, in the unit of the scan: the distance at which mesh and scan agree.
    seen : float
        The share of the scan's area that the flights see.
    precision, recall, f : float
        Shares of the mesh near the scan, and of the scan near the mesh, and their harmonic mean.
    precision_without_red, recall_without_red, f_without_red : float
        The same of the mesh without its artificial triangles.
    red_right : float or None
        The share of the artificial triangles' area that is near the scan; None where there is none.
    worse : bool
        Whether the stage that was added last makes the maps worse: whether it lowers `f` by more
        than `WORSE_BY`.
    """

    cloud: str
    outliers: float
    stages: str
    cell_size: float
    seen: float
    precision: float
    recall: float
    f: float
    precision_without_red: float
    recall_without_red: float
    f_without_red: float
    red_right: float | None
    worse: bool = False


def table(
    scans: Sequence[Scan],
    shares: Sequence[float] = OUTLIER_SHARES,
    seeds: Iterable[int] = (1,),
    noise: Noise | None = None,
    features: int = FEATURES,
    parameters: Parameters | None = None,
    progress: Progress | None = None,
) -> list[StageWorth]:
    """Return a row for each scan, share of outliers and stage added, over all seeds.

    Parameters
    ----------
    scans : sequence of Scan
    shares : sequence of float
        Probabilities of salt and pepper.
    seeds : iterable of int
        Seeds of the flights, at least one.
    noise : Noise, optional
        How points are displaced, but for the salt and pepper; by default ``Noise()``.
    features : int
        How many points a keyframe finds at most.
    parameters : Parameters, optional
        Those of the maps, whose stages are added one by one; the defaults where none are given.
    progress : callable, optional
        As for `flown_by_share`.

    Raises
    ------
    UsageError
        Where there is no seed, or `fly_scan` refuses a value.
    InputError
        Where nothing is left of a flight to make a map of.
    """
    noise = noise or Noise()
    parameters = Parameters() if parameters is None else parameters

    def fly(scan: Scan, share: float, seed: int) -> ScanFlight:
        return fly_scan(scan, features, replace(noise, salt_pepper=share), seed=seed)

    rows: list[StageWorth] = []
    for scan, share, flights in flown_by_share(scans, shares, seeds, fly, progress):
        before = None
        try:
            for stages, maps in maps_by_stage(flights, parameters):
                row = _mean_row(scan, share, stages, flights, maps)
                row = replace(row, worse=before is not None and row.f < before.f - WORSE_BY)
                rows.append(row)
                before = row
        except InputError as error:
            raise InputError(f"{scan.name}: {error}") from None
    return rows


def _mean_row(
    scan: Scan,
    share: float,
    stages: str,
    flights: Sequence[ScanFlight],
    maps: Sequence[SurfaceMap],
) -> StageWorth:
    """Return the row of several maps of a scan: the means of their scores."""
    scores = [score_scan(surface, scan.xyz, whole=True).mesh for surface in maps]
    without = [_without_red(score) for score in scores]
    red = [score.by_origin["artificial"].precision for score in scores]
    right = [each for each in red if each is not None]
    return StageWorth(
        scan.name,
        share,
        stages,
        cell_size=mean(surface.cell_size for surface in maps),
        seen=mean(flight.seen for flight in flights),
        precision=mean(score.precision for score in scores),
        recall=mean(score.recall for score in scores),
        f=mean(score.f for score in scores),
        precision_without_red=mean(precision for precision, _ in without),
        recall_without_red=mean(recall for _, recall in without),
        f_without_red=mean(
            2 * precision * recall / (precision + recall) if precision + recall else 0.0
            for precision, recall in without
        ),
        red_right=mean(right) if right else None,
    )


def _without_red(score: MeshScore) -> tuple[float, float]:
    """Return precision and recall of a mesh without its artificial triangles."""
    red = score.by_origin["artificial"]
    return score.precision + red.precision_lost, score.recall - red.recall_won


# --- reports ---

_SCORES = (
    *("cell", "seen %", "precision %", "recall %", "F %"),
    *("without red: precision %", "recall %", "F %", "red right %"),
)


def to_dict(rows: Sequence[StageWorth]) -> list[dict[str, Any]]:
    """Return the rows, ready for JSON."""
    return [asdict(row) for row in rows]


def to_markdown(rows: Sequence[StageWorth]) -> str:
    """Return the rows as a table for each scan, and a list of the stages that make one worse."""
    lines = [
        Line(row.cloud, row.outliers, row.stages, row.worse, _score_cells(row)) for row in rows
    ]
    return as_markdown(lines, _SCORES, "scan")


def _score_cells(row: StageWorth) -> tuple[str, ...]:
    shares = (
        *(row.seen, row.precision, row.recall, row.f),
        *(row.precision_without_red, row.recall_without_red, row.f_without_red),
    )
    return (
        f"{row.cell_size:.3g}",
        *(f"{100 * share:.2f}" for share in shares),
        "" if row.red_right is None else f"{100 * row.red_right:.1f}",
    )
