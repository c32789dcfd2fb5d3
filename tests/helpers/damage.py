"""Files cut and with bits flipped, and what sources make of them."""

from __future__ import annotations

import random
import resource
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.io.source import Source
from mlscli.runtime.arrays import Float64


def cut(content: bytes, times: int) -> Iterator[bytes]:
    """Yield the beginnings of a file: some of any length, and the last few bytes one by one."""
    dice = random.Random(times)
    lengths = {dice.randrange(len(content)) for _ in range(times)}
    lengths |= {len(content) - k for k in range(1, 12)} | {dice.randrange(400) for _ in range(20)}
    yield from (content[:length] for length in sorted(lengths) if 0 <= length < len(content))


def flipped(content: bytes, times: int, first: int) -> Iterator[bytes]:
    """Yield a file with one bit wrong, every other time among its `first` bytes."""
    dice = random.Random(times)
    for number in range(times):
        damaged = bytearray(content)
        damaged[dice.randrange(len(content) if number % 2 else first)] ^= 1 << dice.randrange(8)
        yield bytes(damaged)


def read_damaged(path: Path, source: Callable[[Path], Source]) -> tuple[Float64, list[str]] | None:
    """Return the points that a source yields and its losses; None where it is one clear error.

    Fails where it takes long, where much is allocated, or where it fails in another way.
    """
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        opened = source(path)
        clouds = [cloud.points for cloud in opened.clouds()]
        found = np.concatenate([np.empty((0, 3)), *clouds]), list(opened.losses)
    except InputError as error:
        assert str(path) in str(error)  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
        found = None
    assert time.perf_counter() - begin < 5
    # Kilobytes; some of it is what compiled code and libraries take once.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1 << 19
    return found
