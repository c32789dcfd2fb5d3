"""Whether bytes that LZF compressed are still as an encoder wrote them: the format has no checksum.

Encoders are greedy and remember little: the last place of each hash of three bytes. So what they
write follows from the plain bytes, and a step that they would not have taken shows that a byte was
changed: one that says how far back and how much to repeat, or one that is repeated or could have
been. A changed byte that is like nothing else in the file goes unnoticed.

Encoders differ in the size of that memory, in the hash, and in how many of the repeated places
they remember. One of them fits a whole file. Where none does, the file is damaged if steps
contradict the best one here and there, or only in a part of the file; if they do all over it, an
unknown encoder wrote it, and nothing can be told.

References
----------
M. Lehmann, liblzf 3.6, lzf_c.c; what the Point Cloud Library made of it, io/src/lzf.cpp.
"""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, refused, right
from mlscli.runtime.arrays import Int32, UInt8
from mlscli.runtime.kernels import inner, kernel
from mlscli.words import are, some

_USUAL = ((13, 0, 1), (16, 0, 1), (16, 1, 2))
"""Bits of the hash, its kind, and how many of the repeated places are remembered: by the Point
Cloud Library, by its older versions, and by liblzf as Open3D and Python's lzf have it."""

_OTHERS = tuple(product((16, 15, 14, 13, 17, 18, 12), (0, 1, 2), (1, 2, 264)))
"""The same, of what liblzf can be set to."""

_FARTHEST, _LONGEST = 1 << 13, 264
"""How far back an encoder looks, and how much a step repeats, in bytes."""

_BEGINNING = 1 << 15
"""So many plain bytes tell most encoders apart."""

_HARDLY, _LARGE = 0.95, 1 << 20
"""Where so many bytes are compressed to more than this share, there is little to judge by."""

_FEW, _SOME, _BY_CHANCE = 0.02, 0.3, 1e-6
"""Contradictions in fewer than so many of the repetitions are damage; in some, if so long a part of
the file without any is that unlikely to come by chance."""


def repeats_as_encoded(data: UInt8, plain: UInt8, used: int) -> Finding[bool]:
    """Return whether compressed bytes are those that an encoder made of the plain ones.

    Parameters
    ----------
    data : uint8 (bytes,)
        Compressed.
    plain : uint8 (bytes,)
        What all of them yield.
    used : int
        How many of the first plain bytes matter.

    Returns
    -------
    Finding of bool
        False, with a note, where bytes behind those that matter are damaged; refused where others
        may be.
    """
    large = len(plain) > _LARGE and len(data) > _HARDLY * len(plain)
    if large or len(plain) >= 1 << 31:
        return right(True)
    best = _Judged(1 << 62, 0, 0, 0)
    # The beginning tells which of those in use to try first, as the first mostly fits.
    usual = sorted(_USUAL, key=lambda each: _judge(data, plain, each, best.odd, _BEGINNING).odd)
    for encoder in (*usual, *_OTHERS):
        judged = _judge(data, plain, encoder, best.odd, len(plain))
        if not judged.odd:
            return right(True)
        best = judged if judged.odd < best.odd else best
    share = best.odd / max(best.repetitions, 1)
    if share > _FEW and (share > _SOME or best.chance > _BY_CHANCE):
        return right(True)
    fault = (
        f"{best.odd:,} of {some(best.repetitions, 'repetition')} {are(best.odd)} not as an encoder "
        "writes them"
    )
    # A byte shows at the latest where it is repeated.
    return doubted(False, fault) if best.first >= used + _FARTHEST else refused(fault)


class _Judged(NamedTuple):
    """How steps agree with an encoder.

    Attributes
    ----------
    odd : int
        The number of steps that it would not have taken.
    repetitions : int
        The number of steps that repeat something.
    gap : int
        The longest run of these without an odd step.
    first : int
        Offset of the first odd step in the plain bytes.
    """

    odd: int
    repetitions: int
    gap: int
    first: int

    @property
    def chance(self) -> float:
        """How likely such a gap is where odd steps are everywhere."""
        share = self.gap / (self.repetitions + self.odd)
        return math.exp(min(0.0, math.log(self.odd + 1) + self.odd * math.log1p(-share)))


def _judge(
    data: UInt8, plain: UInt8, encoder: tuple[int, int, int], most: int, stop: int
) -> _Judged:
    """Compare the steps up to a plain byte with those of an encoder, until `most` contradict it."""
    bits, kind, kept = encoder
    last = np.zeros(1 << bits, dtype=np.int32)
    return _Judged(*_judged(data, plain, last, kind, kept, most, stop))


@kernel
def _judged(
    data: UInt8, plain: UInt8, last: Int32, kind: int, kept: int, most: int, stop: int
) -> tuple[int, int, int, int]:
    """Compare steps with those of an encoder, until `most` contradict it.

    Parameters
    ----------
    data, plain : uint8 (bytes,)
    last : int32 (2^bits,)
        The last place of each hash, at first 0.
    kind, kept : int
        The encoder; see `_USUAL`.
    most : int
    stop : int
        Offset in the plain bytes at which to stop.

    Returns
    -------
    odd, repetitions, gap, first : int
        See `_Judged`.
    """
    end = len(plain) - 2
    stop = min(stop, end)
    read = at = odd = repetitions = gap = first = since = 0
    while at < stop and read < len(data) and odd < most:
        control = int(data[read])
        read += 1
        fits = True
        begin = at
        if control < 32:
            read += control + 1
            at += control + 1
            for place in range(begin, min(at, end)):
                slot = _slot(_three(plain, place), len(last), kind)
                before = np.int64(last[slot])
                last[slot] = place
                if (
                    place - before <= _FARTHEST
                    and before > 0
                    and plain[before + 2] == plain[place + 2]
                    and plain[before + 1] == plain[place + 1]
                    and plain[before] == plain[place]
                ):
                    fits = False
        else:
            repetitions += 1
            length = (control >> 5) + 2
            if length == 9:
                length += int(data[read])
                read += 1
            source = begin - 1 - ((control & 31) << 8) - int(data[read])
            read += 1
            at += length
            slot = _slot(_three(plain, begin), len(last), kind)
            fits = last[slot] == source
            if length < _LONGEST and at < end and plain[source + length] == plain[at]:
                fits = False
            last[slot] = begin
            if at < end:
                for place in range(max(begin + 1, at - kept), at):
                    last[_slot(_three(plain, place), len(last), kind)] = place
        if not fits:
            first = first if odd else begin
            gap, since = max(gap, repetitions - since), repetitions
            odd += 1
    return odd, repetitions, max(gap, repetitions - since), first


@inner
def _three(plain: UInt8, at: int) -> int:
    """Return three bytes as a number."""
    # Numba looks whether an index counts from the end, unless it has no sign.
    first, second, third = plain[np.uint32(at)], plain[np.uint32(at + 1)], plain[np.uint32(at + 2)]
    return int(np.int64(first) << 16 | np.int64(second) << 8 | np.int64(third))


@inner
def _slot(three: int, slots: int, kind: int) -> np.uint32:
    """Return the hash of three bytes, below a number of slots that is a power of 2."""
    high = three ^ (three << 5) if kind == 2 else three
    return np.uint32(((high * slots >> 24) - three * (5 if kind else 1)) & (slots - 1))
