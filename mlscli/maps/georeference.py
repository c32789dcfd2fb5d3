"""Where on Earth the frame of a recording lies: a reference system, and what leads to it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mlscli.errors import InputError, UsageError, printable, shorten
from mlscli.maps.recorded import turn_of

GEOREFERENCE = "georeference"
"""The key in a map's meta of what `Georeference.to_dict` returns."""

GIVEN = "as given"
"""The source of what the user names."""

MOST_TEXT = 1 << 16

_CODE = re.compile(r"(?:epsg:)?(\d{4,6}(?:\+\d{4,6})?)", re.IGNORECASE)
# The roots of what lies on Earth, in versions 1 and 2 of WKT.
_ROOT = re.compile(
    r"\s*(PROJCS|GEOGCS|GEOCCS|COMPD_CS|PROJCRS|PROJECTEDCRS|GEOGCRS|GEOGRAPHICCRS|GEODCRS|"
    r"GEODETICCRS|COMPOUNDCRS|BOUNDCRS|DERIVEDPROJCRS)\s*\[",
    re.IGNORECASE,
)
_QUOTED = re.compile(r'"[^"]*"')
# The code that the root itself states, the last thing in it.
_OWN_CODE = re.compile(
    r',\s*(?:AUTHORITY\s*\[\s*"EPSG"\s*,\s*"?(\d+)"?\s*\]|ID\s*\[\s*"EPSG"\s*,\s*(\d+)\s*\])\s*\]\s*$',
    re.IGNORECASE,
)


class Georeference(NamedTuple):
    """A reference system, and the offset that leads to it from coordinates as recorded.

    Attributes
    ----------
    crs : str
        As ``EPSG:32632`` or ``EPSG:25832+7837``, or well-known text (WKT).
    offset : tuple of float
        What must be added to x, y, z as recorded. These are the map's own, unless `up` turned them.
    source : str
        Who says so.
    """

    crs: str
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    source: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {"crs": self.crs, "offset": list(self.offset), "source": self.source}

    @property
    def name(self) -> str:
        """The system in short: its code, or the name that its text begins with."""
        if not _ROOT.match(self.crs):
            return self.crs
        code = _OWN_CODE.search(self.crs)
        if code:
            return f"EPSG:{code[1] or code[2]}"
        quoted = _QUOTED.search(self.crs)
        return shorten(printable(quoted[0][1:-1])) if quoted else "a system without a name"

    def is_same(self, other: Georeference) -> bool:
        """Return whether both lead to the same place; who says so does not matter.

        Systems are the same where their texts are, or their codes.
        """
        if self.crs != other.crs and not (
            self.name == other.name and self.name.startswith("EPSG:")
        ):
            return False
        return bool(np.allclose(self.offset, other.offset, rtol=1e-12, atol=1e-6))

    def __str__(self) -> str:
        """Return it as one line."""
        added = " + ".join(f"{each:.10g}" for each in self.offset)
        moved = f", offset {added.replace(' + ', ',')}" if any(self.offset) else ""
        said = f" ({self.source})" if self.source else ""
        return f"{self.name}{moved}{said}"


def named_crs(text: str) -> str:
    """Return the name of a reference system in its usual form.

    Parameters
    ----------
    text : str
        An EPSG code, as ``EPSG:32632`` or 32632, with a vertical one behind a plus sign, if any; or
        WKT of what lies on Earth.

    Raises
    ------
    UsageError
        It is neither. Whether there is such a code is not known here.
    """
    code = _CODE.fullmatch(text.strip())
    if code:
        return f"EPSG:{code[1]}"
    bare = _QUOTED.sub("", text)
    if (
        _ROOT.match(text)
        and len(text) <= MOST_TEXT
        and bare.count("[") == bare.count("]")
        and bare.rstrip().endswith("]")
        and '"' not in bare
    ):
        return text.strip()
    raise UsageError(
        f"`crs`: is {shorten(printable(text))!r}; expected an EPSG code, as EPSG:32632, or the "
        "text (WKT) of a reference system"
    )


def georeference_of(meta: Mapping[str, Any]) -> Georeference | None:
    """Return what a map's meta says of its recording's frame; None: it says nothing.

    Raises
    ------
    InputError
        What it holds is none.
    """
    held = meta.get(GEOREFERENCE)
    return None if held is None else checked_georeference(held, f"meta: {GEOREFERENCE}")


def checked_georeference(held: Any, name: str) -> Georeference:
    """Return a georeference of what JSON holds, under a name to be told.

    Raises
    ------
    InputError
        It is none.
    """
    try:
        x, y, z = map(float, held["offset"])
        crs = named_crs(str(held["crs"]))
        found = Georeference(crs, (x, y, z), str(held.get("source", "")))
    except (UsageError, TypeError, KeyError, ValueError, AttributeError, OverflowError):
        found = None
    if found is None or not all(map(math.isfinite, found.offset)):
        raise InputError(
            f"{name} holds {shorten(printable(str(held)))}; it must be an object of crs, an EPSG "
            "code or WKT, and offset, three numbers"
        )
    return found


def is_turned(meta: Mapping[str, Any]) -> bool:
    """Return whether the axes of a map are not those of its recording."""
    return bool((turn_of(meta)[:3, :3] != np.eye(3)).any())


def map_georeference(meta: Mapping[str, Any], crs: str | None = None) -> Georeference | None:
    """Return the georeference of a map's own frame.

    Parameters
    ----------
    meta : mapping
        That of the map.
    crs : str, optional
        The system that the user names; that of the meta, by default.

    Returns
    -------
    Georeference or None
        None where none is known, or the map was turned, so that its x and y are those of no system.

    Raises
    ------
    UsageError
        `crs` is none, is not that of the meta, or is named for a map that was turned.
    InputError
        What the meta holds is none.
    """
    known = georeference_of(meta)
    if crs is None:
        return None if is_turned(meta) else known
    asked = Georeference(named_crs(crs), source=GIVEN)
    if is_turned(meta):
        raise UsageError(
            f"`crs`: is {asked.name}, but the map was turned so that z is up: its x and y are not "
            "those of the recording"
        )
    if known is None:
        return asked
    if not known._replace(offset=asked.offset).is_same(asked):
        raise UsageError(
            f"`crs`: is {asked.name}, but the map says {known}; build it with the `crs` that is "
            "right, or leave it out"
        )
    return known


def of_both(one: Mapping[str, Any], other: Mapping[str, Any]) -> Georeference | None:
    """Return the georeference of two maps of one frame: of which it is known.

    Raises
    ------
    UsageError
        Both have one, and they differ.
    InputError
        What a meta holds is none.
    """
    mine, its = georeference_of(one), georeference_of(other)
    if mine is not None and its is not None and not mine.is_same(its):
        raise UsageError(
            f"maps that lie in different places on Earth do not go together: {mine}, and {its}; "
            "build both with the same `crs`, in the same frame"
        )
    return mine or its
