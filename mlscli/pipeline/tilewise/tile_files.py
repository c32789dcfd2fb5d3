"""Files of evaluated tiles, as a checkpoint keeps them.

A file begins with a digest of what it belongs to and ends with a digest of itself. Between them
stand tiles, one after the other.
"""

from __future__ import annotations

import hashlib
import json
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from mlscli.io.writing.atomic import atomic_write
from mlscli.keyframes.batches import Points
from mlscli.maps.grid import Grid
from mlscli.maps.records import PATCH, records_of, surface_of
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.tiles import EvaluatedTile
from mlscli.runtime.arrays import Array

DIGEST = 32
"""The size of a digest, in bytes."""

# Of a tile: its number, its patches, its points (-1: not kept), the bytes of what it dropped.
_HEAD = struct.Struct("<4q")
_POINT = np.dtype([("xyz", np.float64, (3,)), ("keyframe", np.int32)])
_CHUNK = 2**20


def digest_of(text: str) -> str:
    """Return the digest of a text, as hexadecimal digits."""
    return hashlib.blake2b(text.encode(), digest_size=DIGEST).hexdigest()


@contextmanager
def keep_tiles(path: Path, owner: bytes) -> Iterator[Callable[[int, EvaluatedTile], None]]:
    """Give a function that keeps numbered tiles; the file is there once the block has ended.

    Parameters
    ----------
    path : Path
    owner : bytes
        The digest of what the file belongs to.
    """
    digest = hashlib.blake2b(digest_size=DIGEST)

    def write(data: Any) -> None:
        digest.update(data)
        stream.write(data)

    def put(number: int, tile: EvaluatedTile) -> None:
        for data in _packed(number, tile):
            write(data)

    with atomic_write(path) as stream:
        write(owner)
        yield put
        stream.write(digest.digest())


def is_whole(path: Path, owner: bytes) -> bool:
    """Return whether a file belongs to `owner`, and has the digest that it ends with."""
    left = path.stat().st_size - DIGEST
    digest = hashlib.blake2b(digest_size=DIGEST)
    with path.open("rb") as stream:
        if stream.read(DIGEST) != owner:
            return False
        digest.update(owner)
        left -= DIGEST
        while left > 0 and (data := stream.read(min(left, _CHUNK))):
            digest.update(data)
            left -= len(data)
        return stream.read() == digest.digest()


def tiles_in(path: Path, grid: Grid) -> Iterator[tuple[int, EvaluatedTile]]:
    """Yield the tiles of a file that is whole, with their numbers."""
    end = path.stat().st_size - DIGEST
    with path.open("rb") as stream:
        stream.seek(DIGEST)
        while stream.tell() < end:
            number, patches, points, size = _HEAD.unpack(stream.read(_HEAD.size))
            report = Report(dropped=Counter(json.loads(stream.read(size))))
            surface = surface_of(_array_from(stream, PATCH, patches), grid)
            filtered = None
            if points >= 0:
                kept = _array_from(stream, _POINT, points)
                columns = (np.ascontiguousarray(kept[name]) for name in ("xyz", "keyframe"))
                filtered = Points.of(*columns)
            yield number, EvaluatedTile(surface, report, filtered)


def _packed(number: int, tile: EvaluatedTile) -> Iterator[Any]:
    """Yield the bytes of a tile, part by part."""
    dropped = json.dumps(tile.report.dropped).encode()
    points = -1 if tile.filtered is None else tile.filtered.size
    yield _HEAD.pack(number, tile.surface.size, points, len(dropped))
    yield dropped
    yield _bytes_of(records_of(tile.surface))
    if tile.filtered is not None:
        kept = np.empty(points, _POINT)
        kept["xyz"], kept["keyframe"] = tile.filtered.xyz, tile.filtered.keyframe
        yield _bytes_of(kept)


def _bytes_of(array: Array) -> Any:
    return array.view(np.uint8).data


def _array_from(stream: BinaryIO, dtype: np.dtype[Any], size: int) -> Array:
    array = np.empty(size, dtype)
    stream.readinto(_bytes_of(array))  # type: ignore[attr-defined]
    return array
