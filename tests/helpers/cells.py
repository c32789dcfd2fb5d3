"""Sets of cells, listed one by one."""

from __future__ import annotations

from mlscli.maps.strips import STRIP_BITS, STRIP_CELLS, Strips


def cells_in(strips: Strips) -> set[int]:
    """Return the packed keys of the cells of a set."""
    return {
        (number << STRIP_BITS) + cell
        for number, bits in zip(strips.number.tolist(), strips.bits.tolist(), strict=True)
        for cell in range(STRIP_CELLS)
        if bits >> cell & 1
    }
