"""``mls compare``: two maps patch by patch, or a map against the truth, or against a scan."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands.compare_text import changes_text, comparison_text, scan_text, score_text
from mlscli.commands.options import PARTLY_READ, as_json, refuse_given, tell
from mlscli.commands.piped import piped
from mlscli.commands.reading import FormatsInHelp, read_points, reading
from mlscli.errors import InputError, UsageError

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap

# Exit statuses as of diff and cmp: maps that cannot be compared must not pass for different ones.
DIFFER, TROUBLE = 1, 2


@click.command(cls=FormatsInHelp)
@click.argument("map_file", metavar="A")
@click.argument("other", metavar="[B]", required=False)
@click.option("--truth", metavar="T", help="The true surfaces, as a map: mls synth writes them.")
@click.option(
    "--tolerance",
    type=float,
    metavar="X",
    help="Heights and depths that differ by no more pass for equal.  [default: 0]",
)
@click.option(
    "--changed",
    is_flag=True,
    help="What appeared from A to B, and what went: what one flight measured and the other saw "
    "through. Both maps need mls build --free-space.",
)
@click.option(
    "--cloud",
    "scans",
    multiple=True,
    metavar="SCAN",
    callback=piped,
    help="A dense scan of the same place, in the map's frame. Several are taken as one.",
)
@click.option(
    "--within",
    type=float,
    metavar="X",
    help="With --cloud: map and scan agree where they are no farther apart. Maps are compared by "
    "scores at the same distance.  [default: a cell of the map]",
)
@click.option(
    "--flight",
    "flights",
    multiple=True,
    metavar="FILE",
    help="With --cloud: a recording that the map was made of. Only what the flight came near "
    "counts, not the whole scan. It is read with the options that the map was built with.",
)
@reading
@as_json
def command(
    map_file: str,
    other: str | None,
    truth: str | None,
    tolerance: float | None,
    changed: bool,
    scans: tuple[str, ...],
    within: float | None,
    flights: tuple[str, ...],
    as_json: bool,
    **selection: Any,
) -> int:
    """Compare two maps patch by patch, or a map with the truth, or with a dense scan.

    With A and B: exit status 0 where they do not differ, 1 where they do (with --changed: where
    anything appeared or went), 2 where they cannot be compared. With A and --truth T: how complete,
    correct and exact the map is. With A and --cloud SCAN: precision, recall and F-score of its
    mesh, where upright things end, and the levels.

    SCAN is read as mls build would, with the same options: FORMATS.
    """
    if (other is not None) + (truth is not None) + bool(scans) != 1:
        raise UsageError(
            "B: name either a second map, or the truth with --truth T, or a scan with --cloud SCAN"
        )
    if other is None and tolerance is not None:
        instead = "with a scan, --within" if scans else "against the truth it is half a cell"
        raise UsageError(f"--tolerance: goes with two maps; {instead}")
    if changed and (other is None or tolerance is not None):
        raise UsageError("--changed: goes with two maps, A and B, and without --tolerance")
    if not scans:
        refuse_given("goes with --cloud SCAN", "within", "flights", *selection)
    with _trouble(f"{map_file} and {other or truth or ', '.join(scans)}"):
        if other is not None and changed:
            return _changes(map_file, other, as_json)
        if other is not None:
            return _compare(map_file, other, tolerance or 0.0, as_json)
        if truth is not None:
            return _score(map_file, truth, as_json)
        return _score_scan(map_file, scans, selection, within, flights, as_json)


@contextmanager
def _trouble(names: str) -> Iterator[None]:
    """Give errors the exit status `TROUBLE`, and usage errors the names of the files."""
    try:
        yield
    except InputError as error:
        error.exit_status = TROUBLE
        raise
    except UsageError as error:
        raise UsageError(f"{names}: {error}") from None


def _compare(a: str, b: str, tolerance: float, as_json: bool) -> int:
    from mlscli.io.writing.npz import read_map
    from mlscli.scoring import compare_maps

    comparison = compare_maps(read_map(a), read_map(b), tolerance)
    if as_json:
        click.echo(json.dumps({"a": a, "b": b, **comparison.to_dict()}, indent=2))
    else:
        tell(comparison_text(a, b, comparison))
    return DIFFER if comparison.differ else 0


def _changes(a: str, b: str, as_json: bool) -> int:
    from mlscli.io.writing.npz import read_map
    from mlscli.scoring import changes

    result = changes(read_map(a), read_map(b))
    if as_json:
        click.echo(json.dumps({"a": a, "b": b, **result.to_dict()}, indent=2))
    else:
        tell(changes_text(a, b, result))
    return DIFFER if result.changed else 0


def _score(map_file: str, truth_file: str, as_json: bool) -> int:
    from mlscli.io.writing.npz import read_map
    from mlscli.scoring import score

    surface, truth = read_map(map_file), read_map(truth_file)
    try:
        truth = _on_grid_of(surface, truth)
    except InputError as error:
        raise InputError(f"{truth_file}: {error}") from None
    result = score(surface, truth)
    if as_json:
        click.echo(json.dumps({"map": map_file, "truth": truth_file, **result.to_dict()}, indent=2))
    else:
        tell(score_text(map_file, truth_file, result))
    return 0


def _on_grid_of(surface: SurfaceMap, truth: SurfaceMap) -> SurfaceMap:
    """Return the truth on the map's grid: recomputed if its grid differs and it has a scene."""
    if not surface.grid.differing(truth.grid) or "scene" not in truth.meta:
        return truth
    from mlscli.scenes.truth import truth_from_meta

    return truth_from_meta(truth.meta, surface.cell_size, surface.gap_size, surface.thickness)


def _score_scan(
    map_file: str,
    scans: Sequence[str],
    selection: dict[str, Any],
    within: float | None,
    flights: Sequence[str],
    as_json: bool,
) -> int:
    """Score a map by a scan.

    Parameters
    ----------
    map_file : str
    scans : sequence of str
        The files of the scan.
    selection : dict
        The options with which they are read, as for `mlscli.open_recording`.
    within : float or None
        The distance; None: a cell.
    flights : sequence of str
        The recordings that the map was made of; none: the whole scan counts.
    as_json : bool
    """
    from mlscli.io.reading.recording import open_recording
    from mlscli.io.writing.npz import read_map
    from mlscli.scoring import score_scan

    surface = read_map(map_file)
    scanned = open_recording(*scans, **selection)
    scan, flight, losses = read_points(scanned), None, list(scanned.losses)
    if flights:
        try:
            flown = open_recording(*flights, **surface.meta.get("reading", {}))
        except TypeError as error:
            raise InputError(
                f"{map_file}: meta: its key reading does not say how a flight is read: {error}"
            ) from None
        flight = read_points(flown)
        losses += flown.losses
    try:
        result = score_scan(surface, scan, within, flight=flight)
    except InputError as error:
        raise InputError(f"{map_file} and {', '.join(scans)}: {error}") from None
    if as_json:
        named = {"map": map_file, "cloud": list(scans), "flight": list(flights)}
        click.echo(json.dumps({**named, **result.to_dict(), "lost": losses}, indent=2))
    else:
        tell(scan_text(map_file, ", ".join(scans), result))
    return PARTLY_READ if losses else 0
