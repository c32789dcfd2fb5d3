"""Flights mapped with more and more stages of the pipeline: what trials of quality share.

Each flight is mapped with no stage, then with one stage more at a time, each in its place in the
pipeline.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.stage import Stage
from mlscli.runtime.notices import notice
from mlscli.scenes.flight import Flight
from mlscli.scenes.scan_flight import ScanFlight
from mlscli.scenes.scans import Scan

Site = TypeVar("Site", str, Scan)
Flown = TypeVar("Flown", Flight, ScanFlight)

# The stages, in the order in which they are added: points first, then as the thesis has them; last,
# one that it does not have.
ADDED = ("rays", "median", "orphans", "plaster", "pyramids", "walls")
NO_STAGE = "none"
OUTLIER_SHARES = (0.0, 0.1, 0.2, 0.3)

WORSE_BY = 0.002
"""A stage makes maps worse where it lowers their agreement, 0 to 1, by more."""


def flown_by_share(
    sites: Sequence[Site],
    shares: Sequence[float],
    seeds: Iterable[int],
    fly: Callable[[Site, float, int], Flown],
    progress: Progress | None = None,
) -> Iterator[tuple[Site, float, list[Flown]]]:
    """Yield each site with each share of outliers, and its flights, one for each seed.

    Parameters
    ----------
    sites : sequence of str or Scan
        Scenes by name, or scans.
    shares : sequence of float
        Probabilities of salt and pepper.
    seeds : iterable of int
        At least one.
    fly : callable
        Makes the flight over a site with a share and a seed.
    progress : callable, optional
        Called with the site and share that come next, how many sites are done, and how many there
        are.

    Raises
    ------
    UsageError
        Where there is no seed.
    """
    seeds = list(seeds)
    if not seeds:
        raise UsageError("`seeds`: expected at least one")
    for number, site in enumerate(sites):
        for share in shares:
            if progress is not None:
                name = site if isinstance(site, str) else site.name
                progress(f"{name}, {share:.0%}", number, len(sites))
            yield site, share, [fly(site, share, seed) for seed in seeds]


def maps_by_stage(
    flights: Sequence[Flight | ScanFlight], parameters: Parameters
) -> Iterator[tuple[str, list[SurfaceMap]]]:
    """Yield the stage that was added last, or `NO_STAGE`, and the map of each flight.

    What is ``auto`` in the parameters is found from each flight, before any stage, with a notice
    where that is doubtful. A stage that does nothing in any of them is left out.
    """
    report = Report()
    chosen = [settled(parameters, flight.keyframes, report) for flight in flights]
    for doubt in dict.fromkeys(report.doubts):
        notice(doubt)
    for last, names in _growing([each.pipeline for each in chosen]):
        yield (
            last,
            [
                mapped(flight, replace(each, pipeline=_named(names, each.pipeline)))
                for flight, each in zip(flights, chosen, strict=True)
            ],
        )


def mapped(flight: Flight | ScanFlight, parameters: Parameters) -> SurfaceMap:
    """Return the map of a flight; its cells must have a size."""
    builder = MapBuilder(parameters)
    for keyframe in flight.keyframes:
        builder.add(keyframe)
    return builder.finish()


def _growing(pipelines: Sequence[tuple[Stage, ...]]) -> Iterator[tuple[str, set[str]]]:
    """Yield names of stages, each time one more: the one that was added, and all so far.

    Stages are added in the order of `ADDED`, then those not in it.
    """
    yield NO_STAGE, set()
    doing = dict.fromkeys(
        stage.name for stages in pipelines for stage in stages if not _does_nothing(stage)
    )
    added = [name for name in ADDED if name in doing]
    added += [name for name in doing if name not in ADDED]
    for number, name in enumerate(added, start=1):
        yield name, set(added[:number])


def _does_nothing(stage: Stage) -> bool:
    return isinstance(stage, Rays) and stage.noise == 0


def _named(names: set[str], stages: Sequence[Stage]) -> tuple[Stage, ...]:
    """Return the stages that have one of the names, in their order."""
    return tuple(stage for stage in stages if stage.name in names)


# --- reports ---


class Line(NamedTuple):
    """A line of the report.

    Attributes
    ----------
    site : str
        The scene or scan.
    outliers : float
        The probability of salt and pepper, 0 to 1.
    stages : str
        The stage that was added last, or `NO_STAGE`.
    worse : bool
        Whether it makes the maps worse.
    scores : tuple of str
        The scores, as text.
    """

    site: str
    outliers: float
    stages: str
    worse: bool
    scores: tuple[str, ...]


def as_markdown(lines: Sequence[Line], scores: Sequence[str], what: str) -> str:
    """Return a table for each site, and a list of the stages that make one worse.

    Parameters
    ----------
    lines : sequence of Line
    scores : sequence of str
        What the scores are, the heads of their columns.
    what : str
        What a site is, in a word.
    """
    head = ("outliers", "stages", *scores)
    rule = f"|{'|'.join(['--:', ':--', *['--:'] * len(scores)])}|"
    text = []
    for site in dict.fromkeys(line.site for line in lines):
        text += [f"## {site}", "", _row(head), rule]
        text += [_row(_cells(line)) for line in lines if line.site == site]
        text.append("")
    worse = [line for line in lines if line.worse]
    text += [f"## Stages that make a {what} worse", ""]
    text += [f"- {line.stages}: {line.site} with {line.outliers:.0%} outliers" for line in worse]
    if not worse:
        text.append("None.")
    return "\n".join(text) + "\n"


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cells(line: Line) -> tuple[str, ...]:
    stage = line.stages if line.stages == NO_STAGE else f"+ {line.stages}"
    stage = f"{stage} (worse)" if line.worse else stage
    return (f"{line.outliers:.0%}", stage, *line.scores)
