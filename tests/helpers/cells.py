"""Sets of cells, listed one by one."""

from __future__ import annotations

from mlscli.maps.strips import SHIFT, SIDE, Strips


def cells_in(strips: Strips) -> set[int]:
    """Return the packed keys of the cells of a set."""
    return {
        (number << SHIFT) + cell
        for number, bits in zip(strips.number.tolist(), strips.bits.tolist(), strict=True)
        for cell in range(SIDE)
        if bits >> cell & 1
    }
