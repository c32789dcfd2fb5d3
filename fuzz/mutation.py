"""Files changed at random: bits, runs of bytes, numbers, lines, words, and parts of other files.

A change is a function of the file, of dice and of other material; the same dice make the same file.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Literal

_LARGEST = 1 << 18
"""No file grows beyond this: what is sought is not what takes long because it is long."""

_EDGES = (0, 1, -1, 2, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62)
_FLOATS = (float("nan"), float("inf"), float("-inf"), -0.0, 1e308, -1e308, 5e-324, 1e30, 1e-30, 1e9)
_NUMBERS = (
    *("0", "-0", "1", "-1", "1e308", "-1e308", "1e400", "1e-320", "nan", "-nan", "inf", "-inf"),
    *("99999999999999999999", "2147483648", "4294967296", "9223372036854775808", "1,5", "0x10"),
    *("1e", "--1", "1_000", ".", "+", "1.5.2", "1e9", "-1e7", "0.000001", "٣", "9" * 5000),
)
_WORDS = (
    *("null", "true", "~", "[]", "{}", "[[", "}}", '"', "'", ":", "- ", "#", "&a [*a, *a]", "*a"),
    *(
        "!!python/object/apply:os.system [id]",
        "<<: *a",
        "..",
        "../../outside",
        "/etc/hostname",
        "~/",
    ),
    *("%s%n", "\x1b[31m", "\u202e", "\ud7ff", "\x00", "\r", "\r\n", "\n", "\t", " ", ",", ";", "é"),
)
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]+")


@dataclass(frozen=True)
class Material:
    """What changes take from elsewhere.

    Attributes
    ----------
    others : sequence of bytes
        Files of the same kind.
    words : sequence of bytes
        Words that the kind knows.
    """

    others: Sequence[bytes]
    words: Sequence[bytes]

    @classmethod
    def of(cls, files: Sequence[bytes]) -> Material:
        """Return files and the words in them as material."""
        found = {word for file in files for word in _WORD.findall(file)[:2000]}
        words = sorted(found, key=lambda word: (len(word), word))[:2000]
        return cls(tuple(files), (*words, *(word.encode() for word in _WORDS)))


def mutate(data: bytes, dice: Random, material: Material) -> bytes:
    """Return a file with one change or a few, of which each may be anything in `CHANGES`."""
    for _ in range(dice.choice((1, 1, 1, 2, 3, 6))):
        data = dice.choice(CHANGES)(data, dice, material)[:_LARGEST]
    return data


def _place(data: bytes, dice: Random) -> int:
    """Return a place in a file; every third time among its first bytes, and often among its last.

    At the beginning there are headers; at the end are tables, and values that may be larger than
    all before them.
    """
    kind = dice.random()
    if kind < 0.15:
        return max(0, len(data) - 8 * dice.randrange(5))
    return dice.randrange((min(len(data), 300) if kind < 0.45 else len(data)) + 1)


def _value(data: bytes, dice: Random, size: int) -> int:
    """Return a place where a value of a size may begin: in most files at a multiple of it."""
    place = _place(data, dice)
    return place - place % size if dice.random() < 0.7 else place


def _run(data: bytes, dice: Random) -> tuple[int, int]:
    """Return where a run of bytes begins and ends, most of them short."""
    begin = _place(data, dice)
    return begin, min(len(data), begin + int(2 ** dice.uniform(0, 12)))


def _put(data: bytes, begin: int, end: int, new: bytes) -> bytes:
    return data[:begin] + new + data[end:]


def _bits(data: bytes, dice: Random, _: Material) -> bytes:
    changed = bytearray(data)
    for _turn in range(dice.choice((1, 1, 2, 8)) if data else 0):
        changed[_place(data, dice) - 1] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _bytes(data: bytes, dice: Random, _: Material) -> bytes:
    begin, end = _run(data, dice)
    end = min(end, begin + 16)
    same = bytes([dice.choice((0, 255, 32, 10, 127, dice.randrange(256)))]) * (end - begin)
    return _put(data, begin, end, dice.choice((same, dice.randbytes(end - begin))))


def _cut(data: bytes, dice: Random, _: Material) -> bytes:
    place = _place(data, dice)
    return data[place:] if dice.random() < 0.1 else data[:place]


def _removed(data: bytes, dice: Random, _: Material) -> bytes:
    begin, end = _run(data, dice)
    return _put(data, begin, end, b"")


def _doubled(data: bytes, dice: Random, _: Material) -> bytes:
    begin, end = _run(data, dice)
    return _put(data, begin, end, data[begin:end] * dice.choice((2, 2, 3, 50)))


def _swapped(data: bytes, dice: Random, _: Material) -> bytes:
    (a, b), (c, d) = sorted((_run(data, dice), _run(data, dice)))
    if c < b:
        return data
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _spliced(data: bytes, dice: Random, material: Material) -> bytes:
    other = dice.choice(material.others)
    begin, end = _run(other, dice)
    if dice.random() < 0.3:
        return data[: _place(data, dice)] + other[begin:]
    place = _place(data, dice)
    return _put(data, place, dice.choice((place, place + end - begin)), other[begin:end])


def _integer(data: bytes, dice: Random, _: Material) -> bytes:
    orders: tuple[Literal["little", "big"], ...] = ("little", "big")
    size, order = dice.choice((1, 2, 4, 8)), dice.choice(orders)
    place = _value(data, dice, size)
    there = int.from_bytes(data[place : place + size], order)
    near = (there + 1, there - 1, there * 2, -there, len(data) - place, len(data))
    value = dice.choice((dice.choice(_EDGES), dice.choice(near), 2 ** dice.randrange(64)))
    new = (value % 256**size).to_bytes(size, order)
    return _put(data, place, place + size, new)


def _float(data: bytes, dice: Random, _: Material) -> bytes:
    layout = dice.choice(("<d", ">d", "<f", ">f"))
    value = dice.choice(_FLOATS)
    if layout[1] == "f" and abs(value) > 1e38:
        value = 3e38
    new = struct.pack(layout, value)
    place = _value(data, dice, len(new))
    return _put(data, place, place + len(new), new)


def _number(data: bytes, dice: Random, _: Material) -> bytes:
    """Replace a number in a text; the same one wherever it stands, every tenth time."""
    found = _found(_NUMBER, data, dice)
    if found is None:
        return data
    old = found[0]
    new = dice.choice(
        (dice.choice(_NUMBERS).encode(), b"-" + old, old.replace(b".", b","), old * 2)
    )
    if dice.random() < 0.1:
        return data.replace(old, new)
    return _put(data, found.start(), found.end(), new)


def _token(data: bytes, dice: Random, material: Material) -> bytes:
    new = dice.choice(material.words)
    found = _found(_WORD, data, dice)
    if found is None or dice.random() < 0.4:
        place = _place(data, dice)
        return _put(data, place, place, new)
    if dice.random() < 0.1:
        return data.replace(found[0], new)
    return _put(data, found.start(), found.end(), new)


def _found(what: re.Pattern[bytes], data: bytes, dice: Random) -> re.Match[bytes] | None:
    return what.search(data, _place(data, dice)) or what.search(data)


def _lines(data: bytes, dice: Random, _: Material) -> bytes:
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return data
    one, other = dice.randrange(len(lines)), dice.randrange(len(lines))
    match dice.randrange(5):
        case 0:
            del lines[one : one + dice.choice((1, 1, 5))]
        case 1:
            lines[one:one] = lines[other : other + 1] * dice.choice((1, 1, 30))
        case 2:
            lines[one], lines[other] = lines[other], lines[one]
        case 3:
            lines[one] = b" " * dice.choice((1, 2, 4)) + lines[one]
        case _:
            ending = dice.choice((b"\r\n", b"\r", b"", b"\0\n", b" \n", b"\\\n"))
            lines = [line.rstrip(b"\r\n") + ending for line in lines]
    return b"".join(lines)


def _nested(data: bytes, dice: Random, _: Material) -> bytes:
    """Put brackets around or into it, up to a depth at which recursion ends."""
    opening, closing = dice.choice(((b"[", b"]"), (b"{", b"}"), (b'{"a":', b"}"), (b"- ", b"")))
    times, place = dice.choice((1, 10, 1000, 20_000)), _place(data, dice)
    end = dice.choice((place, len(data)))
    return data[:place] + opening * times + data[place:end] + closing * times + data[end:]


def _encoded(data: bytes, dice: Random, _: Material) -> bytes:
    """Write a text in another encoding."""
    name = dice.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32", "latin-1"))
    return data.decode("utf-8", "replace").encode(name, "replace")


Change = Callable[[bytes, Random, Material], bytes]

CHANGES: tuple[Change, ...] = (
    *(_bits, _bits, _bytes, _cut, _removed, _doubled, _swapped, _spliced),
    *(_integer, _integer, _integer, _float, _float, _number, _number, _number),
    *(_token, _token, _lines, _lines, _nested, _encoded),
)
