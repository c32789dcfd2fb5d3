"""Parts that lie packed in a file: taken out, changed, and packed again so that they open.

Checksums are those of the changed part: a reader gets to see what is wrong, not only that it is.
"""

from __future__ import annotations

import bz2
import io
import struct
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from mlscli.io.clouds.lzf import decompress
from tests.helpers.broken import mcap_records
from tests.helpers.pcds import encoded


class Part(NamedTuple):
    """A part of a file.

    Attributes
    ----------
    content : bytes
        What it holds, unpacked.
    packed : callable
        Returns the file with another content in its place.
    """

    content: bytes
    packed: Callable[[bytes], bytes]


_PACKERS: dict[bytes, tuple[Callable[[bytes], bytes], Callable[[bytes], bytes]]] = {
    b"": (bytes, bytes),
    b"none": (bytes, bytes),
    b"lz4": (lz4.frame.decompress, lz4.frame.compress),
    b"bz2": (bz2.decompress, bz2.compress),
    b"zstd": (zstandard.decompress, zstandard.compress),
}


def parts_of(data: bytes) -> list[Part]:
    """Return the packed parts of a file; none where it has none, or is damaged."""
    for magic, find in _FINDERS.items():
        if data.startswith(magic):
            try:
                return list(find(data))
            except Exception:
                # A library's reader stumbles over what was changed before.
                return []
    return []


def _members(data: bytes) -> Iterator[Part]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        held = {entry.filename: archive.read(entry) for entry in archive.infolist()}

    def packed(name: str, content: bytes) -> bytes:
        into = io.BytesIO()
        with zipfile.ZipFile(into, "w") as archive:
            for each, kept in held.items():
                archive.writestr(each, content if each == name else kept)
        return into.getvalue()

    for name, content in held.items():
        yield Part(content, partial(packed, name))


def _whole(data: bytes) -> Iterator[Part]:
    yield Part(zstandard.decompress(data, 1 << 22), zstandard.compress)


def _chunks_of_mcap(data: bytes) -> Iterator[Part]:
    for begin, end in mcap_records(data, Opcode.CHUNK):
        # Times of the first and last message, size and checksum unpacked; how it is packed.
        start, stop, _, _, named = struct.unpack_from("<QQQII", data, begin + 9)
        kind = data[begin + 41 : begin + 41 + named]
        unpack, pack = _PACKERS[kind]

        def packed(
            content: bytes,
            begin: int = begin,
            end: int = end,
            times: tuple[int, int] = (start, stop),
            kind: bytes = kind,
            pack: Callable[[bytes], bytes] = pack,
        ) -> bytes:
            body = pack(content)
            head = struct.pack("<QQQII", *times, len(content), 0, len(kind)) + kind
            record = head + struct.pack("<Q", len(body)) + body
            return data[:begin] + struct.pack("<BQ", 6, len(record)) + record + data[end:]

        yield Part(unpack(data[begin + 49 + named : end]), packed)


def _chunks_of_ros1(data: bytes) -> Iterator[Part]:
    at = data.index(b"\n") + 1
    while at + 8 <= len(data):
        (headed,) = struct.unpack_from("<I", data, at)
        head = data[at + 4 : at + 4 + headed]
        (size,) = struct.unpack_from("<I", data, at + 4 + headed)
        begin, end = at + 8 + headed, at + 8 + headed + size
        if b"op=\5" in head:
            kind = next(name for name in (b"lz4", b"bz2", b"none") if b"=" + name in head)
            unpack, pack = _PACKERS[kind]
            content = unpack(data[begin:end])

            def packed(
                content: bytes,
                at: int = at,
                end: int = end,
                head: bytes = head,
                old: int = len(content),
                pack: Callable[[bytes], bytes] = pack,
            ) -> bytes:
                body = pack(content)
                size, new = (b"size=" + struct.pack("<I", each) for each in (old, len(content)))
                told = head.replace(size, new)
                framed = struct.pack("<I", len(told)) + told + struct.pack("<I", len(body)) + body
                return data[:at] + framed + data[end:]

            yield Part(content, packed)
        at = end


def _points_of_pcd(data: bytes) -> Iterator[Part]:
    mark = b"DATA binary_compressed\n"
    begin = data.index(mark) + len(mark)
    size, plain = struct.unpack_from("<II", data, begin)

    def packed(content: bytes) -> bytes:
        body = encoded(content)
        return data[:begin] + struct.pack("<II", len(body), len(content)) + body

    body = np.frombuffer(data, np.uint8, size, begin + 8)
    yield Part(decompress(body, plain)[0].tobytes(), packed)


_FINDERS: dict[bytes, Callable[[bytes], Iterator[Part]]] = {
    b"PK\x03\x04": _members,
    b"\x28\xb5\x2f\xfd": _whole,
    b"\x89MCAP0\r\n": _chunks_of_mcap,
    b"#ROSBAG V2.0\n": _chunks_of_ros1,
    b"# .PCD": _points_of_pcd,
}
