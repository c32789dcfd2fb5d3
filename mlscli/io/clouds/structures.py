"""Read successive binary records of numbers, and of lists that begin with their length.

The fields of a record follow each other without gaps. Where no field is a list, all records have
one size and columns are views of the file; otherwise the records are walked once. Counts and
lengths come from the file and are not trusted: no more is allocated than its bytes could fill.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.io.files import open_input
from mlscli.runtime.arrays import Array, Int64, UInt8, frozen
from mlscli.runtime.kernels import kernel

_BLOCK_RECORDS = 1 << 16


class Member(NamedTuple):
    """A field of a record.

    Attributes
    ----------
    name : str
    type : str
        The numpy type of its number, or of each number of its list, without byte order: f4.
    length : str
        The numpy type of the number that begins a list; empty where the field is no list.
    """

    name: str
    type: str
    length: str = ""


class Structures(NamedTuple):
    """The records read.

    Attributes
    ----------
    size : int
        Number of whole records.
    columns : list of arrays
        The numbers of each wanted field, (size,); for a list int64 (size, 2): the offset in the
        data at which its items begin, in bytes, and how many they are.
    rest : uint8 (bytes,)
        The bytes that follow; none where records are missing.
    """

    size: int
    columns: list[Array]
    rest: UInt8


def bytes_of(path: Path) -> UInt8:
    """Return the bytes of a file, uint8 (bytes,).

    They are read, not mapped into memory: a file that is cut meanwhile would end the program.
    """
    with open_input(path) as file:
        return frozen(np.fromfile(file, dtype=np.uint8))


def read_structures(
    data: UInt8,
    fields: Sequence[Member],
    count: int | None,
    wanted: Sequence[int] = (),
    order: str = "<",
) -> Structures:
    """Read up to `count` records, or as many as are whole; without a count, all there are.

    Parameters
    ----------
    data : uint8 (bytes,)
    fields : sequence of Member
        All fields of a record, in order.
    count : int or None
        As the file declares it; may exceed what there is.
    wanted : sequence of int
        Indices of the fields to return.
    order : str
        The byte order of all numbers: < or >.
    """
    sizes = np.array([np.dtype(field.type).itemsize for field in fields], dtype=np.int64)
    lengths = np.array(
        [np.dtype(field.length).itemsize if field.length else 0 for field in fields], dtype=np.int64
    )
    least = int(np.where(lengths > 0, lengths, sizes).sum())
    if count is None:
        count = len(data) // least if least else 0
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
    """Return the numbers at these offsets, which need not be aligned.

    Parameters
    ----------
    data : uint8 (bytes,)
    at : int64 (N,)
        Offsets in bytes.
    type_ : str
        The numpy type of the numbers, with byte order: <f4.

    Returns
    -------
    (N,)
        Of that type.
    """
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
    """Find where the wanted fields of each record begin.

    Parameters
    ----------
    data : uint8 (bytes,)
    sizes : int64 (F,)
        Size in bytes of a number of each field of a record.
    lengths : int64 (F,)
        Size in bytes of the number that begins a list; 0 where the field is no list.
    slots : int64 (F,)
        The column of `at` for each field; -1 where it is not wanted.
    big_endian : bool
        Byte order of the lengths of lists.
    count : int
        How many records to walk, at most.
    at : int64 (count, wanted)
        Overwritten with the offset in bytes at which each wanted field begins.

    Returns
    -------
    count : int
        How many records are whole.
    end : int
        Offset in bytes of what follows them.
    """
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
