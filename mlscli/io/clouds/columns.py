"""Columns of numbers in a text: their names, in an option or in a header."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from mlscli.errors import UsageError

CENTRE, ATTITUDE = ("cx", "cy", "cz"), ("qx", "qy", "qz", "qw")
COLUMNS = ("x", "y", "z", "keyframe", "t", *CENTRE, *ATTITUDE)

_OTHER_NAMES = {
    "pos_x": "x",
    "pos_y": "y",
    "pos_z": "z",
    "kf": "keyframe",
    "kf_id": "keyframe",
    # The coordinates of VTK, as ParaView names them.
    "points:0": "x",
    "points:1": "y",
    "points:2": "z",
    "points_0": "x",
    "points_1": "y",
    "points_2": "z",
    # And those of VeloView.
    "points_m_xyz:0": "x",
    "points_m_xyz:1": "y",
    "points_m_xyz:2": "z",
}
_UNIT = re.compile(r"[ \t]*(\[[^\]]*\]|\([^)]*\))")
# What columns hold that are no x, y, z: a comment of such words names columns.
# fmt: off
_NO_COORDINATES = frozenset((
    "id", "index", "idx", "no", "nr", "label", "name", "point", "pointid", "t", "time", "stamp",
    "timestamp", "sec", "secs", "nsec", "frame", "keyframe", "lat", "latitude", "lon", "lng",
    "long", "longitude", "alt", "altitude", "elevation", "ele", "height", "easting", "northing",
    "east", "north", "up", "e", "n", "u", "h", "range", "distance", "dist", "azimuth", "angle",
    "theta", "phi", "rho", "radius", "r", "g", "b", "a", "red", "green", "blue", "alpha", "rgb",
    "intensity", "i", "refl", "reflectance", "reflectivity", "nx", "ny", "nz", "normal_x",
    "normal_y", "normal_z", "qx", "qy", "qz", "qw", "qr", "tx", "ty", "tz", "px", "py", "pz",
    "vx", "vy", "vz", "roll", "pitch", "yaw", "row", "col", "column", "ring", "line", "tag",
    "class", "classification", "confidence", "depth", "disparity",
))
# fmt: on


@dataclass
class Layout:
    """Which columns hold what.

    Attributes
    ----------
    places : dict of str to int
        Index of each column that is read, by name.
    most : int or None
        How many columns a row has at most; None: as many as it likes.
    least : int
        How many columns a row has at least.
    guessed : bool
        Whether it is a guess that the fourth column is the keyframe.
    notes : list of str
        What the user should know about it.
    """

    places: dict[str, int]
    most: int | None = None
    least: int = 0
    guessed: bool = False
    notes: list[str] = field(default_factory=list)


def parse_columns(columns: str) -> dict[str, int]:
    """Return the index of each column named in ``x,y,z,-,keyframe``; ``-`` skips a column.

    Raises
    ------
    UsageError
        A name is unknown or repeated, or x, y, z is missing, or part of cx, cy, cz or of qx, qy,
        qz, qw.
    """
    names = [name.strip().lower() for name in columns.split(",")]
    for name in names:
        if name != "-" and name not in COLUMNS:
            fault = f"found {name!r}"
        elif name != "-" and names.count(name) > 1:
            fault = f"{name} is named more than once"
        else:
            continue
        break
    else:
        fault = _missing(names)
    if fault:
        raise UsageError(
            f"`columns` {columns}: {fault}; the names are {', '.join(COLUMNS)}, each at most "
            "once, and - for a column to skip; x, y and z are needed"
        )
    return {name: names.index(name) for name in names if name != "-"}


def header_columns(names: Sequence[str]) -> dict[str, int] | None:
    """Return the index of each known column of a header; None where some lack or are repeated.

    Parameters
    ----------
    names : sequence of str
        As `bare_name` returns them.
    """
    # Other names count where no column bears the usual one.
    known = [
        name if _OTHER_NAMES.get(name) in names else _OTHER_NAMES.get(name, name) for name in names
    ]
    if not {*ATTITUDE} <= {*known}:
        # Numbers of another kind have such names, too.
        known = ["-" if name in ATTITUDE else name for name in known]
    if _missing(known) or any(known.count(name) > 1 for name in COLUMNS):
        return None
    return {name: known.index(name) for name in known if name in COLUMNS}


def is_known(name: str) -> bool:
    """Return whether a column of a header is one that is read."""
    return _OTHER_NAMES.get(name, name) in COLUMNS


def _missing(names: Sequence[str]) -> str:
    """Return which columns are missing, as text; empty where none is."""
    needed = ["x", "y", "z"]
    for together in (CENTRE, ATTITUDE):
        needed += together if any(name in names for name in together) else ()
    absent = [name for name in needed if name not in names]
    return f"{', '.join(absent)} missing" if absent else ""


def without_units(header: str) -> str:
    """Return a header without the units and other remarks in brackets."""
    return _UNIT.sub("", header)


def bare_name(name: str) -> str:
    """Return the name of a column without marks of a comment or quotes, in lower case."""
    return without_units(name).lstrip("#/% \t").strip(" \t\"'").lower()


def name_others(names: Sequence[str]) -> bool:
    """Return whether words are names of columns, most of which hold no coordinates."""
    known = sum(name in _NO_COORDINATES or is_known(name) for name in names)
    return 3 * known >= 2 * len(names) and len(names) > 1
