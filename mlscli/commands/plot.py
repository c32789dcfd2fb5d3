"""``mls plot``: a picture of a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mlscli.commands.options import coloured, overwrite, tell, without_artificial
from mlscli.errors import UsageError, printable

if TYPE_CHECKING:
    from mlscli.mesh.colours import ColourBy


@click.command()
@click.argument("source", metavar="MAP")
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    help="PNG, SVG or PDF by its ending.  [default: the map's name with .png, here]",
)
@click.option(
    "--level",
    type=click.IntRange(min=1),
    metavar="N",
    help="The N-th patch of each cell from below.  [default: the highest]",
)
@click.option(
    "--section",
    metavar="X0,Y0,X1,Y1",
    help="Cut the map upright along a line instead of looking from above.",
)
@click.option(
    "--compare",
    "other",
    metavar="OTHER",
    help="Put another map beside it, their difference, and rings around what differs.",
)
@coloured
@without_artificial
@overwrite
def command(
    source: str,
    output: str | None,
    level: int | None,
    section: str | None,
    other: str | None,
    colour: ColourBy,
    no_artificial: bool,
    overwrite: bool,
) -> None:
    """Draw a map from above, cut upright, or beside another one.

    From above: shaded by the light from the north-west, artificial patches red, the route green,
    a dotted line around what has another level beneath it. Cut upright: each stretch between two
    levels with its least clearance; of a map built with --free-space, what was seen through.
    """
    given = {"--level": level, "--section": section, "--compare": other}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise UsageError(f"{' and '.join(named)}: do not go together; choose one")
    line = None if section is None else _line(section)
    target = Path(output) if output is not None else Path(f"{Path(source).stem}.png")

    from mlscli.io.writing.atomic import refuse_existing

    sources = [source] if other is None else [source, other]
    refuse_existing(target, overwrite=overwrite, sources=sources)

    from mlscli.io.writing.npz import read_map
    from mlscli.plot import plot_above, plot_differences, plot_section, require_format, write_figure

    require_format(target)
    surface, artificial = read_map(source), not no_artificial
    name = printable(Path(source).name)
    if line is not None:
        figure = plot_section(surface, *line, colour=colour, artificial=artificial, title=name)
    elif other is not None:
        titles = (name, printable(Path(other).name))
        second = read_map(other)
        figure = plot_differences(
            surface, second, colour=colour, artificial=artificial, titles=titles
        )
    else:
        title = name if level is None else f"{name}, level {level}"
        figure = plot_above(surface, level=level, colour=colour, artificial=artificial, title=title)
    write_figure(target, figure, overwrite=overwrite)
    tell(str(target))


def _line(section: str) -> tuple[tuple[float, float], tuple[float, float]]:
    try:
        x0, y0, x1, y1 = (float(number) for number in section.split(","))
    except ValueError:
        raise UsageError(
            f"--section {section}: expected four numbers, as in --section 0,-3,0,3"
        ) from None
    return (x0, y0), (x1, y1)
