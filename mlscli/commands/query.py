"""``mls query``: what a map says of places."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.options import as_json, least_lines, tell
from mlscli.errors import UsageError
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap


def not_kept(surface: SurfaceMap) -> str:
    """Return that a map does not say what was seen through, and what would help."""
    import numpy as np

    if np.isfinite(surface.route[:, 1:]).all(axis=1).any():
        return "the map does not say what was seen through; build it with --free-space"
    return (
        "the map does not say what was seen through, nor where the craft was, from which that "
        "would follow; build it of a recording with positions, or with --route, and --free-space"
    )


@click.command()
@click.argument("source", metavar="MAP")
@click.option(
    "--at",
    "places",
    metavar="X,Y[,Z]",
    multiple=True,
    required=True,
    help="A place, in the frame and the unit of the map; more may be named.",
)
@least_lines
@as_json
def command(source: str, places: tuple[str, ...], least: int, as_json: bool) -> None:
    """Say what a map holds at places: levels, and free space between them.

    The levels of the cell in which a place lies are told from above, each with its origin, how many
    points measured it, their standard deviation (sigma), and that of the height's error. Space is
    free only where the map says that it was seen through (mls build --free-space); all other space
    is unknown. Of a place with a z it is said, too, how far the levels below and above it are.
    """
    at = [(place, _numbers(place)) for place in places]

    from mlscli.io.writing.npz import read_map

    surface = read_map(source)
    results = [_told(surface, numbers, least) for _, numbers in at]
    if as_json:
        click.echo(json.dumps(results, indent=2))
        return
    for (place, _), result in zip(at, results, strict=True):
        ix, iy = result["cell"]
        tell(f"{place} (cell {ix}, {iy})")
        tell(report.lines(_rows(result, surface.cell_size)))
    if surface.free is None:
        tell(not_kept(surface))


def _numbers(place: str) -> list[float]:
    try:
        numbers = [float(number) for number in place.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise UsageError(
            f"--at {place}: expected two or three numbers, as in --at 1.5,-3 or --at 1.5,-3,2"
        )
    return numbers


def _told(surface: SurfaceMap, at: list[float], least: int) -> dict[str, Any]:
    """Return what a map says of a place, as JSON has it."""
    from mlscli.queries.column import column_at

    column = column_at(surface, at[0], at[1], least)
    errors = [
        None if math.isnan(variance) else math.sqrt(variance)
        for variance in surface.take(column.patch).height_variance.tolist()
    ]
    levels = [
        _level(surface, patch) | {"error": error}
        for patch, error in zip(column.patch.tolist(), errors, strict=True)
    ]
    result: dict[str, Any] = {
        "at": at,
        "cell": [column.ix, column.iy],
        "levels": levels,
        "free": None if column.free is None else column.free.tolist(),
    }
    return result | _around(surface, at, levels, least) if len(at) == 3 else result


def _level(surface: SurfaceMap, patch: int) -> dict[str, Any]:
    from mlscli.maps.surface_map import MEASURED, ORIGINS

    is_measured = surface.origin[patch] == MEASURED
    keyframes = [int(surface.first_keyframe[patch]), int(surface.last_keyframe[patch])]
    region = int(surface.region[patch])
    return {
        "height": float(surface.height[patch]),
        "depth": float(surface.depth[patch]),
        "origin": ORIGINS[surface.origin[patch]],
        "moved": bool(surface.moved[patch]),
        "points": int(surface.count[patch]),
        "sigma": math.sqrt(surface.variance[patch]) if is_measured else None,
        "keyframes": keyframes if is_measured and keyframes[0] >= 0 else None,
        "region": region if region >= 0 else None,
    }


def _around(
    surface: SurfaceMap, at: list[float], levels: list[dict[str, Any]], least: int
) -> dict[str, Any]:
    """Return what is known of a place, and how far it is from the levels below and above it."""
    z = at[2]
    below = [z - level["height"] for level in levels if level["height"] <= z]
    above = [low - z for low in (level["height"] - level["depth"] for level in levels) if low > z]
    return {
        "space": _space(surface, at, least),
        "above_level": min(below, default=None),
        "below_level": min(above, default=None),
    }


def _space(surface: SurfaceMap, at: list[float], least: int) -> str:
    import numpy as np

    from mlscli.maps.space import SPACES, UNKNOWN, space_at

    known = UNKNOWN if surface.free is None else space_at(surface, np.array([at]), least)[0]
    return SPACES[known]


# --- as text ---


def _rows(result: dict[str, Any], cell_size: float) -> list[tuple[str, str]]:
    decimals = max(0, 2 - math.floor(math.log10(cell_size)))

    def number(value: float) -> str:
        return f"{value:.{decimals}f}"

    spans = sorted(_spans(result, number), reverse=True)
    if not spans:
        seen = "" if result["free"] is None else ", and nothing seen through"
        return [("nothing", f"no patch{seen}"), *_of_z(result, number)]
    rows = [(f"above {number(spans[0][0])}", "unknown")]
    for n, (high, low, text) in enumerate(spans):
        if n and spans[n - 1][1] - high > cell_size / 2:
            rows.append((f"{number(high)} to {number(spans[n - 1][1])}", "unknown"))
        rows.append((f"{number(low)} to {number(high)}" if high > low else number(high), text))
    rows.append((f"below {number(spans[-1][1])}", "unknown"))
    return [*rows, *_of_z(result, number)]


def _spans(result: dict[str, Any], number: Any) -> Iterator[tuple[float, float, str]]:
    """Yield upper end, lower end and description of each level and of each free interval."""
    for low, high in result["free"] or []:
        yield high, low, "free"
    for level in result["levels"]:
        words = [level["origin"]]
        if level["depth"]:
            words.append("vertical")
        if level["moved"]:
            words.append("drawn beyond its points")
        if level["points"]:
            words.append(some(level["points"], "point"))
        if level["sigma"] is not None and level["points"] > 1:
            words.append(f"sigma {number(level['sigma'])}")
        if level["error"] is not None:
            words.append(f"error {number(level['error'])}")
        if level["keyframes"]:
            # Counted from 1, as in the summary of a build.
            first, last = (row + 1 for row in level["keyframes"])
            words.append(f"keyframe {first}" if first == last else f"keyframes {first} to {last}")
        if level["region"] is not None:
            words.append(f"region {level['region']}")
        yield level["height"], level["height"] - level["depth"], ", ".join(words)


def _of_z(result: dict[str, Any], number: Any) -> Iterator[tuple[str, str]]:
    if "space" not in result:
        return
    words = [result["space"]]
    if result["above_level"] is not None:
        words.append(f"{number(result['above_level'])} above a level")
    if result["below_level"] is not None:
        words.append(f"{number(result['below_level'])} below one")
    yield f"z {result['at'][2]:g}", ", ".join(words)
