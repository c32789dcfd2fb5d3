"""Binary records one after the other, of numbers and of lists that say their own length.

A record's fields follow each other without gaps. Where no field is a list, all records have one
size and columns are views of the file; otherwise the records are walked once. Counts and lengths
are taken from the file, so nothing is allocated that the bytes at hand could not fill.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Array, Int64, UInt8
from mlscli.runtime.kernels import kernel

_BLOCK_RECORDS = 1 << 16


class Member(NamedTuple):
    """A field of a record.

    Attributes
    ----------
    name : str
    type : str
        Of its number, or of each number of its list, as numpy writes it without byte order: f4.
    length : str
        The type of the number that begins a list; empty where the field is no list.
    """

    name: str
    type: str
    length: str = ""


class Structures(NamedTuple):
    """Structures read.

    Attributes
    ----------
    size : int
        How many are whole.
    columns : list of arrays
        The numbers of each field asked for, (size,); of a list, int64 (size, 2): the byte at
        which its items begin and how many there are.
    rest : uint8
        The bytes that follow; none where records are missing.
    """

    size: int
    columns: list[Array]
    rest: UInt8


def mapped(path: Path) -> UInt8:
    """Return the bytes of a file, paged in as they are looked at."""
    if path.stat().st_size == 0:
        return np.empty(0, dtype=np.uint8)
    return np.memmap(path, dtype=np.uint8, mode="r")


def read_structures(
    data: UInt8, fields: Sequence[Member], count: int, wanted: Sequence[int] = (), order: str = "<"
) -> Structures:
    """Read up to `count` records, or as many as are whole.

    Parameters
    ----------
    data : uint8 (bytes,)
    fields : sequence of Member
    count : int
        As the file declares it, of any size.
    wanted : sequence of int
        Which fields to return.
    order : str
        The byte order of all numbers: < or >.
    """
    sizes = np.array([np.dtype(field.type).itemsize for field in fields], dtype=np.int64)
    lengths = np.array(
        [np.dtype(field.length).itemsize if field.length else 0 for field in fields], dtype=np.int64
    )
    least = int(np.where(lengths > 0, lengths, sizes).sum())
    came = min(count, len(data) // least) if least else count
    if lengths.any():
        slots = np.full(len(fields), -1)
        slots[list(wanted)] = np.arange(len(wanted))
        at = np.empty((came, len(wanted)), dtype=np.int64)
        came, end = _walk(data, sizes, lengths, slots, order == ">", came, at)
        columns = [
            _listed(data, at[:came, k], order + fields[place].length)
            if fields[place].length
            else gather(data, at[:came, k], order + fields[place].type)
            for k, place in enumerate(wanted)
        ]
    else:
        end = came * least
        columns = [
            # Not a structured type: its size is limited, a record's is not.
            np.ndarray(
                (came,), order + fields[place].type, data, int(sizes[:place].sum()), (least,)
            )
            if came
            else np.empty(0)
            for place in wanted
        ]
    rest = data[end:] if came == count else data[:0]
    return Structures(came, columns, rest)


def gather(data: UInt8, at: Int64, type_: str) -> Array:
    """Return the numbers that begin at these bytes, on whatever boundary."""
    numbers = np.empty(len(at), dtype=type_)
    across = np.arange(numbers.itemsize)
    for begin in range(0, len(at), _BLOCK_RECORDS):
        end = begin + _BLOCK_RECORDS
        numbers[begin:end] = data[at[begin:end, None] + across].view(numbers.dtype)[:, 0]
    return numbers


def _listed(data: UInt8, at: Int64, length: str) -> Int64:
    items = gather(data, at, length).astype(np.int64)
    return np.stack([at + np.dtype(length).itemsize, items], axis=1)


@kernel
def _walk(
    data: UInt8,
    sizes: Int64,
    lengths: Int64,
    slots: Int64,
    big_endian: bool,
    count: int,
    at: Int64,
) -> tuple[int, int]:
    """Note where the fields wanted begin; return how many records are whole and their end."""
    end = 0
    for row in range(count):
        place = end
        for field in range(len(sizes)):
            if slots[field] >= 0:
                at[row, slots[field]] = place
            items = 1
            if lengths[field]:
                if place + lengths[field] > len(data):
                    return row, end
                items = 0
                for k in range(lengths[field]):
                    digit = k if big_endian else lengths[field] - 1 - k
                    items = (items << 8) | int(data[place + digit])
                place += lengths[field]
            # Negative: an unsigned length beyond int64.
            if items < 0 or items > (len(data) - place) // sizes[field]:
                return row, end
            place += items * sizes[field]
        end = place
    return count, end
