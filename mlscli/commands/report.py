"""Results as text: aligned lines, each of a name and a value."""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from mlscli.errors import printable
from mlscli.parameters.fields import write_value
from mlscli.parameters.lengths import Cells, Length, in_units
from mlscli.words import some

if TYPE_CHECKING:
    from mlscli.pipeline.parameters import Vehicle

# A text is not cut into shorter lines than this, however long the names beside it are.
LEAST_ROOM = 40

# Nor, in the last column of a table, than this.
LEAST_IN_TABLES = 14

# So many numbers of levels fit on a line.
_MOST_LEVELS = 6


def lines(rows: Iterable[tuple[str, str]]) -> str:
    """Return rows (name, text) as lines with aligned texts; those without a text are left out.

    On a terminal, texts go on in further lines where they do not fit it; elsewhere a row is a line.
    What a recording named is escaped, see `printable`.
    """
    kept = [(printable(name), printable(text)) for name, text in rows if text]
    width = max((len(name) for name, _ in kept), default=0)
    room = _room(width + 4, LEAST_ROOM)
    return "\n".join(
        f"  {'' if number else name:<{width}}  {line}"
        for name, text in kept
        for number, line in enumerate(_cut(text, room))
    )


def table(rows: Sequence[Sequence[str]], indent: str = "  ", right: Sequence[int] = ()) -> str:
    """Return rows of as many texts each as lines with aligned columns.

    On a terminal, texts of the last column go on in further lines where they do not fit it.

    Parameters
    ----------
    rows : sequence of sequence of str
    indent : str, optional
        What each line begins with.
    right : sequence of int, optional
        The columns that are aligned to the right.
    """
    *wide, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
    room = _room(len(indent) + sum(width + 2 for width in wide), LEAST_IN_TABLES)
    told = []
    for *texts, last in rows:
        cells = (
            text.rjust(width) if number in right else text.ljust(width)
            for number, (text, width) in enumerate(zip(texts, wide, strict=True))
        )
        begin = indent + "".join(f"{cell}  " for cell in cells)
        for line in _cut(last, room):
            told.append(f"{begin}{line}".rstrip())
            begin = " " * len(begin)
    return "\n".join(told)


def _room(before: int, least: int) -> int | None:
    """Return how long texts may be on the terminal, behind so many letters; None: on none."""
    if not sys.stdout.isatty():
        return None
    return max(shutil.get_terminal_size().columns - before, least)


def _cut(text: str, room: int | None) -> list[str]:
    """Return a text as lines that fit, cut at blanks; one that fits stays as it is."""
    if room is None or len(text) <= room:
        return [text]
    return wrap(text, room, break_long_words=False, break_on_hyphens=False)


def counts(numbers: Mapping[str, int]) -> str:
    """Return counts with their names: ``12 this, 3 that``; zeros are left out."""
    return ", ".join(f"{number:,} {name}" for name, number in numbers.items() if number)


def bounds(extent: Mapping[str, Sequence[float]] | None) -> str:
    """Return bounds by axis, ``x -1.2 to 3.4; y ...``, to a thousandth of the extent or finer."""
    if extent is None:
        return "nothing"
    texts = []
    for axis, (low, high) in extent.items():
        span = high - low if high > low else max(abs(high), 1e-3)
        decimals = max(0, 3 - math.floor(math.log10(span)))
        texts.append(f"{axis} {low:,.{decimals}f} to {high:,.{decimals}f}")
    return "; ".join(texts)


def levels(cells_by_level: Mapping[str, int]) -> str:
    """Return how many cells hold one patch, two, and so on; of many numbers the last is told."""
    told = [f"{some(cells, 'cell')} with {n}" for n, cells in cells_by_level.items()]
    if len(told) > _MOST_LEVELS:
        rest = [*cells_by_level.items()][_MOST_LEVELS - 1 :]
        more = some(sum(cells for _, cells in rest), "cell")
        told[_MOST_LEVELS - 1 :] = [f"{more} with {rest[0][0]} to {rest[-1][0]}"]
    return ", ".join(told)


def craft(vehicle: Vehicle, cell_size: float | None) -> str:
    """Return the size of the craft, ``1 cell wide (0.15), 0.4 high``."""

    def size(length: Length, word: str) -> str:
        known = cell_size is not None and isinstance(length, Cells)
        units = f" ({in_units(length, cell_size or 1.0):.6g})" if known else ""
        return f"{write_value(length)} {word}{units}"

    return f"{size(vehicle.width, 'wide')}, {size(vehicle.height, 'high')}"


def reasoned(text: str, reason: str | None) -> str:
    """Return a text with the reason behind it, if there is one."""
    return f"{text} ({reason})" if reason else text


def map_rows(
    description: Mapping[str, Any], why: Mapping[str, str] | None = None
) -> list[tuple[str, str]]:
    """Return the rows on what a map holds.

    Parameters
    ----------
    description : mapping
        What `mlscli.maps.summary.describe` returns.
    why : mapping of str to str, optional
        Why sizes were chosen, by name, as the map's meta says.
    """

    def size(name: str) -> str:
        return reasoned(f"{description[name]:.6g}", (why or {}).get(name))

    patches = dict(description["patches"])
    total, vertical, moved = (patches.pop(name) for name in ("total", "vertical", "moved"))
    shape = f"{vertical:,} vertical" + (f", {moved:,} moved" if moved else "")
    return [
        ("patches", f"{total:,}: {counts(patches)}; {shape}" if total else "none"),
        ("levels", levels(description["levels"])),
        ("extent", bounds(description["extent"])),
        ("area", f"{description['area']:.6g} in {some(description['cells'], 'cell')}"),
        ("errors", _uncertainty(description["uncertainty"])),
        ("cell size", size("cell_size")),
        ("gap size", size("gap_size")),
        ("thickness", f"{description['thickness']:.6g}"),
        ("free space", _free_space(description["free_space"])),
        ("regions", f"{description['regions']:,}" if description["regions"] else ""),
        ("frame", description["frame_id"]),
        ("on Earth", georeference(description["georeference"])),
    ]


def georeference(told: Mapping[str, Any] | None) -> str:
    """Return where a map lies on Earth as one line; empty where nobody knows."""
    if told is None:
        return ""
    from mlscli.maps.georeference import Georeference

    place = Georeference(told["crs"], tuple(told["offset"]), told["source"])
    turned = told["of"] != "map"
    return f"{place}{'; of the recording, from which the map was turned' if turned else ''}"


def _uncertainty(told: Mapping[str, Any]) -> str:
    if not told["known"]:
        return "not known"
    heights, share = some(told["known"], "height"), told["within"] / told["known"]
    return f"{told['rms']:.3g} rms expected of {heights}, {share:.0%} below a quarter of a cell"


def _free_space(seen: Mapping[str, Any] | None) -> str:
    if seen is None:
        return ""
    voxels = some(seen["voxels"], "voxel")
    return f"{seen['volume']:.6g} in {voxels} seen through, {seen['twice']:,} of them twice or more"
