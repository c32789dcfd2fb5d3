"""Decompress chunks, files and messages: in bounded memory, and cut ones as far as they go."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any, BinaryIO

from mlscli.errors import one_line
from mlscli.io.containers.losses import DamagedError
from mlscli.io.unpacking import excess, most_held, most_unpacked

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

# Small, as decompression can make a block of zstd 30,000 times as large.
_PIECE_BYTES = 1 << 14
_SMALL_PIECE = 1 << 8
# About the size of a chunk of a bag.
_LZ4_PIECE = 1 << 20


def decompress(data: bytes, method: str, size: int) -> bytes:
    """Decompress a whole chunk.

    Parameters
    ----------
    data : bytes
    method : str
        ``bz2``, ``lz4`` (a frame), ``zstd``, or ``none``, for which it may also be empty.
    size : int
        Declared size of the content, in bytes; ignored where the method is none.

    Returns
    -------
    bytes

    Raises
    ------
    DamagedError
        The content is damaged or of another size, or the method is not known.
    """
    if method in ("", "none"):
        return data
    if size > most_held(len(data)):
        raise DamagedError(f"it claims {size:,} bytes decompressed: {excess(len(data))}")
    try:
        content = _whole(method)(data, size)
    except (ValueError, OSError, RuntimeError, MemoryError, EOFError, _zstd_error()) as error:
        if isinstance(error, DamagedError):
            raise
        raise DamagedError(f"{method}: {_reason(error)}") from error
    _compare(len(content), size)
    return content


def decompress_start(data: bytes, method: str, size: int) -> bytes:
    """Decompress the beginning of a chunk whose end is missing, at most `size` bytes.

    There are no more than a whole chunk may have, see `mlscli.io.unpacking`. The methods are those
    of `decompress`; of an unknown one nothing is returned.
    """
    if method in ("", "none"):
        return data[:size]
    size = min(size, most_held(len(data)))
    stream = _stream(method)
    pieces = []
    have = 0
    # In small pieces, so that what comes before a fault is kept.
    for at in range(0, len(data), _SMALL_PIECE):
        try:
            piece = stream(data[at : at + _SMALL_PIECE], size - have)
        except (ValueError, OSError, RuntimeError, MemoryError, EOFError, _zstd_error()):
            break
        pieces.append(piece)
        have += len(piece)
        if have >= size:
            break
    return b"".join(pieces)[:size]


def plain(data: bytes | memoryview, encoding: str) -> bytes | memoryview | DamagedError:
    """Return a message decompressed, or the error that says what is wrong with it.

    ROS 2 can compress each message with zstd. It then begins with the magic of zstd, as no message
    in CDR does; any other message is returned as it is.
    """
    if encoding != "cdr" or data[:4] != ZSTD_MAGIC:
        return data
    import zstandard

    compressed = bytes(data)
    try:
        size = zstandard.frame_content_size(compressed)
        return (
            decompress(compressed, "zstd", size)
            if size >= 0
            else _zstd_in_pieces(compressed, most_held(len(compressed)))
        )
    except (zstandard.ZstdError, MemoryError) as error:
        return DamagedError(f"zstd: {_reason(error)}")
    except DamagedError as error:
        return error


def decompress_file(source: BinaryIO, target: BinaryIO) -> str:
    """Decompress a zstd file as far as it goes.

    Returns
    -------
    str
        What is wrong with the file; empty where nothing is.
    """
    import zstandard

    frame, packed = None, source.seek(0, 2)
    left = most_unpacked(packed)
    source.seek(0)
    try:
        while piece := source.read(_PIECE_BYTES):
            while piece:
                frame = frame or zstandard.ZstdDecompressor().decompressobj()
                left -= target.write(plain := frame.decompress(piece)[:left])
                if not left and plain:
                    return excess(packed)
                piece = frame.unused_data if frame.eof else b""
                frame = None if frame.eof else frame
    except zstandard.ZstdError as error:
        return f"zstd: {_reason(error)}"
    return "" if frame is None else "it breaks off"


def _whole(method: str) -> Callable[[bytes, int], bytes]:
    """Return a function of data and a size that decompresses, and stops soon beyond that size."""
    if method == "bz2":
        return lambda data, size: bz2.BZ2Decompressor().decompress(data, size + 1)
    if method == "lz4":
        return _lz4
    if method == "zstd":
        return _zstd
    raise DamagedError(f"its compression is {method[:20]!r}, expected none, bz2, lz4 or zstd")


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    # Piece by piece, as lz4 allocates the size asked for, however little data there is.
    frame: Any = lz4.frame.LZ4FrameDecompressor()
    pieces = [bytes(frame.decompress(data, min(size + 1, _LZ4_PIECE)))]
    have = len(pieces[0])
    while pieces[-1] and not frame.eof and have <= size:
        pieces.append(bytes(frame.decompress(b"", min(size + 1 - have, _LZ4_PIECE))))
        have += len(pieces[-1])
    if not frame.eof:
        raise DamagedError(f"lz4: it breaks off, or holds more than {size:,} bytes")
    return b"".join(pieces)


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    stated = zstandard.frame_content_size(data)
    if stated < 0:
        return _zstd_in_pieces(data, size)
    _compare(stated, size)
    return zstandard.ZstdDecompressor().decompress(data)


def _zstd_in_pieces(data: bytes, size: int) -> bytes:
    """Decompress a frame that does not state its size; stop soon beyond `size` bytes."""
    import zstandard

    frame = zstandard.ZstdDecompressor().decompressobj()
    pieces = []
    have = 0
    for at in range(0, len(data), _SMALL_PIECE):
        pieces.append(frame.decompress(data[at : at + _SMALL_PIECE]))
        have += len(pieces[-1])
        if have > size or frame.eof:
            break
    if not frame.eof:
        raise DamagedError(f"zstd: it breaks off, or holds more than {size:,} bytes")
    return b"".join(pieces)


def _compare(stated: int, declared: int) -> None:
    if stated != declared:
        raise DamagedError(f"it holds {stated:,} bytes decompressed, declared {declared:,}")


def _stream(method: str) -> Callable[[bytes, int], bytes]:
    """Return a function of the next data and of how many bytes are wanted, or a few more."""
    if method == "bz2":
        return bz2.BZ2Decompressor().decompress
    if method == "lz4":
        import lz4.frame

        decompress_lz4: Any = lz4.frame.LZ4FrameDecompressor()
        return lambda data, size: bytes(decompress_lz4.decompress(data, size))
    if method == "zstd":
        import zstandard

        decompress_zstd = zstandard.ZstdDecompressor().decompressobj().decompress
        # No more than 30,000 bytes for each.
        return lambda data, _: decompress_zstd(data)
    return lambda _, __: b""


def _zstd_error() -> type[Exception]:
    import zstandard

    return zstandard.ZstdError


def _reason(error: Exception) -> str:
    return one_line(error) or type(error).__name__
