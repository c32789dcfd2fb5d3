"""Compressed chunks: what they claim is not believed, and what is cut is read to the cut.

Ways to pass without being right: a size that is compared after it was allocated.
"""

from __future__ import annotations

import bz2
import io
import random
from collections.abc import Callable

import lz4.frame
import pytest
import zstandard

from mlscli.io import unpacking
from mlscli.io.containers.compression import decompress, decompress_file, decompress_start, plain
from mlscli.io.containers.losses import DamagedError
from tests.helpers.broken import allocating_less_than


def zstd_without_size(data: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_content_size=False).compress(data)


def lz4_without_size(data: bytes) -> bytes:
    packed: bytes = lz4.frame.compress(data, store_size=False)
    return packed


FRAMES: dict[str, tuple[str, Callable[[bytes], bytes]]] = {
    "bz2": ("bz2", bz2.compress),
    "lz4": ("lz4", lz4.frame.compress),
    "lz4 without size": ("lz4", lz4_without_size),
    "zstd": ("zstd", zstandard.compress),
    "zstd without size": ("zstd", zstd_without_size),
    "none": ("none", bytes),
}
EVERY_FRAME = pytest.mark.parametrize("name", list(FRAMES))
EVERY_METHOD = pytest.mark.parametrize("name", [name for name in FRAMES if name != "none"])


@EVERY_FRAME
def test_a_chunk_is_what_was_compressed(name: str) -> None:
    method, compress = FRAMES[name]
    data = random.Random(1).randbytes(100_000)
    assert decompress(compress(data), method, len(data)) == data


@EVERY_METHOD
def test_a_chunk_larger_than_declared_is_damaged_before_it_is_held(name: str) -> None:
    method, compress = FRAMES[name]
    packed = compress(bytes(50_000_000))
    with allocating_less_than(15_000_000), pytest.raises(DamagedError):
        decompress(packed, method, 4096)


@EVERY_METHOD
def test_a_chunk_smaller_than_declared_is_damaged(name: str) -> None:
    method, compress = FRAMES[name]
    for size in (5001, 1 << 31, 1 << 63):
        # bz2 itself needs 4 MB.
        with allocating_less_than(8_000_000), pytest.raises(DamagedError):
            decompress(compress(bytes(5000)), method, size)


@EVERY_METHOD
def test_a_chunk_without_its_end_is_damaged(name: str) -> None:
    method, compress = FRAMES[name]
    packed = compress(random.Random(3).randbytes(300_000))
    for end in (0, 3, len(packed) // 2):
        with pytest.raises(DamagedError):
            decompress(packed[:end], method, 300_000)


@EVERY_FRAME
def test_of_a_cut_chunk_the_beginning_is_read(name: str) -> None:
    method, compress = FRAMES[name]
    data = random.Random(2).randbytes(3_000_000)
    packed = compress(data)
    for share in (0.0, 0.3, 0.6, 0.99):
        found = decompress_start(packed[: int(len(packed) * share)], method, len(data))
        assert data.startswith(found)
        # The blocks of bz2 have 900 kB, the others' at most 256 kB.
        assert len(found) >= share * len(data) - 950_000
    assert decompress_start(packed, method, 1000) == data[:1000]


@EVERY_METHOD
def test_what_unpacks_to_gigabytes_is_damaged_whatever_it_claims(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpacking, "ALWAYS", 1 << 20)
    method, compress = FRAMES[name]
    monkeypatch.setattr(unpacking, "RATIO", 20)
    packed = compress(bytes(20_000_000))
    most = unpacking.most_held(len(packed))
    for size in (20_000_000, 1 << 62):
        # Decompressing takes some memory by itself, and zstd 30,000 bytes for each of a piece.
        with allocating_less_than(14_000_000):
            with pytest.raises(DamagedError, match=f"would unpack to more than {most:,}, 20 times"):
                decompress(packed, method, size)
            assert len(decompress_start(packed, method, size)) == most
            assert not name.startswith("zstd") or isinstance(plain(packed, "cdr"), DamagedError)


def test_a_file_that_unpacks_to_gigabytes_fills_no_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "ALWAYS", 1 << 20)
    target = io.BytesIO()
    packed = zstandard.compress(bytes(20_000_000))
    assert decompress_file(io.BytesIO(packed), target) == unpacking.excess(len(packed))
    assert len(target.getvalue()) == 1 << 20


def test_an_unknown_method_is_named() -> None:
    with pytest.raises(DamagedError, match="'snappy'"):
        decompress(b"abc", "snappy", 3)


def test_only_messages_in_cdr_are_taken_for_compressed() -> None:
    packed = zstandard.compress(b"\0\1\0\0message")
    assert plain(packed, "cdr") == b"\0\1\0\0message"
    assert plain(zstd_without_size(b"\0\1\0\0message"), "cdr") == b"\0\1\0\0message"
    assert plain(packed, "ros1") == packed
    assert plain(b"\0\1\0\0message", "cdr") == b"\0\1\0\0message"
    for cut in (5, 8, len(packed) - 1):
        assert isinstance(plain(packed[:cut], "cdr"), DamagedError)


def test_a_file_of_several_frames_is_read_whole_and_a_cut_one_told() -> None:
    data = random.Random(3).randbytes(300_000)
    packed = zstandard.compress(data[:200_000]) + zstandard.compress(data[200_000:])
    target = io.BytesIO()
    assert decompress_file(io.BytesIO(packed), target) == ""
    assert target.getvalue() == data
    target = io.BytesIO()
    assert decompress_file(io.BytesIO(packed[:-5]), target) == "it breaks off"
    assert data.startswith(target.getvalue())
    assert len(target.getvalue()) >= 200_000
