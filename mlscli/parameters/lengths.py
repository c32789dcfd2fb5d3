"""Lengths: numbers in the unit of the recording, or numbers of cells.

A monocular map has no scale of its own: lengths there are best given in cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

# The whole grid, in cells: indices are int32.
WIDEST = 2**32


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
    return math.floor(min(cells + 1e-9, WIDEST))


def comparable(*lengths: Length) -> bool:
    """Return whether lengths can be compared without knowing the size of a cell."""
    return len({isinstance(length, Cells) for length in lengths}) <= 1
