"""LZF decompression (M. Lehmann's liblzf), which PCD files use.

A control byte c below 32 is followed by c + 1 literal bytes. Of any other, the upper three bits are
a length (if 7, the next byte is added to it), and the lower five with the byte that follows are a
distance: length + 2 bytes are repeated, from distance + 1 bytes back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Array, Int64, UInt8
from mlscli.runtime.kernels import kernel

_MOST_PER_BYTE = 88
"""Three bytes repeat at most 264: 88 for each."""

_PARTS = 4
"""So many beginnings of steps are returned."""


class Plain(NamedTuple):
    """What compressed bytes yield.

    Attributes
    ----------
    data : uint8 (N,)
    used : int
        How many of the compressed bytes it came from.
    steps : list of (int, int)
        Where some steps begin, spread evenly: the offset in the compressed bytes and in `data`.
    """

    data: UInt8
    used: int
    steps: list[tuple[int, int]]


def decompress(data: UInt8, size: int) -> Plain:
    """Return up to `size` bytes.

    There are fewer if the data ends early or contradicts itself: if it repeats what lies before the
    first byte, or its last step reaches beyond `size`.
    """
    out = np.empty(min(size, _MOST_PER_BYTE * len(data)), dtype=np.uint8)
    data = np.ascontiguousarray(data)
    steps, read, written = [(0, 0)], 0, 0
    for part in range(1, _PARTS + 1):
        stop = len(out) * part // _PARTS
        read, written = _decompress(data, data, out, read, written, stop)
        if written < stop or part == _PARTS:
            break
        steps.append((read, written))
    return Plain(out[:written], read, steps)


def origins(data: UInt8, size: int) -> Int64:
    """Return for each of the bytes that `decompress` returns the offset in the data it is from."""
    out = np.empty(size, dtype=np.int64)
    _, written = _decompress(np.ascontiguousarray(data), np.arange(len(data)), out, 0, 0, size)
    return out[:written]


@kernel
def _decompress(
    data: UInt8, values: Array, out: Array, read: int, written: int, stop: int
) -> tuple[int, int]:
    """Decompress data from the beginning of a step on; see `decompress`.

    Parameters
    ----------
    data : uint8 (bytes,)
        Compressed.
    values : (bytes,)
        What is written for each of these bytes.
    out : (N,)
        Receives what they yield.
    read, written : int
        Where the step begins, in the data and in `out`.
    stop : int
        How much to write, at least.

    Returns
    -------
    read, written : int
        Where the next step begins, or the first that cannot be taken.
    """
    while read < len(data) and written < stop:
        step = read
        control = int(data[read])
        read += 1
        if control < 32:
            if control + 1 > len(out) - written:
                return step, written
            length = min(control + 1, len(data) - read)
            for k in range(length):
                out[written + k] = values[read + k]
            read += length
        else:
            length = control >> 5
            if length == 7 and read < len(data):
                length += int(data[read])
                read += 1
            if read == len(data):
                return step, written
            start = written - 1 - ((control & 31) << 8) - int(data[read])
            read += 1
            if start < 0 or length + 2 > len(out) - written:
                return step, written
            length += 2
            # The repeated bytes may overlap those being written.
            for k in range(length):
                out[written + k] = out[start + k]
        written += length
    return read, written
