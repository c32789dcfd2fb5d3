"""LZF decompression (M. Lehmann's liblzf), which PCD files use.

A control byte c below 32 is followed by c + 1 literal bytes. Of any other, the upper three bits are
a length (if 7, the next byte is added to it), and the lower five with the byte that follows are a
distance: length + 2 bytes are repeated, from distance + 1 bytes back.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Array, Int64, UInt8
from mlscli.runtime.kernels import kernel

_MOST_PER_BYTE = 88
"""Three bytes repeat at most 264: 88 for each."""


def decompress(data: UInt8, size: int) -> tuple[UInt8, int]:
    """Return up to `size` bytes, uint8 (N,), and how many bytes of the data they came from.

    There are fewer if the data ends early or contradicts itself: if it repeats what lies before the
    first byte, or its last step reaches beyond `size`.
    """
    out = np.empty(min(size, _MOST_PER_BYTE * len(data)), dtype=np.uint8)
    data = np.ascontiguousarray(data)
    written, read = _decompress(data, data, out)
    return out[:written], read


def origins(data: UInt8, size: int) -> Int64:
    """Return for each of the bytes that `decompress` returns the offset in the data it is from."""
    out = np.empty(size, dtype=np.int64)
    written, _ = _decompress(np.ascontiguousarray(data), np.arange(len(data)), out)
    return out[:written]


@kernel
def _decompress(data: UInt8, values: Array, out: Array) -> tuple[int, int]:
    """Decompress `data`, taking from `values` what stands there; see `decompress`."""
    read = written = 0
    while read < len(data) and written < len(out):
        step = read
        control = int(data[read])
        read += 1
        if control < 32:
            if control + 1 > len(out) - written:
                return written, step
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
                return written, step
            start = written - 1 - ((control & 31) << 8) - int(data[read])
            read += 1
            if start < 0 or length + 2 > len(out) - written:
                return written, step
            length += 2
            # The repeated bytes may overlap those being written.
            for k in range(length):
                out[written + k] = out[start + k]
        written += length
    return written, read
