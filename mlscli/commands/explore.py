"""``mls explore``: where to fly next."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mlscli.commands import report
from mlscli.commands.flying import craft_size, seeing
from mlscli.commands.options import as_json, least_lines, overwrite, say, tell
from mlscli.commands.query import not_kept
from mlscli.commands.reading import Numbers
from mlscli.errors import UsageError
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.io.writing.plan import OnEarth, Origin
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.queries.exploration import Exploration

ENDINGS = (".csv", ".tum", ".txt", ".plan", ".mcap", ".html")


@click.command()
@click.argument("source", metavar="MAP")
@craft_size
@seeing
@click.option(
    "--views",
    type=click.IntRange(min=1),
    default=12,
    show_default=True,
    metavar="N",
    help="How many views to choose at most.",
)
@least_lines
@click.option(
    "-o",
    "--output",
    "outputs",
    metavar="FILE",
    multiple=True,
    help="Write the views: a table (.csv; - prints it); the way along them as a trajectory of TUM "
    "(.tum, .txt) for mls synth --route, a plan of QGroundControl (.plan), or a path and markers "
    "for RViz and Lichtblick (.mcap); or the map's page with them (.html). More may be named.",
)
@click.option(
    "--origin",
    type=Numbers("LAT,LON,ALT"),
    help="For a plan: where the map's origin lies (degrees, metres above sea level). Its x points "
    "east, its y north, in metres. Not needed where the map knows where it lies on Earth.",
)
@click.option(
    "--crs",
    metavar="CRS",
    help="For a plan: the reference system of the map, as EPSG:32632, where the map does not know "
    "it. Needs pip install 'mlscli[geo]'.",
)
@overwrite
@as_json
def command(
    source: str,
    craft: tuple[float, float],
    field_of_view: float,
    reach: float | None,
    views: int,
    least: int,
    outputs: tuple[str, ...],
    origin: tuple[float, float, float] | None,
    crs: str | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Say where a map is uncertain, and from where a look would settle it.

    Uncertain are artificial patches, holes in the map, space under decks and behind windows that
    nobody looked into (of maps built with --free-space), and the map's outer edges. Views are told
    in the order in which to fly them, from the end of the route: those first that would see the
    most uncertain cells for their way. The craft goes across at a safe height above all of the map,
    straight down to each view, and up again.
    """
    from mlscli.io.writing.atomic import refuse_existing
    from mlscli.io.writing.npz import read_map
    from mlscli.queries.exploration import Camera
    from mlscli.queries.explore import explore

    prints = "-" in outputs
    outputs = tuple(output for output in outputs if output != "-")
    if prints and as_json:
        raise UsageError("-o -: does not go with --json, both print; name a file, table.csv")
    for output in outputs:
        _check(output)
        refuse_existing(output, overwrite=overwrite, sources=[source])
    surface = read_map(source)
    plans = [output for output in outputs if output.lower().endswith(".plan")]
    if (origin is not None or crs is not None) and not plans:
        raise UsageError("--origin and --crs: are for a plan; name one with -o FILE.plan")
    place = _place(plans[0], surface, origin, crs) if plans else None
    found = explore(surface, *craft, Camera(field_of_view, reach), most=views, least=least)
    for output in outputs:
        _write(output, surface, found, place, overwrite=overwrite)
    if prints:
        from mlscli.io.writing.views import table_of

        click.echo(table_of(found), nl=False)
        return
    if as_json:
        told = _told(found, craft) | {"free_space": surface.free is not None}
        click.echo(json.dumps(told, indent=2))
        return
    for line in _lines(Path(source).name, found, surface.cell_size):
        tell(line)
    if surface.free is None:
        tell(f"space that nobody looked into is not among it: {not_kept(surface)}")
    if len(found.regions) > found.tried:
        say(f"mls: {source}: views were tried for the {found.tried} largest regions only")


def _check(output: str) -> None:
    """Refuse an output that cannot be written, before any work."""
    ending = Path(output).suffix.lower()
    if ending not in ENDINGS:
        raise UsageError(f"{output}: does not end in {', '.join(ENDINGS)}")


def _place(
    output: str, surface: SurfaceMap, origin: tuple[float, float, float] | None, crs: str | None
) -> Origin | OnEarth:
    """Return where the map lies on Earth, before any work."""
    from mlscli.io.writing.plan import OnEarth, Origin
    from mlscli.maps.georeference import map_georeference

    if origin is not None:
        if crs is not None:
            raise UsageError("--crs: does not go with --origin; leave one of them out")
        return Origin(*origin)
    found = map_georeference(surface.meta, crs)
    if found is None:
        raise UsageError(
            f"{output}: a plan is in degrees, and the map does not know where on Earth it lies; "
            "say it by --crs, or where its origin lies, as in --origin 47.3765,8.5482,410, its x "
            "pointing east and its y north"
        )
    place = OnEarth(found)
    # That pyproj is there, and knows the system, shows now.
    x, y = (float(cells[:1].sum()) * surface.cell_size for cells in (surface.ix, surface.iy))
    place.at(x, y, 0.0)
    say(f"mls: {output}: heights of the map, {found}, are taken for altitudes above sea level")
    return place


def _write(
    output: str,
    surface: SurfaceMap,
    found: Exploration,
    origin: Origin | OnEarth | None,
    *,
    overwrite: bool,
) -> None:
    """Write what was found in the format that a name asks for."""
    ending = Path(output).suffix.lower()
    if ending == ".csv":
        from mlscli.io.writing.views import write_views

        write_views(output, found, overwrite=overwrite)
    elif ending == ".plan":
        from mlscli.io.writing.plan import write_plan

        assert origin is not None
        write_plan(output, found, origin, overwrite=overwrite)
    elif ending == ".mcap":
        from mlscli.io.writing.explored import write_explored

        write_explored(output, found, surface.frame_id, surface.cell_size, overwrite=overwrite)
    elif ending == ".html":
        from mlscli.view.page import write_page

        title = Path(output).stem
        write_page(output, surface, title=title, explored=found, overwrite=overwrite)
    else:
        from mlscli.io.writing.views import write_trajectory

        write_trajectory(output, found, overwrite=overwrite)


def _told(found: Exploration, craft: tuple[float, float]) -> dict[str, Any]:
    """Return all that is found, as JSON has it."""
    from mlscli.io.writing.views import rows_of
    from mlscli.queries.uncertain import KINDS

    return {
        "camera": found.camera._asdict(),
        "craft": dict(zip(("width", "height"), craft, strict=True)),
        "cells": dict(zip(KINDS, found.cells, strict=True)),
        "safe_height": found.safe,
        "begin": list(found.begin),
        "length": found.length,
        "views": rows_of(found),
        "regions": [
            {"kind": KINDS[region.kind], "cells": region.cells, "middle": list(region.middle)}
            for region in found.regions
        ],
        "regions_tried": found.tried,
    }


# --- as text ---

_HEAD = ("view", "at", "yaw", "tilt", "across", "above", "way down", "sees")


def _lines(name: str, found: Exploration, cell_size: float) -> list[str]:
    from mlscli.queries.exploration import WAYS
    from mlscli.queries.uncertain import KINDS

    decimals = max(0, 2 - math.floor(math.log10(cell_size)))

    def number(value: float) -> str:
        return f"{value:.{decimals}f}"

    def cells(counts: tuple[int, ...]) -> str:
        told = [f"{n:,} {kind}" for n, kind in zip(counts, KINDS, strict=True) if n]
        return ", ".join(told) or "none"

    camera = found.camera
    lines = [
        f"{name}: {some(sum(found.cells), 'uncertain cell')} in "
        f"{some(len(found.regions), 'region')}",
        report.lines(
            [
                ("cells", cells(found.cells)),
                ("camera", f"{camera.field_of_view:g} degrees, sees {number(camera.reach)} far"),
                ("way", f"{number(found.length)} long, across at z {number(found.safe)}"),
            ]
        ),
    ]
    if not found.views:
        far = f"that sees {number(camera.reach)} far; --range takes another"
        return [*lines, f"  no view would settle anything, of a camera {far}"]
    rows = [_HEAD]
    for n, view in enumerate(found.views, 1):
        ground = number(view.ground) if math.isfinite(view.ground) else "-"
        at = ",".join(map(number, view.place))
        rows.append(
            (
                *(str(n), at, f"{view.yaw:.0f}", f"{view.tilt:.0f}", number(view.across)),
                *(ground, WAYS[view.way], cells(view.sees)),
            )
        )
    return [*lines, report.table(rows)]
