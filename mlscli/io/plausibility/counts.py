"""How many points a file holds: what its header declares, against what is there.

Headers are written first and often never corrected: by a writer that broke off, or that went on. So
the data counts, unless what lies behind the points declared is no points but something else.
"""

from __future__ import annotations

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, refused, right
from mlscli.io.plausibility.readings import is_scene
from mlscli.runtime.arrays import Float64
from mlscli.words import are, some

_FAR = 10
"""Points lie within this many times the extent of the others, or there is reason to doubt them."""

_SHARE = 0.9
"""The share of the points that does."""

_FIRST = 10
"""So many of what follows must be points by themselves: the header of another file is longer."""


def more_than(declared: int, there: int) -> str:
    """Return the note on a file that holds more points than its header declares."""
    points = some(declared, "point")
    return f"its header declares {points}, and there {are(there)} {there:,}; all are taken"


def count_of(points: Float64, declared: int) -> Finding[int]:
    """Return how many of the points that are there belong to a cloud.

    Parameters
    ----------
    points : float64 (N, 3)
        All whole records there are, as points; N is at least `declared`.
    declared : int
        How many the header declares.

    Returns
    -------
    Finding of int
        N, or `declared` where zeros alone follow these. Refused where what follows is no points.
    """
    known, more = points[:declared], points[declared:]
    if not len(more) or not more.any():
        return right(declared)
    first = more[more.any(axis=1)][:_FIRST]
    if all(is_scene(part) and _are_near(part, known) for part in (first, more)):
        return doubted(len(points), more_than(declared, len(points)))
    return refused(
        f"what follows the {some(declared, 'point')} that its header declares, room for "
        f"{len(more):,} more, is no points"
    )


def _are_near(more: Float64, known: Float64) -> bool:
    """Return whether points lie in the surroundings of others, as far as these are known."""
    known = known[np.isfinite(known).all(axis=1)]
    if len(known) < 2:
        return True
    low, high = known.min(axis=0), known.max(axis=0)
    reach = _FAR * float((high - low).max())
    with np.errstate(invalid="ignore"):
        near = ((more >= low - reach) & (more <= high + reach)).all(axis=1)
    measured = np.isfinite(more).all(axis=1)
    return not reach or bool(near.sum() >= _SHARE * measured.sum())
