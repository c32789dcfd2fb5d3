"""Coordinates that were declared as whole numbers of 16 bits, and hold halves: float16.

Formats and messages that know no type of 16 bits with a fraction are given halves as ``ushort`` or
``int16``. Halves from 1/128 to 2,048 have bits from 8,192 to 26,623, and negative ones 32,768 more.
Whole numbers lie in both ranges, and nowhere else, only by chance; in one alone they may.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Array

_LOW, _HIGH, _SIGN, _INFINITE = 8_192, 26_624, 32_768, 31_744
"""The bits of 1/128, of 2,048, of -0 and of infinity; NaN is beyond it."""

_FEWEST, _MOST = 16, 1024
"""How many points tell, and how many are looked at."""

_ALL, _SOME = 0.98, 0.05
"""The share of numbers that lie in these ranges, and that of either sign on at least one axis."""


def unveiled(columns: Sequence[Array]) -> Finding[Sequence[Array]]:
    """Return coordinates as halves where they are, though declared as whole numbers.

    Parameters
    ----------
    columns : sequence of three arrays (N,)
        x, y and z, as they were declared.
    """
    count = len(columns[0])
    if count < _FEWEST or any(each.dtype.str[1:] not in ("u2", "i2") for each in columns):
        return right(columns)
    step = count // _MOST + 1
    bits = np.stack([_bits(each[::step]) for each in columns])
    sizes = bits % _SIGN
    tells = (sizes > 0) & (sizes < _INFINITE)
    usual = tells & (sizes >= _LOW) & (sizes < _HIGH)
    few = usual.sum(axis=1)
    if (few < _FEWEST).any() or few.sum() < _ALL * tells.sum():
        return right(columns)
    negative = (usual & (bits >= _SIGN)).sum(axis=1)
    if (np.minimum(negative, few - negative) >= np.maximum(_SOME * few, 2)).any():
        return doubted(
            [each.view(each.dtype.byteorder + "f2") for each in columns],
            "x, y and z are declared as whole numbers, but hold halves (float16), and are read so",
        )
    return doubted(
        columns,
        "x, y and z may be halves (float16) by their values; they are taken as the whole numbers "
        "that are declared",
    )


def _bits(column: Array) -> Array:
    """Return the bits of numbers of 16 bits, as int64."""
    return column.view(column.dtype.byteorder + "u2").astype(np.int64)
