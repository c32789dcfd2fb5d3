"""Decimal numbers are read as Python reads them, to the bit, or it is said that they are not.

How one could cheat: call every number hard; be right but for the last bit; take for a number, or
for a row, what is none.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.io.clouds.decimals import read_rows
from mlscli.runtime.arrays import Float64


def rows_of(text: str, width: int, separator: str = "\0") -> Float64 | None:
    """Return all columns of rows; None where it is said that something is not simple."""
    values = np.empty((text.count("\n"), width))
    data = np.frombuffer(text.encode(), dtype=np.uint8)
    rows = read_rows(data, ord(separator), np.arange(width), values)
    return None if rows < 0 else values[:rows]


def bits(value: float) -> bytes:
    return struct.pack("<d", value)


digits = st.integers(0, 10**19 - 1).map(str)
written = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1e7, 1e7).map(lambda value: f"{value:.18e}"),
    st.tuples(st.floats(-1e9, 1e9), st.integers(0, 9)).map(lambda both: f"{both[0]:.{both[1]}f}"),
    st.tuples(st.sampled_from(["", "-", "+"]), digits, digits, st.integers(-40, 40)).map(
        lambda part: f"{part[0]}{part[1]}.{part[2]}e{part[3]}"
    ),
)


@given(written)
def test_a_number_is_that_of_python_or_not_told(word: str) -> None:
    found = rows_of(f"{word}\n", 1)
    assert found is None or bits(found[0, 0]) == bits(float(word))


@given(st.floats(1e-3, 1e9), st.sampled_from(["", "-"]))
def test_numbers_as_programs_write_coordinates_are_told(value: float, sign: str) -> None:
    for word in (repr(value), f"{value:.18e}", f"{value:.3f}", f"{value:.17g}"):
        found = rows_of(f"{sign}{word}\n", 1)
        assert found is not None
        assert bits(found[0, 0]) == bits(float(sign + word))


@pytest.mark.parametrize(
    "halfway",
    ["9007199254740993", "9007199254740993.0", "18014398509481986e-1", "9007199254740995"],
)
def test_numbers_halfway_between_two_others_are_rounded_to_the_even_one(halfway: str) -> None:
    found = rows_of(f"{halfway}\n", 1)
    assert found is None or found[0, 0] == float(halfway)


@pytest.mark.parametrize(
    "word",
    [
        *(".", "-", "", "+-1", "1_0", "0x10", "1e", "1e+", "1,5", "1.5.2", "na", "nab", "inf"),
        *("-nan", "1d5", "1 2", "1\r2", "\x00", "1\x0b", "12345678901234567890", "1e400", "\n1"),
    ],
)
def test_what_is_no_simple_number_is_not_told(word: str) -> None:
    assert rows_of(f"{word}\n", 1) is None


def test_signs_of_zeros_and_nan_are_kept() -> None:
    found = rows_of("-0 0\n-0.00 NaN\r\n +.5\t 5. \n", 2)
    assert found is not None
    np.testing.assert_array_equal(found, [[0, 0], [0, np.nan], [0.5, 5]])
    assert np.signbit(found[:2, 0]).all()
    assert not np.signbit(found[0, 1])


def test_fields_between_separators_may_hold_anything_where_no_number_is_wanted() -> None:
    text = "a b,1, 2.5 \n,3,-4e2\n"
    values = np.empty((2, 2))
    data = np.frombuffer(text.encode(), dtype=np.uint8)
    assert read_rows(data, ord(","), np.array([-1, 1, 0]), values) == 2
    np.testing.assert_array_equal(values, [[2.5, 1], [-400, 3]])


@pytest.mark.parametrize("text", ["1,2\n3\n", "1,2\n3,4,5\n", "1,\n", "1,2\n\n", "1;2\n"])
def test_rows_with_other_fields_are_not_told(text: str) -> None:
    assert rows_of(text, 2, ",") is None
    assert rows_of(text.replace(",", " "), 2) is None
