"""How a recording comes onto a map of another frame: what `mls align` writes, and a build reads."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mlscli.errors import InputError, UsageError, expect
from mlscli.geometry.similarity import Similarity
from mlscli.io.files import read_input
from mlscli.maps.georeference import (
    GEOREFERENCE,
    Georeference,
    checked_georeference,
    georeference_of,
)
from mlscli.maps.recorded import TURN, turn_of, turns_apart
from mlscli.runtime.arrays import Array, Float64

MATRIX, FRAME, FROM = "transform", "frame_id", "from"
"""Its keys: rows of the matrix (4, 4); the frame that it leads to; the turn before it."""


@dataclass(frozen=True, eq=False)
class Transform:
    """A similarity from the frame of one map to that of another, and what is known of both.

    Attributes
    ----------
    fit : Similarity
        To be applied once z points up.
    frame_id : str
        The frame that it leads to.
    turn : float64 (4, 4)
        The turn by which the recording of the other map came into that frame.
    before : float64 (4, 4)
        The turn after which z points up in the recording that is moved.
    georeference : Georeference or None
        Where the frame of the other map's recording lies on Earth, if that is known.
    """

    fit: Similarity
    frame_id: str
    turn: Float64
    before: Float64
    georeference: Georeference | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return {
            MATRIX: self.fit.matrix.tolist(),
            FRAME: self.frame_id,
            TURN: self.turn.tolist(),
            FROM: self.before.tolist(),
        } | ({} if self.georeference is None else {GEOREFERENCE: self.georeference.to_dict()})

    def require_turn(self, turn: Float64) -> None:
        """Refuse a recording that is turned upright in another way.

        Raises
        ------
        UsageError
            Where `turn` (4, 4) is not that of the recording whose map was aligned.
        """
        apart = turns_apart({TURN: self.before.tolist()}, {TURN: turn.tolist()})
        if apart is not None:
            raise UsageError(
                "`transform`: is for a recording that was turned upright in another way, their "
                f"matrices differ by {apart:.3g}; give `up` as for the map that was aligned"
            )


def onto(
    fit: Similarity, one: Mapping[str, Any], frame_id: str, other: Mapping[str, Any]
) -> Transform:
    """Return how the recording of a map comes onto another map, once these are aligned.

    Parameters
    ----------
    fit : Similarity
        From the frame of the second map to that of the first.
    one, other : mapping
        The meta of the first map and of the second.
    frame_id : str
        The frame of the first.
    """
    earlier = transform_of(other)
    if earlier is None:
        return Transform(fit, frame_id, turn_of(one), turn_of(other), georeference_of(one))
    together = Similarity.of(fit.matrix @ earlier.fit.matrix)
    assert together is not None
    return Transform(together, frame_id, turn_of(one), earlier.before, georeference_of(one))


def transform_of(meta: Mapping[str, Any]) -> Transform | None:
    """Return the transform with which the recording of a map was read; None: without."""
    reading = meta.get("reading")
    given = reading.get("transform") if isinstance(reading, Mapping) else None
    return None if given is None else _checked(given, "meta: reading: transform")


def read_transform(source: str | os.PathLike[str] | Mapping[str, Any]) -> Transform:
    """Return the transform in a JSON file that `mls align` wrote, or in what it holds.

    Raises
    ------
    InputError
        Where the file cannot be read, or holds something else.
    """
    expect(source, (str, os.PathLike, Mapping), "transform", "the path of a JSON file, or its keys")
    if isinstance(source, Mapping):
        return _checked(source, "`transform`")
    path = Path(source)
    try:
        held = json.loads(read_input(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is no JSON that mls align wrote: {error}") from None
    return _checked(held, str(path))


def _checked(held: Any, name: str) -> Transform:
    if not isinstance(held, Mapping) or MATRIX not in held:
        raise InputError(f"{name}: has no key {MATRIX}; mls align A B -o FILE.json writes it")
    fit = Similarity.of(_numbers(held[MATRIX]))
    if fit is None:
        raise InputError(
            f"{name}: {MATRIX} holds {str(held[MATRIX])[:60]}; it must be a turn about z, a scale "
            "and a shift, 4 rows of 4"
        )
    frame_id = held.get(FRAME, "map")
    if not isinstance(frame_id, str):
        raise InputError(f"{name}: {FRAME} holds {str(frame_id)[:60]}; it must be a text")
    turn, before = (turn_of({TURN: held[key]} if key in held else {}) for key in (TURN, FROM))
    place = held.get(GEOREFERENCE)
    if place is not None:
        place = checked_georeference(place, f"{name}: {GEOREFERENCE}")
    return Transform(fit, frame_id, turn, before, place)


def _numbers(rows: Any) -> Array:
    try:
        return np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)
