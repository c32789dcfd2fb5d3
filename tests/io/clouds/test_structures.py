"""Records of numbers and lists, against records that are written one by one.

How one could cheat: records of one size, wanted fields that stand first, data that end where the
last record does.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import pytest

from mlscli.io.clouds.structures import Member, read_structures

FIELDS = [Member("a", "f4"), Member("many", "i2", "u1"), Member("b", "u2"), Member("c", "f8", "i4")]
RECORDS: list[tuple[float, list[int], int, list[float]]] = [
    (1.5, [1, 2, 3], 7, []),
    (-2.0, [], 65535, [0.25]),
    (0.5, [-5], 0, [1.0, 2.0]),
]


def written(order: str, records: Sequence[tuple[float, list[int], int, list[float]]]) -> bytes:
    return b"".join(
        struct.pack(f"{order}fB{len(many)}hHi{len(c)}d", a, len(many), *many, b, len(c), *c)
        for a, many, b, c in records
    )


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("count", [None, 3])
@pytest.mark.parametrize("rest", [b"", b"x"])
def test_wanted_fields_are_found_in_each_record(order: str, count: int | None, rest: bytes) -> None:
    data = np.frombuffer(written(order, RECORDS) + rest, dtype=np.uint8)
    read = read_structures(data, FIELDS, count, (2, 0, 3, 1), order)
    b, a, c, many = read.columns
    assert read.size == 3
    assert (b.tolist(), a.tolist()) == ([7, 65535, 0], [1.5, -2.0, 0.5])
    for found, name, place in ((c, f"{order}f8", 3), (many, f"{order}i2", 1)):
        lists = [np.frombuffer(data, name, number, at).tolist() for at, number in found.tolist()]
        assert lists == [record[place] for record in RECORDS]
    assert bytes(read.rest) == (rest if count else b"")


def test_cut_anywhere_as_many_records_are_read_as_are_whole() -> None:
    ends = np.cumsum([0, *(len(written("<", [record])) for record in RECORDS)]).tolist()
    whole = written("<", RECORDS)
    for size in range(len(whole) + 1):
        data = np.frombuffer(whole[:size], dtype=np.uint8)
        read = read_structures(data, FIELDS, 3, (0, 2))
        assert read.size == sum(end <= size for end in ends[1:])
        assert read.columns[0].tolist() == [record[0] for record in RECORDS[: read.size]]


def test_a_length_that_is_negative_ends_the_records() -> None:
    data = struct.pack("<fBHi", 1.0, 0, 1, 0) + struct.pack("<fBHi", 1.0, 0, 1, -1) + bytes(40)
    # Lengths beyond int64 become negative.
    read = read_structures(np.frombuffer(data, dtype=np.uint8), FIELDS, 2, (0,))
    assert read.size == 1
