"""``mls compare``: two maps patch by patch, or a map against the truth, or against a scan."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.options import PARTLY_READ, as_json, refuse_given
from mlscli.commands.reading import FormatsInHelp, read_points, reading
from mlscli.errors import InputError, UsageError

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.scoring import (
        Comparison,
        Differences,
        EndErrors,
        HeightErrors,
        Measures,
        MeshScore,
        OriginScore,
        ScanScore,
        Score,
        Share,
        Spread,
    )

# Exit statuses as of diff and cmp: maps that cannot be compared must not pass for different ones.
DIFFER, TROUBLE = 1, 2

_PLACES = {
    "under_deck": "under a deck",
    "in_window": "in a window",
    "in_hole": "in a hole of the ground",
    "off_level": "off their level",
    "elsewhere": "elsewhere",
}


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
    "--cloud",
    "scans",
    multiple=True,
    metavar="SCAN",
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
    scans: tuple[str, ...],
    within: float | None,
    flights: tuple[str, ...],
    as_json: bool,
    **selection: Any,
) -> int:
    """Compare two maps patch by patch, or a map with the truth, or with a dense scan.

    With A and B: exit status 0 where they do not differ, 1 where they do, 2 where they cannot be
    compared. With A and --truth T: how complete, correct and exact the map is. With A and --cloud
    SCAN: precision, recall and F-score of its mesh, where upright things end, and the levels.

    SCAN is read as mls build would, with the same options: FORMATS.
    """
    if (other is not None) + (truth is not None) + bool(scans) != 1:
        raise UsageError(
            "B: name either a second map, or the truth with --truth T, or a scan with --cloud SCAN"
        )
    if other is None and tolerance is not None:
        instead = "with a scan, --within" if scans else "against the truth it is half a cell"
        raise UsageError(f"--tolerance: goes with two maps; {instead}")
    if not scans:
        refuse_given("goes with --cloud SCAN", "within", "flights", *selection)
    with _trouble(f"{map_file} and {other or truth or ', '.join(scans)}"):
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
        click.echo(_comparison_text(a, b, comparison))
    return DIFFER if comparison.differ else 0


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
        click.echo(_score_text(map_file, truth_file, result))
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
        click.echo(_scan_text(map_file, ", ".join(scans), result))
    return PARTLY_READ if losses else 0


# --- as text ---


def _comparison_text(a: str, b: str, comparison: Comparison) -> str:
    if comparison.identical:
        verdict = "identical"
    elif comparison.differ:
        verdict = "differ"
    else:
        verdict = f"equal within {comparison.tolerance:.6g}"
    total, tolerance = comparison.total, comparison.tolerance
    rows = [
        *[(name, f"{one} and {two}") for name, (one, two) in comparison.grid.items()],
        ("patches", _matched(total, a, b)),
        ("heights", _spread(total.heights, tolerance)),
        ("depths", _spread(total.depths, tolerance)),
        ("columns", _columns(comparison)),
        *[
            (name, _matched(part, a, b) + _spread(part.heights, tolerance, before="; heights "))
            for name, part in comparison.by_origin.items()
        ],
    ]
    return f"{a} and {b}: {verdict}\n{report.lines(rows)}"


def _matched(part: Differences, a: str, b: str) -> str:
    return report.counts(
        {"matched": part.matched, f"only in {a}": part.only_a, f"only in {b}": part.only_b}
    )


def _columns(comparison: Comparison) -> str:
    differing = ", ".join(f"{name} of {n:,}" for name, n in comparison.columns.items())
    return f"differ in {differing}" if differing else ""


def _spread(spread: Spread, tolerance: float, before: str = "") -> str:
    if not spread.maximum:
        return ""
    return (
        f"{before}rmse {spread.rmse:.6g}, median {spread.median:.6g}, 95 % {spread.p95:.6g}, "
        f"maximum {spread.maximum:.6g}; {spread.beyond:,} differ by more than {tolerance:.6g}"
    )


def _score_text(map_file: str, truth_file: str, result: Score) -> str:
    total = result.total
    by_shape = (
        f"horizontal {_percent(total.completeness_horizontal)}, "
        f"vertical {_percent(total.completeness_vertical)}"
    )
    per_cell = result.false_levels_per_cell
    rows = [
        ("completeness", f"{_share(total.completeness)} true patches found; {by_shape}"),
        ("correctness", f"{_share(total.correctness)} patches on a true surface"),
        ("heights", _errors(total.heights)),
        (
            "false levels",
            f"{result.false_levels:,}"
            + ("" if per_cell is None else f", {per_cell:.6g} for each true cell"),
        ),
        ("levels missed", f"{result.levels_missed:,}"),
        ("phantom closings", f"{_share(result.phantom_closings)} inserted patches"),
        ("their places", _places(result)),
        ("honest red", f"{_share(result.honest_red)} artificial patches on a true surface"),
        ("flat called vertical", f"{_share(total.flat_called_vertical)} flat true patches"),
        *[(origin, _measures(part)) for origin, part in result.by_origin.items()],
    ]
    return f"{map_file} against {truth_file}\n{report.lines(rows)}"


def _places(result: Score) -> str:
    numbers = {place: sum(by.values()) for place, by in result.phantom_places.items()}
    return report.counts({_PLACES[place]: number for place, number in numbers.items()})


def _measures(part: Measures) -> str:
    if not part.correctness.of:
        return ""
    return (
        f"{_percent(part.completeness)} found by these alone, "
        f"{_percent(part.correctness)} correct; heights {_errors(part.heights)}"
    )


def _errors(errors: HeightErrors) -> str:
    if not errors.patches:
        return "none to compare"
    return (
        f"rmse {errors.rmse:.6g}, bias {errors.bias:.6g}, 95 % {errors.p95:.6g} "
        f"in {errors.patches:,} patches"
    )


def _share(share: Share) -> str:
    return f"{_percent(share)}: {share.count:,} of {share.of:,}"


def _percent(share: Share) -> str:
    return "-" if share.share is None else f"{100 * share.share:.2f} %"


def _scan_text(map_file: str, scan: str, result: ScanScore) -> str:
    mesh, columns = result.mesh, result.columns
    missed = columns.uprights_missed
    rows = [
        ("within", f"{mesh.within:.6g}"),
        ("precision", f"{_percent_of(mesh.precision)} of the mesh is near the scan{_beside(mesh)}"),
        ("recall", f"{_percent_of(mesh.recall)} of the scan is near the mesh"),
        ("F-score", _percent_of(mesh.f)),
        ("points", f"{mesh.points:,} count{_unseen(mesh)}; {_percent_of(mesh.points_found)} near"),
        *[(origin, _origin(part)) for origin, part in mesh.by_origin.items()],
        ("uprights", f"{_share(missed)} are missed" if missed.of else ""),
        ("upper ends", _ends(columns.upper_ends, mesh.within)),
        ("lower ends", _ends(columns.lower_ends, mesh.within)),
        ("levels", f"agree in {_share(columns.levels_agree)} cells"),
    ]
    return f"{map_file} against {scan}\n{report.lines(rows)}"


def _percent_of(share: float) -> str:
    return f"{100 * share:.2f} %"


def _beside(mesh: MeshScore) -> str:
    if not mesh.beside:
        return ""
    return f"; {_percent_of(mesh.beside)} of it lies beside the scan and is not judged"


def _unseen(mesh: MeshScore) -> str:
    return f", {_percent_of(1 - mesh.unseen)} of all: the flight's" if mesh.unseen else ""


def _origin(part: OriginScore) -> str:
    if part.precision is None:
        return ""
    return (
        f"{_percent_of(part.share)} of the mesh, {_percent_of(part.precision)} of it right; "
        f"without it precision {100 * part.precision_lost:+.2f}, recall "
        f"{0.0 - 100 * part.recall_won:+.2f}"
    )


def _ends(ends: EndErrors, within: float) -> str:
    if ends.median is None:
        return ""
    return (
        f"median {ends.median:+.3g}, 5 % {ends.p5:+.3g}, 95 % {ends.p95:+.3g}; more than "
        f"{within:.6g} too low {_share(ends.too_low)}, too high {_percent(ends.too_high)}"
    )
