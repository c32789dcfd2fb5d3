"""Mix the bits of many rows into their keys."""

from __future__ import annotations

from mlscli.geometry import splitmix
from mlscli.runtime.arrays import UInt64
from mlscli.runtime.kernels import inner, kernel

_mixed = inner(splitmix.mixed)


@kernel
def mix(keys: UInt64, bits: UInt64) -> None:
    """Mix bits, uint64 (N,), into the keys of the rows (N,)."""
    for row in range(len(keys)):
        keys[row] = _mixed(keys[row] ^ bits[row])
