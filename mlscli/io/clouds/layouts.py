"""Which columns of a text cloud hold what: as the user says, by a header, or by position.

By position columns are x, y, z and perhaps the keyframe. That is a guess, and rows can speak
against it: then the text is refused with what it seems to hold, as ``columns`` can always tell.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.io.clouds.columns import Layout, header_columns, is_known, name_others
from mlscli.io.clouds.dialect import number
from mlscli.io.clouds.opening import Opening
from mlscli.io.clouds.rows import short
from mlscli.runtime.arrays import Float64
from mlscli.words import are, some

# Coordinates are below it, and time stamps mostly above.
_LEAST_STAMP = 1e8
_LEAST_ROWS = 5
# Eastings of UTM are below it, and northings mostly above.
_MOST_EASTING = 1e6
_PADDED = re.compile(r"[+-]?0[0-9]+")
_WHOLE = re.compile(r"[+-]?[0-9]+")


def layout_of(path: Path, opening: Opening) -> Layout:
    """Choose the columns by what stands before the first row, or else by position.

    Raises
    ------
    InputError
        A header names no x, y, z, or other columns than the rows have; or rows without a header
        show that they do not begin with x, y, z.
    """
    if opening.headers:
        return _by_header(path, opening)
    for comment in reversed(opening.comments):
        for names in opening.names(comment):
            places = header_columns(names)
            if len(names) == opening.width and places is not None:
                return Layout(places, *_bounds(opening, names))
            if len(names) == opening.width and name_others(names):
                raise InputError(
                    f"{path}: found the comment {short(comment)}, which names no x, y and z; "
                    "`columns` says what the columns hold"
                )
    doubts = _doubt(path, opening)
    layout = _by_position(path, opening)
    layout.notes += doubts
    return layout


def _by_header(path: Path, opening: Opening) -> Layout:
    """Return the columns that the first header names which names x, y and z."""
    named = 0
    for header in opening.headers:
        for names in opening.names(header):
            places = header_columns(names)
            if places is None:
                continue
            named = named or len(names)
            most, least = _bounds(opening, names)
            if least <= opening.width <= most and max(places.values()) < opening.width:
                layout = Layout(places, most, least)
                unused = [name for name in names if not is_known(name)]
                if unused:
                    listed = ", ".join(name or "without a name" for name in unused)
                    layout.notes.append(unused_note(path, f"columns {listed} are"))
                return layout
    if named:
        raise InputError(
            f"{path}: found a header that names {some(named, 'column')}, and {_widths(opening)}; "
            "`columns` says what they hold"
        )
    raise InputError(
        f"{path}: found {opening.headers[0][:60]!r} before the first point, expected "
        "numbers or a header that names x, y and z once each"
    )


def _widths(opening: Opening) -> str:
    """Return how many columns rows have: all, or most of the first ones."""
    widths = {len(row) for row in opening.rows}
    if len(widths) == 1:
        return f"rows of {opening.width}"
    return f"rows of {min(widths)} to {max(widths)}, most of them of {opening.width}"


def _bounds(opening: Opening, names: Sequence[str]) -> tuple[int, int]:
    """Return how many columns a row has at most and at least, where a header has these names.

    Without empty fields a row of fewer columns does not tell which are missing.
    """
    return len(names), 0 if opening.dialect.separator else len(names)


def _by_position(path: Path, opening: Opening) -> Layout:
    """Return x y z [keyframe]."""
    guessed = opening.width == 4
    layout = Layout({"x": 0, "y": 1, "z": 2, **({"keyframe": 3} if guessed else {})})
    layout.guessed = guessed
    if opening.width > len(layout.places):
        count = opening.width - len(layout.places)
        layout.notes.append(
            unused_note(path, f"{some(count, 'column')} after x, y, z {are(count)}")
        )
    return layout


def unused_note(path: Path, what: str) -> str:
    """Return a note that columns are not used; `what` says which, and ends in a verb."""
    return f"{path}: the {what} not used; `columns` says what they hold"


def _doubt(path: Path, opening: Opening) -> list[str]:
    """Refuse rows that do not begin with x, y, z; return notes where that only seems so."""
    rows = [row for row in opening.rows if len(row) == opening.width]
    is_whole = all(_WHOLE.fullmatch(word) for row in rows for word in row)
    if (
        opening.dialect.separator == ","
        and opening.width % 2 == 0
        and is_whole
        and any(_PADDED.fullmatch(word) for row in rows for word in row[1::2])
    ):
        raise InputError(
            f"{path}:{opening.first_line + 1}: found {short(opening.lines[0].strip())}, where "
            "commas seem to be decimal commas and to separate columns; expected decimal points"
        )
    leading = _leading(rows, min(opening.width, 5))
    if leading is None:
        return []
    first, grows = leading[:, 0], bool((np.diff(leading[:, 0]) > 0).all())
    if grows and (first >= _LEAST_STAMP).all():
        _refuse(path, opening, f"times ({first[0]:.10g})", "t,x,y,z")
    steps = np.diff(first)
    # Rows of a raster count up along one axis, and stay the same along the other.
    moves = bool((np.ptp(leading[:, 1:3], axis=0) > 0).all())
    is_index = bool((steps == 1).all()) and (first[0] in (0, 1) or moves)
    whole = (leading == np.floor(leading)).all(axis=0).tolist()
    if is_index and opening.width > 3 and not any(whole[1:3]):
        _refuse(path, opening, f"numbers of rows ({first[0]:.0f}, {first[1]:.0f}, ...)", "-,x,y,z")
    if whole[:4] == [True, False, False, False]:
        # Surveyors write numbers, northings, eastings and heights (PNEZD), or eastings first.
        turned = bool(
            (leading[:, 1] > _MOST_EASTING).all() and (leading[:, 2] < _MOST_EASTING).all()
        )
        columns = "-,y,x,z" if turned else "-,x,y,z"
        return [_doubt_note(path, "first column holds whole numbers only", columns)]
    if whole == [True, True, False, False, False]:
        return [_doubt_note(path, "first two columns hold whole numbers only", "-,-,x,y,z")]
    if (
        opening.width > 3
        and (opening.width == 4 or moves)
        and len(steps) >= 2 * _LEAST_ROWS
        and _are_even(steps)
    ):
        return [_doubt_note(path, "first column grows as evenly as times do", "t,x,y,z")]
    return []


def _are_even(steps: Float64) -> bool:
    return bool(steps.min() > 0 and np.ptp(steps) < 0.01 * steps.min())


def _doubt_note(path: Path, found: str, columns: str) -> str:
    return f"{path}: the {found}; if it is not x, try `columns` {columns}"


def _leading(rows: Sequence[Sequence[str]], count: int) -> Float64 | None:
    """Return the first numbers of rows, NaN for words; None where they are too few to tell."""
    values = np.array([[_number(word) for word in row[:count]] for row in rows])
    return values if len(rows) >= _LEAST_ROWS and np.isfinite(values[:, :3]).all() else None


def _number(word: str) -> float:
    try:
        return number(word)
    except ValueError:
        return float("nan")


def _refuse(path: Path, opening: Opening, found: str, columns: str) -> None:
    raise InputError(
        f"{path}: the first of {opening.width} columns seems to hold {found} and not x: try "
        f"`columns` {columns}; `columns` x,y,z takes it for x all the same, and a trajectory goes "
        "after `route`"
    )
