"""The compressed points of a PCD: field by field, as one run of bytes that LZF compressed.

It has no checksum. What tells damage nevertheless is said in `repetitions` and `exponents` of
`mlscli.io.plausibility`; a byte that was changed to one as likely goes unnoticed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.io.clouds.lzf import decompress, origins
from mlscli.io.plausibility.exponents import odd_exponents
from mlscli.io.plausibility.repetitions import repeats_as_encoded
from mlscli.runtime.arrays import Array, Bool, UInt8
from mlscli.words import are, some


class Packed(NamedTuple):
    """A field as it is stored.

    Attributes
    ----------
    size : int
        Bytes that it takes of each point.
    dtype : str
        The numpy type of its number, with byte order; empty where it is not wanted.
    """

    size: int
    dtype: str = ""


class Unpacked(NamedTuple):
    """The points that compressed bytes yield.

    Attributes
    ----------
    columns : list of arrays (N,)
        The wanted fields of all points whose fields came.
    kept : bool (N,)
        Which of them are not damaged.
    losses : list of str
        What is.
    """

    columns: list[Array]
    kept: Bool
    losses: list[str]


def unpack(
    path: Path, data: UInt8, fields: Sequence[Packed], wanted: Sequence[int], declared: int
) -> Unpacked:
    """Return the points of what follows the header of a compressed PCD.

    Parameters
    ----------
    path : Path
    data : uint8 (bytes,)
    fields : sequence of Packed
    wanted : sequence of int
        Which of the fields to return, x, y and z first.
    declared : int
        The number of points that the header declares.

    Raises
    ------
    InputError
        The bytes have another size than points have, or contradict themselves. Where is not known,
        and any byte may be repeated in any that follow.
    """
    # Sizes in bytes, compressed and plain; bytes beyond the end of the file are 0.
    lengths = np.zeros(2, dtype="<u4")
    lengths.view(np.uint8)[: len(data[:8])] = data[:8]
    compressed, size = lengths.tolist()
    each = sum(field.size for field in fields)
    points = size // each if len(data) >= 8 and each and not size % each else declared
    if len(data) >= 8 and (size != each * points or points < declared):
        raise InputError(
            f"{path}: found {some(size, 'byte')} of compressed points, expected "
            f"{each * declared:,} for {some(declared, 'point')}"
        )
    starts = list(accumulate((field.size * points for field in fields), initial=0))
    packed = np.ascontiguousarray(data[8 : 8 + compressed])
    plain, used = decompress(packed, size)
    if len(data) >= 8 + compressed and (len(plain) < size or used < compressed):
        raise InputError(
            f"{path}: the compressed points are damaged: {used:,} of {compressed:,} bytes yield "
            f"{len(plain):,} of {size:,}, so that no point can be trusted"
        )
    end = max(starts[place + 1] for place in wanted)
    encoded = repeats_as_encoded(packed[:used], plain, end)
    if encoded.value is None:
        raise InputError(
            f"{path}: the compressed points are damaged: {encoded.refusal}, so that no point can "
            "be trusted"
        )
    losses = []
    if encoded.note:
        losses.append(f"{path}: is damaged behind the coordinates: {encoded.note}")
    parts = [plain[starts[place] : starts[place + 1]] for place in wanted]
    sizes = [fields[place].size for place in wanted]
    whole = min(len(part) // step for part, step in zip(parts, sizes, strict=True))
    columns = [
        part[: whole * fields[place].size].view(fields[place].dtype)
        for place, part in zip(wanted, parts, strict=True)
    ]
    begins = [starts[place] for place in wanted]
    kept, told = _plausible(columns, packed, len(plain), begins)
    return Unpacked(columns, kept, losses + [f"{path}: {line}" for line in told])


def _plausible(
    columns: Sequence[Array], packed: UInt8, size: int, begins: Sequence[int]
) -> tuple[Bool, list[str]]:
    """Return which points are not damaged, and what is said of the others.

    Parameters
    ----------
    columns : sequence of arrays (N,)
        x, y and z first.
    packed : uint8 (bytes,)
        The compressed bytes.
    size : int
        How many bytes these yield.
    begins : sequence of int
        Offset of each column in them.
    """
    count = len(columns[0])
    odd = odd_exponents(columns[:3])
    if odd is None:
        return np.ones(count, dtype=np.bool_), []
    source = origins(packed, size)
    steps = [column.itemsize for column in columns]
    rows, axes = np.nonzero(odd)
    wrong = source[np.array(begins)[axes] + (rows + 1) * np.array(steps)[axes] - 1]
    damaged = np.zeros(count, dtype=np.bool_)
    # What repeats a wrong byte is wrong as well.
    for begin, step in zip(begins, steps, strict=True):
        bytes_ = source[begin : begin + count * step].reshape(count, step)
        damaged |= np.isin(bytes_, wrong).any(axis=1)
    lost = int(damaged.sum())
    return ~damaged, [
        f"{lost:,} of {some(count, 'point')} {are(lost)} damaged, {len(rows):,} by coordinates of "
        "another order of magnitude than all others, and left out"
    ]
