"""Compressed chunks, files and messages: bounded, and read as far as they go where cut."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any, BinaryIO

from mlscli.io.losses import DamagedError

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

LARGEST = 1 << 32
"""A chunk or message that claims to be larger than this when decompressed is damaged."""

# A block of zstd can be 30,000 times as large decompressed.
_PIECE = 1 << 14
_SMALL_PIECE = 1 << 10


def decompress(data: bytes, method: str, size: int) -> bytes:
    """Decompress a whole chunk.

    Parameters
    ----------
    data : bytes
    method : str
        bz2, lz4 (a frame), zstd, or none, which is also written as nothing.
    size : int
        What the chunk is declared to hold, in bytes.

    Raises
    ------
    DamagedError
        It holds something else, or the method is not known.
    """
    if method in ("", "none"):
        return data
    if size > LARGEST:
        raise DamagedError(f"it claims {size:,} bytes decompressed, expected at most {LARGEST:,}")
    try:
        content = _whole(method)(data, size)
    except (ValueError, OSError, RuntimeError, MemoryError, EOFError, _zstd_error()) as error:
        if isinstance(error, DamagedError):
            raise
        raise DamagedError(f"{method}: {_one_line(error)}") from error
    if len(content) != size:
        raise DamagedError(f"it holds {len(content):,} bytes decompressed, declared {size:,}")
    return content


def decompress_start(data: bytes, method: str, size: int) -> bytes:
    """Decompress what can be of a chunk whose end is missing, at most `size` bytes."""
    if method in ("", "none"):
        return data[:size]
    stream = _stream(method)
    pieces = []
    have = 0
    # In small pieces: what came before a fault is kept.
    for at in range(0, len(data), _SMALL_PIECE):
        try:
            piece = stream(data[at : at + _SMALL_PIECE])
        except (ValueError, OSError, RuntimeError, MemoryError, EOFError, _zstd_error()):
            break
        pieces.append(piece)
        have += len(piece)
        if have >= size:
            break
    return b"".join(pieces)[:size]


def decompress_message(data: bytes) -> bytes:
    """Decompress a message that is a zstd frame of its own.

    Raises
    ------
    DamagedError
        It is none, or claims to be larger than any message.
    """
    import zstandard

    try:
        size = zstandard.frame_content_size(data)
        if size < 0:
            return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except (zstandard.ZstdError, MemoryError) as error:
        raise DamagedError(f"zstd: {_one_line(error)}") from error
    return decompress(data, "zstd", size)


def decompress_file(source: BinaryIO, target: BinaryIO) -> str:
    """Decompress a zstd file as far as it goes.

    Returns
    -------
    str
        What is wrong with it; empty where nothing is.
    """
    import zstandard

    frame = None
    try:
        while piece := source.read(_PIECE):
            while piece:
                frame = frame or zstandard.ZstdDecompressor().decompressobj()
                target.write(frame.decompress(piece))
                piece = frame.unused_data if frame.eof else b""
                frame = None if frame.eof else frame
    except zstandard.ZstdError as error:
        return f"zstd: {_one_line(error)}"
    return "" if frame is None else "it breaks off"


def _whole(method: str) -> Callable[[bytes, int], bytes]:
    """Return what decompresses to at most a size, or one byte more where there is more."""
    if method == "bz2":
        return lambda data, size: bz2.BZ2Decompressor().decompress(data, size + 1)
    if method == "lz4":
        import lz4.frame

        return lambda data, _: lz4.frame.decompress(data)
    if method == "zstd":
        return _zstd
    raise DamagedError(f"its compression is {method[:20]!r}, expected none, bz2, lz4 or zstd")


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    stated = zstandard.frame_content_size(data)
    if stated >= 0 and stated != size:
        raise DamagedError(f"it holds {stated:,} bytes decompressed, declared {size:,}")
    if stated < 0:
        # Nothing is allocated by what was declared.
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)


def _stream(method: str) -> Callable[[bytes], bytes]:
    if method == "bz2":
        return bz2.BZ2Decompressor().decompress
    if method == "lz4":
        import lz4.frame

        decompress_lz4: Any = lz4.frame.LZ4FrameDecompressor()
        return lambda data: bytes(decompress_lz4.decompress(data))
    if method == "zstd":
        import zstandard

        return zstandard.ZstdDecompressor().decompressobj().decompress
    return lambda _: b""


def _zstd_error() -> type[Exception]:
    import zstandard

    return zstandard.ZstdError


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200].rstrip(".") or type(error).__name__
