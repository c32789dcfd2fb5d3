"""Read rows of decimal numbers, rounded to the nearest float64, or say that one is not so simple.

A number of up to 19 digits is a whole number times a power of ten. Both are exact in float64 where
the whole number has at most 53 bits and the power is at most 22; then their product or quotient is
rounded once, and right (W. Clinger, How to read floating point numbers accurately, 1990,
https://doi.org/10.1145/93542.93557). What the whole number has beyond 53 bits is added, with the
remainder of the first step (T. Dekker, A floating-point technique for extending the available
precision, 1971, https://doi.org/10.1007/BF01397083), and the sum is certain unless the number lies
all but halfway between two others.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Float64, Int64, UInt8
from mlscli.runtime.kernels import inner, kernel

_TAB, _NEWLINE, _RETURN, _BLANK = 9, 10, 13, 32
_PLUS, _MINUS, _POINT, _ZERO = 43, 45, 46, 48
_LOWER, _E, _N, _A = 32, 101, 110, 97

_MOST_DIGITS = 19
_POWERS = np.array([float(10**power) for power in range(23)])
_FARTHEST_POWER = np.uint64(10_000)
# Splits a float64 into two of half as many bits.
_SPLITTER = 2.0**27 + 1
# The correction of a quotient or product is known to a small part of itself; this is more.
_DOUBT = 2.0**-40


@kernel
def read_rows(data: UInt8, separator: int, columns: Int64, values: Float64) -> int:
    """Read rows that all have as many fields; return how many, or -1 where something is not simple.

    Parameters
    ----------
    data : uint8 (bytes,)
        Whole lines of ASCII, which end with a newline: all that is read stops there.
    separator : int
        The character between fields; 0: blanks and tabs.
    columns : int64 (width,)
        Which column of `values` takes each field; -1: none.
    values : float64 (N, columns)
        Takes the numbers, of N rows at most.
    """
    at = rows = 0
    while at < len(data):
        if rows == len(values):
            return -1
        for field in range(len(columns)):
            if field and separator:
                if data[at] != separator:
                    return -1
                at += 1
            at = _after_blanks(data, at, separator)
            if columns[field] >= 0:
                values[rows, columns[field]], at = _number(data, at)
            else:
                at = _after_field(data, at, separator)
            if at < 0 or (data[at] > _BLANK and data[at] != separator):
                return -1
            at = _after_blanks(data, at, separator)
        at += data[at] == _RETURN
        if data[at] != _NEWLINE:
            return -1
        at += 1
        rows += 1
    return rows


@inner
def _after_blanks(data: UInt8, at: int, separator: int) -> int:
    while (data[at] == _BLANK or data[at] == _TAB) and data[at] != separator:
        at += 1
    return at


@inner
def _after_field(data: UInt8, at: int, separator: int) -> int:
    """Return where a field ends that is no number; -1 where none is there."""
    begin = at
    while data[at] != separator and data[at] != _NEWLINE:
        if data[at] == _RETURN or (not separator and data[at] <= _BLANK):
            break
        at += 1
    return at if separator or at > begin else -1


@inner
def _number(data: UInt8, at: int) -> tuple[float, int]:
    """Return the number that begins somewhere, and where it ends; -1: it is not so simple."""
    if data[at] | _LOWER == _N:
        is_nan = data[at + 1] | _LOWER == _A and data[at + 2] | _LOWER == _N
        return np.nan, at + 3 if is_nan else -1
    sign = -1.0 if data[at] == _MINUS else 1.0
    at += data[at] == _MINUS or data[at] == _PLUS
    begin = at
    whole, at = _digits(data, at, np.uint64(0))
    digits, power = at - begin, 0
    if data[at] == _POINT:
        whole, end = _digits(data, at + 1, whole)
        digits, power, at = end - begin - 1, at + 1 - end, end
    if not digits:
        return np.nan, -1
    if digits > _MOST_DIGITS:
        # Those that count begin with the first that is no zero.
        while data[begin] == _ZERO or data[begin] == _POINT:
            digits -= data[begin] == _ZERO
            begin += 1
    if digits > _MOST_DIGITS:
        return np.nan, -1
    if data[at] | _LOWER == _E:
        sign_of_power = -1 if data[at + 1] == _MINUS else 1
        begin = at + 2 if data[at + 1] == _MINUS or data[at + 1] == _PLUS else at + 1
        exponent, at = _digits(data, begin, np.uint64(0))
        if not 0 < at - begin <= _MOST_DIGITS:
            return np.nan, -1
        power += sign_of_power * int(min(exponent, _FARTHEST_POWER))
    if not whole:
        return sign * 0.0, at
    value, is_known = _scaled(whole, power)
    return sign * value, at if is_known else -1


@inner
def _digits(data: UInt8, at: int, whole: np.uint64) -> tuple[np.uint64, int]:
    """Return a whole number with the digits that follow appended, and where they end."""
    while True:
        digit = np.uint64(data[at]) - np.uint64(_ZERO)
        if digit > np.uint64(9):
            return whole, at
        whole = whole * np.uint64(10) + digit
        at += 1


@inner
def _scaled(whole: np.uint64, power: int) -> tuple[float, bool]:
    """Return a whole number above 0 times a power of ten, and whether it is known."""
    most = float(whole)
    if power == 0:
        return most, True
    if abs(power) >= len(_POWERS):
        return np.nan, False
    scale = _POWERS[abs(power)]
    value = most * scale if power > 0 else most / scale
    rest = float(np.int64(whole - np.uint64(most)))
    if rest == 0.0:
        return value, True
    if power > 0:
        beyond = _beyond(most, scale, value) + rest * scale
    else:
        product = value * scale
        beyond = ((most - product) - _beyond(value, scale, product) + rest) / scale
    low, high = value + beyond * (1 - _DOUBT), value + beyond * (1 + _DOUBT)
    return low, low == high


@inner
def _beyond(one: float, other: float, product: float) -> float:
    """Return by how much a product exceeds what it was rounded to."""
    large = _SPLITTER * one - (_SPLITTER * one - one)
    other_large = _SPLITTER * other - (_SPLITTER * other - other)
    small, other_small = one - large, other - other_large
    crossed = large * other_large - product + large * other_small + small * other_large
    return crossed + small * other_small
