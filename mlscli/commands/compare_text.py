"""What ``mls compare`` found, as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mlscli.commands import report
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.scoring import (
        Changes,
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
        Thing,
    )

# So many things that appeared or went are told one by one.
_MOST_THINGS = 20

_PLACES = {
    "under_deck": "under a deck",
    "in_window": "in a window",
    "in_hole": "in a hole of the ground",
    "off_level": "off their level",
    "elsewhere": "elsewhere",
}


def comparison_text(a: str, b: str, comparison: Comparison) -> str:
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


def score_text(map_file: str, truth_file: str, result: Score) -> str:
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


def scan_text(map_file: str, scan: str, result: ScanScore) -> str:
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


def changes_text(a: str, b: str, result: Changes) -> str:
    """Return what appeared and went from one map to another."""
    appeared, went = result.smaller
    rows = [
        *_things("appeared", result.appeared),
        *_things("gone", result.gone),
        ("smaller", report.counts({"appeared": appeared, "gone": went})),
        ("not seen again", _patches(result.not_seen_again, a)),
        ("not seen before", _patches(result.not_seen_before, b)),
    ]
    verdict = "changed" if result.changed else "nothing appeared or went where both looked"
    return f"{a} to {b}: {verdict}\n{report.lines(rows)}".rstrip()


def _things(name: str, things: Sequence[Thing]) -> list[tuple[str, str]]:
    rows = [(name if not n else "", _thing(thing)) for n, thing in enumerate(things[:_MOST_THINGS])]
    more = len(things) - _MOST_THINGS
    return [*rows, *([("", f"and {more:,} more, see --json")] if more > 0 else [])]


def _thing(thing: Thing) -> str:
    ends = dict(zip("xyz", zip(thing.low, thing.high, strict=True), strict=True))
    return report.bounds(ends)


def _patches(number: int, name: str) -> str:
    return f"{some(number, 'patch')} of {name}" if number else ""
