"""Lengths: numbers in the unit of the recording, or numbers of cells.

A monocular map has no scale of its own: lengths there are best given in cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

# The whole grid, in cells: indices are int32.
WIDEST = 2**32

FARTHEST = 1e8
"""The greatest absolute value of a coordinate; a point with a greater one is no measurement."""

SMALLEST_CELL, LARGEST_CELL = 1e-9, 1e9
"""The sides that a cell may have."""

# Of a cell: lengths that differ by no more are the same length, written or computed otherwise.
ALIKE = 1e-9


@dataclass(frozen=True)
class Cells:
    """A length given as a number of cells."""

    count: float

    def __str__(self) -> str:
        count = int(self.count) if self.count == int(self.count) else self.count
        return f"{count!r} {'cell' if count == 1 else 'cells'}"


Length: TypeAlias = float | Cells


def in_units(length: Length, cell_size: float) -> float:
    """Return a length in the unit of the recording."""
    return length.count * cell_size if isinstance(length, Cells) else float(length)


def whole_cells(length: Length, cell_size: float) -> int:
    """Return how many whole cells a length spans: ``floor(cells + 1e-9)``, at most `WIDEST`."""
    cells = length.count if isinstance(length, Cells) else length / cell_size
    return math.floor(min(cells + ALIKE, WIDEST))


def exceeds(length: Length, other: Length, cell_size: float | None) -> bool | None:
    """Return whether a length is greater than another by more than `ALIKE`.

    Parameters
    ----------
    length, other : float or Cells
    cell_size : float or None
        Side of a cell, in the unit of the recording; None: not yet known.

    Returns
    -------
    bool or None
        None where that depends on the size of a cell, which is not known.
    """
    if cell_size is None:
        if isinstance(length, Cells) != isinstance(other, Cells):
            return None
        # Lengths in cells compare the same for any size of cell. Of lengths in units, the longer
        # stands for a cell: one that is hardly longer may be alike.
        cell_size = max(in_units(length, 1.0), in_units(other, 1.0))
        cell_size = 1.0 if isinstance(length, Cells) else cell_size
    return in_units(length, cell_size) - in_units(other, cell_size) > ALIKE * cell_size


def alike(length: float, other: float, cell_size: float) -> bool:
    """Return whether two lengths in the unit of the recording differ by no more than `ALIKE`."""
    return length == other or abs(length - other) <= ALIKE * cell_size


def shortest(one: Length, other: Length, cell_size: float | None) -> Length | None:
    """Return the shorter of two lengths, the first where they are alike; None as in `longest`."""
    longer = exceeds(one, other, cell_size)
    if longer is None:
        return None
    return other if longer else one


def longest(one: Length, other: Length, cell_size: float | None) -> Length | None:
    """Return the longer of two lengths, the first where they are alike.

    None where that depends on the size of a cell, which is not known.
    """
    longer = exceeds(other, one, cell_size)
    if longer is None:
        return None
    return other if longer else one
