"""PCD files, and bytes compressed as LZF."""

from __future__ import annotations

import random
import struct

from mlscli.runtime.arrays import Array


def pcd(data: str, body: bytes, **entries: object) -> bytes:
    """Return a file of floats x y z, but for the entries given; None leaves one out."""
    usual = {
        "VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F", "COUNT": "1 1 1",
        "WIDTH": 2, "HEIGHT": 1, "VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": 2,
    }  # fmt: skip
    lines = [f"{key} {value}" for key, value in (usual | entries).items() if value is not None]
    return "\n".join(["# .PCD v0.7", *lines, f"DATA {data}", ""]).encode() + body


def compressed(plain: bytes, seed: int = 0) -> bytes:
    """Compress as LZF: literal runs, and repetitions wherever they are found."""
    dice, at, literal, out = random.Random(seed), 0, bytearray(), bytearray()

    def flush() -> None:
        for begin in range(0, len(literal), 32):
            run = literal[begin : begin + 32]
            out.extend([len(run) - 1, *run])
        literal.clear()

    while at < len(plain):
        start = plain.rfind(plain[at : at + 3], max(0, at - 8192), at + 2)
        if 0 <= start < at and at + 3 <= len(plain) and dice.random() < 0.9:
            length = 3
            most = dice.choice([3, 5, 8, 9, 100, 264])
            while (
                length < most
                and plain[start + length : start + length + 1]
                == plain[at + length : at + length + 1]
                != b""
            ):
                length += 1
            flush()
            back, coded = at - start - 1, length - 2
            if coded < 7:
                out.extend([coded << 5 | back >> 8, back & 255])
            else:
                out.extend([7 << 5 | back >> 8, coded - 7, back & 255])
            at += length
        else:
            literal.append(plain[at])
            at += 1
    flush()
    return bytes(out)


def packed(columns: list[Array], seed: int = 0) -> bytes:
    plain = b"".join(column.tobytes() for column in columns)
    body = compressed(plain, seed)
    return struct.pack("<II", len(body), len(plain)) + body


def encoded(plain: bytes, bits: int = 16, factor: int = 5, kept: int = 2) -> bytes:
    """Compress as liblzf does; with 13, 1 and 1 as the Point Cloud Library.

    Parameters
    ----------
    plain : bytes
    bits : int
        Of the hash.
    factor : int
        By which the hash mixes the three bytes.
    kept : int
        How many of the last bytes that are repeated are remembered.
    """
    last: dict[int, int] = {}
    literal, out = bytearray(), bytearray()

    def remember(at: int) -> int:
        three = int.from_bytes(plain[at : at + 3], "big")
        slot = ((three >> (24 - bits)) - factor * three) % (1 << bits)
        before = last.get(slot, 0)
        last[slot] = at
        return before

    def flush() -> None:
        for begin in range(0, len(literal), 32):
            run = literal[begin : begin + 32]
            out.extend([len(run) - 1, *run])
        literal.clear()

    at, end = 0, len(plain)
    while at < end:
        before = remember(at) if at < end - 2 else 0
        if before and at - before <= 8192 and plain[before : before + 3] == plain[at : at + 3]:
            length = 3
            while length < min(264, end - at - 2) and plain[before + length] == plain[at + length]:
                length += 1
            flush()
            back, coded = at - before - 1, length - 2
            out.append(min(coded, 7) << 5 | back >> 8)
            out.extend([coded - 7] * (coded >= 7) + [back & 255])
            for place in range(at + length - kept, at + length):
                if place > at and at + length < end - 2:
                    remember(place)
            at += length
        else:
            literal.append(plain[at])
            at += 1
    flush()
    return bytes(out)
