"""``mls clearance``: whether a craft fits along a way."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.flying import craft_size
from mlscli.commands.options import as_json, least_lines, overwrite, say, tell
from mlscli.commands.piped import piped
from mlscli.commands.query import not_kept
from mlscli.errors import UsageError

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.queries.clearance import Clearance
    from mlscli.runtime.arrays import Float64

DOES_NOT_FIT, NOT_KNOWN = 1, 4
"""The exit statuses where the craft does not fit, and where the map cannot tell."""

# So many stretches are told; --json has them all.
_MOST_STRETCHES = 12


@click.command()
@click.argument("source", metavar="MAP")
@craft_size
@click.option(
    "--along",
    type=click.Choice(("route",)),
    help="Along the route of the flight that the map was made from.",
)
@click.option(
    "--line",
    metavar="x0,y0,z0,x1,y1,z1,...",
    help="Along a polyline through these places, of the craft's middle.",
)
@click.option(
    "--path",
    metavar="FILE",
    callback=piped,
    help="Along the positions in a file: TUM, CSV, or whatever mls build --route reads.",
)
@least_lines
@click.option(
    "--mcap",
    metavar="FILE",
    help="Write the way, coloured by its clearance, for Lichtblick, Foxglove and RViz.",
)
@click.option(
    "--html",
    metavar="FILE",
    help="Write the page of the map, with the way coloured by its clearance.",
)
@overwrite
@as_json
def command(
    source: str,
    craft: tuple[float, float],
    along: str | None,
    line: str | None,
    path: str | None,
    least: int,
    mcap: str | None,
    html: str | None,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Say whether a craft fits along a way: fits, does not fit, doubtful, or never seen.

    The craft is an upright cylinder; the way is that of its middle, in the frame and the unit of
    the map. It is held against every cell that the craft reaches into. Free is what was seen
    through (mls build --free-space); without that, nothing is said to fit. Exit status: 0 it fits,
    1 it does not, 4 the map cannot tell.
    """
    ways = {"--along": along, "--line": line, "--path": path}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        what = f"{' and '.join(given)}: do not go together; choose" if given else "no way; give"
        raise UsageError(f"{what} one of --along route, --line and --path")

    from mlscli.io.writing.atomic import refuse_existing
    from mlscli.io.writing.npz import read_map
    from mlscli.queries.clearance import BLOCKED, FITS, clearance

    corners = None if line is None else _corners(line)
    sources = [source] if path is None else [source, path]
    for output in filter(None, (mcap, html)):
        refuse_existing(output, overwrite=overwrite, sources=sources)
    surface = read_map(source)
    if path is not None:
        corners = _positions(path)
    elif corners is None:
        corners = _route(surface, source)
    found = clearance(surface, corners, *craft, least)
    if mcap is not None:
        from mlscli.io.writing.way import write_way

        write_way(mcap, found, surface.frame_id, overwrite=overwrite)
    if html is not None:
        from mlscli.view.page import write_page

        write_page(html, surface, title=Path(html).stem, fitted=found, overwrite=overwrite)
    told = _told(surface, found, least)
    if as_json:
        click.echo(json.dumps(told, indent=2))
    else:
        tell(f"{Path(source).name}: {told['verdict']}")
        tell(report.lines(_rows(told, surface.cell_size)))
        if surface.free is None:
            tell(not_kept(surface))
        elif told["thin"]:
            tell(
                f"the craft is thinner than two cells, {2 * surface.cell_size:.3g}: a bare sheet "
                "or pane may stand in its way unnoticed; smaller cells would show it"
            )
    return {FITS: 0, BLOCKED: DOES_NOT_FIT}.get(found.overall, NOT_KNOWN)


def _corners(line: str) -> Float64:
    import numpy as np

    try:
        numbers = [float(number) for number in line.split(",")]
    except ValueError:
        numbers = []
    if not numbers or len(numbers) % 3 or not all(map(math.isfinite, numbers)):
        raise UsageError(f"--line {line}: expected x,y,z of each place, as in --line 0,-3,1,0,3,1")
    return np.array(numbers).reshape(-1, 3)


def _positions(path: str) -> Float64:
    from mlscli.io.clouds.trajectory import read_trajectory

    read = read_trajectory(Path(path))
    for note in (*read.notes, *read.losses):
        say(f"mls: {note}")
    return read.positions


def _route(surface: SurfaceMap, source: str) -> Float64:
    import numpy as np

    known = np.isfinite(surface.route[:, 1:]).all(axis=1)
    if not known.any():
        raise UsageError(f"--along route: {source} does not say where the craft was")
    return np.ascontiguousarray(surface.route[known, 1:])


# --- what is told ---


def _told(surface: SurfaceMap, found: Clearance, least: int) -> dict[str, Any]:
    """Return all that is found, as JSON has it."""
    from mlscli.queries.clearance import VERDICTS

    place, lengths = found.pieces.place, dict.fromkeys(VERDICTS, 0.0)
    stretches = []
    for stretch in found.stretches:
        lengths[VERDICTS[stretch.verdict]] += stretch.end - stretch.begin
        pieces = slice(stretch.first, stretch.last + 1)
        stretches.append(
            {
                "verdict": VERDICTS[stretch.verdict],
                "begin": stretch.begin,
                "end": stretch.end,
                "from": place[stretch.first].tolist(),
                "to": place[stretch.last + 1].tolist(),
                "distance": _finite(float(found.distance[pieces].min())),
                "seen": _finite(float(found.seen[pieces].min())),
            }
        )
    return {
        "verdict": VERDICTS[found.overall],
        "craft": {"width": found.width, "height": found.height},
        "length": float(found.pieces.along[-1]),
        "lengths": lengths,
        "free_space": surface.free is not None,
        "thin": min(found.width, found.height) < 2 * surface.cell_size,
        "reach": found.reach,
        "stretches": stretches,
        "narrowest": _narrowest(surface, found, least),
    }


def _narrowest(surface: SurfaceMap, found: Clearance, least: int) -> dict[str, Any] | None:
    """Return the narrowest place and the room there; None: no obstacle is in reach."""
    from mlscli.maps.surface_map import ORIGINS
    from mlscli.queries.room import room_at

    piece = found.narrowest
    patch = int(found.nearest[piece])
    if patch < 0:
        return None
    begin, end = found.pieces.place[piece : piece + 2]
    rooms = room_at(surface, begin, end, found.width, found.height, least)
    return {
        "at": ((begin + end) / 2).tolist(),
        "along": float(found.pieces.along[piece : piece + 2].mean()),
        "distance": float(found.distance[piece]),
        "rests": ORIGINS[surface.origin[patch]],
        "points": int(surface.count[patch]),
        "cell": [int(surface.ix[patch]), int(surface.iy[patch])],
        "room": {
            name: {
                "distance": _finite(room.distance),
                "least": _finite(room.least),
                "rests": room.rests,
            }
            for name, room in rooms.items()
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


# --- as text ---


def _rows(told: dict[str, Any], cell_size: float) -> list[tuple[str, str]]:
    decimals = max(0, 2 - math.floor(math.log10(cell_size)))

    def number(value: float) -> str:
        return f"{value:.{decimals}f}"

    def where(xyz: list[float]) -> str:
        return ",".join(map(number, xyz))

    width, height = told["craft"].values()
    lengths = ", ".join(f"{number(each)} {name}" for name, each in told["lengths"].items() if each)
    rows = [
        ("craft", f"an upright cylinder, {width:g} wide, {height:g} high"),
        ("way", f"{number(told['length'])} long: {lengths}" if told["length"] else "one place"),
    ]
    for stretch in told["stretches"][:_MOST_STRETCHES]:
        span = f"{number(stretch['begin'])} to {number(stretch['end'])}"
        places = f"from {where(stretch['from'])} to {where(stretch['to'])}"
        rows.append((span, f"{stretch['verdict']}, {places}"))
    more = len(told["stretches"]) - _MOST_STRETCHES
    if more > 0:
        rows.append(("...", f"and {more:,} more; --json tells them all"))
    narrow = told["narrowest"]
    if narrow is None:
        return [*rows, ("narrowest", f"no obstacle within {number(told['reach'])} of the craft")]
    far = narrow["distance"]
    near = f"{number(far)} clear" if far >= 0 else f"reaches {number(-far)} too far"
    rests = narrow["rests"] + (f", {narrow['points']:,} points" if narrow["points"] else "")
    rows.append(("narrowest", f"at {where(narrow['at'])}: {near}, at least, of what is {rests}"))
    for name, room in narrow["room"].items():
        rows.append((f"  {name}", _room(room, number)))
    return rows


def _room(room: dict[str, Any], number: Any) -> str:
    if room["distance"] is None:
        return "nothing near"
    text = number(room["distance"])
    if room["least"] != room["distance"]:
        text += f", at least {number(room['least'])}"
    return f"{text}, then {room['rests']}"
