"""Parameters: lengths, and fields that know their unit, range and meaning.

A length is a number in the unit of the recording, or a number of cells: a monocular map has no
scale, so that only the size of a cell says what is near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

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
    """Return how many whole cells a length spans, forgiving a last digit."""
    cells = length.count if isinstance(length, Cells) else length / cell_size
    return math.floor(min(cells + 1e-9, WIDEST))


def comparable(*lengths: Length) -> bool:
    """Tell whether lengths can be compared without knowing the size of a cell."""
    return len({isinstance(length, Cells) for length in lengths}) <= 1


def parameter(
    default: Any,
    help: str,  # noqa: A002
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    default_from: str | None = None,
) -> Any:
    """Declare a field of a parameter dataclass; the configuration's schema follows from it.

    Parameters
    ----------
    default
        The value where none is given.
    help
        What it does, in one line, with its unit.
    low, high
        The least and the greatest value allowed, inclusive (of a length: its number).
    above
        A bound that the value must exceed.
    default_from
        The parameter that a configuration takes the value from where none is given, such as
        ``vehicle.width``.
    """
    metadata = {
        "help": help,
        "low": low,
        "high": high,
        "above": above,
        "default_from": default_from,
    }
    return field(default=default, metadata=metadata)
