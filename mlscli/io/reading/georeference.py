"""Where on Earth a recording lies: as its sources say, or the user."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mlscli.errors import InputError, UsageError
from mlscli.io.crs import require_known
from mlscli.io.source import Source
from mlscli.maps.georeference import GIVEN, Georeference, named_crs


def asked_georeference(crs: str | None, offset: Sequence[float] | None) -> Georeference | None:
    """Return what the user names; None where that is nothing.

    Raises
    ------
    UsageError
        The system is none, the offset is not three finite numbers, or is without a system.
    """
    if offset is not None:
        if len(offset) != 3 or not all(map(math.isfinite, offset)):
            raise UsageError(
                f"`crs_offset`: found {', '.join(map(str, offset))}; expected three numbers, x,y,z"
            )
        if crs is None:
            raise UsageError("`crs_offset`: leads into a reference system; `crs` says which")
    if crs is None:
        return None
    name = named_crs(crs)
    require_known(name)
    x, y, z = (0.0, 0.0, 0.0) if offset is None else map(float, offset)
    return Georeference(name, (x, y, z), GIVEN)


def common_georeference(sources: Sequence[Source]) -> Georeference | None:
    """Return where the frame of all sources lies: as those say that say anything.

    Raises
    ------
    InputError
        Two say different things.
    """
    known = [(source, each) for source in sources if (each := source.georeference) is not None]
    for source, each in known[1:]:
        if not each.is_same(known[0][1]):
            raise InputError(
                f"{source.path}: lies in {each}, and {known[0][0].path} in {known[0][1]}; they are "
                "read as one recording, in one frame. Build maps of their own, or say by `crs` in "
                "which system both are"
            )
    return known[0][1] if known else None
