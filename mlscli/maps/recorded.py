"""The way back from the frame of a map to that of its recording, which `up` turned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mlscli.errors import InputError
from mlscli.runtime.arrays import Float64

TURN = "map_from_recording"
"""The key in a map's meta of the turn after which z points up: rows of a matrix (4, 4)."""

# How far the rotation of a turn may be from one, as its numbers are rounded; of a shift, this share
# of its length.
_ROUNDED = 1e-6


def turn_of(meta: Mapping[str, Any]) -> Float64:
    """Return the turn that a map's meta holds, float64 (4, 4), for homogeneous coordinates.

    It takes the coordinates of the recording to those of the map. It is the identity where the meta
    holds none.

    Raises
    ------
    InputError
        What it holds is no rotation and shift.
    """
    if TURN not in meta:
        return np.eye(4)
    try:
        turn = np.array(meta[TURN], dtype=np.float64)
    except (TypeError, ValueError):
        turn = np.empty(0)
    if turn.shape == (4, 4) and np.isfinite(turn).all():
        rotation = turn[:3, :3]
        is_rotation = np.abs(rotation @ rotation.T - np.eye(3)).max() < _ROUNDED
        if is_rotation and np.linalg.det(rotation) > 0 and turn[3].tolist() == [0, 0, 0, 1]:
            return turn
    raise InputError(
        f"meta: {TURN} holds {str(meta[TURN])[:60]}; it must be a rotation and a shift, 4 rows of 4"
    )


def turns_apart(meta: Mapping[str, Any], other: Mapping[str, Any]) -> float | None:
    """Return by how much the turns of two maps differ at most, number by number.

    None where they differ by no more than a rounding.

    Raises
    ------
    InputError
        As `turn_of`.
    """
    one, two = turn_of(meta), turn_of(other)
    apart = np.abs(one - two)
    allowed = np.full((4, 4), _ROUNDED)
    allowed[:3, 3] *= max(1.0, float(np.abs(one[:3, 3]).max()), float(np.abs(two[:3, 3]).max()))
    return float(apart.max()) if (apart > allowed).any() else None


def as_recorded(points: Float64, meta: Mapping[str, Any]) -> Float64:
    """Return points of a map in the frame of the recording that it was built from.

    Parameters
    ----------
    points : float64 (N, 3)
        Coordinates in the map frame.
    meta : mapping
        That of the map.

    Returns
    -------
    float64 (N, 3)

    Raises
    ------
    InputError
        As `turn_of`.
    """
    turn = turn_of(meta)
    return np.asarray(np.einsum("ni,ij->nj", points - turn[:3, 3], turn[:3, :3]) + 0.0)
