"""Where packed points lie, whatever their message states.

How these tests could be cheated: by taking the data for whole whatever is stated, or by going by
one header that is wrong in one way. So clouds are packed by `struct` with gaps between points and
rows, every statement is made wrong as some driver makes it, and what cannot be told is refused.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.layouts import Layout, layout_of, offsets_of
from mlscli.runtime.arrays import UInt8

STEP, FIELDS_END = 16, 12


def rows(height: int, width: int, gap: int = 0) -> UInt8:
    """Return rows of points whose first byte is their number, from 1."""
    data = np.zeros((height, width * STEP + gap), dtype=np.uint8)
    data[:, : width * STEP : STEP] = np.arange(1, height * width + 1).reshape(height, width)
    return data.ravel()


def numbers(data: UInt8, layout: Layout) -> list[int]:
    shape, strides = layout[:2], layout[2:]
    assert (layout.height - 1) * layout.row_step + layout.width * layout.point_step <= len(data)
    return np.ndarray(shape, np.uint8, data, 0, strides).ravel().tolist()


@pytest.mark.parametrize(
    ("data", "stated"),
    [
        (rows(1, 6), Layout(1, 6, 96, STEP)),
        (rows(1, 6), Layout(1, 6, 0, STEP)),
        (rows(1, 6, gap=2 * STEP), Layout(1, 6, 128, STEP)),
        (rows(1, 6, gap=5), Layout(1, 6, 101, STEP)),
        (rows(2, 3), Layout(2, 3, 48, STEP)),
        (rows(2, 3, gap=5), Layout(2, 3, 53, STEP)),
        (rows(2, 3, gap=5)[:-5], Layout(2, 3, 53, STEP)),
    ],
)
def test_what_is_stated_is_taken_without_a_note_where_it_is_right(
    data: UInt8, stated: Layout
) -> None:
    found = layout_of(data, stated, FIELDS_END)

    assert found.value is not None
    assert numbers(data, found.value) == [1, 2, 3, 4, 5, 6]
    assert not found.note


@pytest.mark.parametrize(
    ("data", "stated", "words"),
    [
        # Before its width was known; of the whole cloud; of another cloud; counted in points.
        *((rows(2, 3), Layout(2, 3, step, STEP), "row_step") for step in (0, 96, 32, 3, 2**32 - 1)),
        (rows(1, 6), Layout(1, 6, 3, STEP), ""),
        (rows(1, 6), Layout(1, 3, 96, STEP), "declare fewer points"),
        (rows(1, 6), Layout(1, 5, 96, STEP), "declare fewer points"),
        (rows(1, 6), Layout(0, 6, 96, STEP), "height is 0"),
        (rows(1, 6), Layout(0, 6, 0, STEP), "height is 0"),
        (rows(1, 6), Layout(1, 0, 0, STEP), "width or height is 0"),
        (rows(1, 6), Layout(0, 0, 0, STEP), "width or height is 0"),
        (rows(1, 6), Layout(1, 6, 96, 0), "point_step is 0"),
        (rows(2, 3), Layout(2, 3, 48, 0), "point_step is 0"),
        (rows(1, 6), Layout(1, 4, 64, STEP), "fewer points"),
        (rows(3, 2), Layout(2, 2, 32, STEP), "fewer points"),
        (rows(3, 2, gap=8), Layout(2, 2, 40, STEP), "fewer rows"),
        (np.append(rows(2, 3), np.zeros(96, np.uint8)), Layout(2, 3, 96, STEP), "row_step contra"),
    ],
)
def test_the_data_counts_where_it_is_whole_and_what_is_stated_is_not(
    data: UInt8, stated: Layout, words: str
) -> None:
    found = layout_of(data, stated, FIELDS_END)

    assert found.value is not None
    assert numbers(data, found.value) == [1, 2, 3, 4, 5, 6]
    assert words in found.note
    assert bool(found.note) == bool(words)


def test_zeros_behind_the_points_are_room_that_was_not_used() -> None:
    data = np.concatenate([rows(1, 6), np.zeros(4 * STEP, np.uint8)])
    found = layout_of(data, Layout(1, 6, 96, STEP), FIELDS_END)

    assert found.value is not None
    assert numbers(data, found.value) == [1, 2, 3, 4, 5, 6]
    assert "zeros" in found.note


def test_wide_gaps_between_rows_are_gaps_though_the_rows_behind_are_zeros() -> None:
    data = rows(2, 3, gap=100)
    data[len(data) // 2 :] = 0
    found = layout_of(data, Layout(2, 3, 148, STEP), FIELDS_END)

    assert found.value == Layout(2, 3, 148, STEP)
    assert not found.note


@pytest.mark.parametrize("length", [0, 3, STEP - 1])
def test_no_points_and_no_room_for_one_are_an_empty_cloud(length: int) -> None:
    found = layout_of(np.ones(length, np.uint8), Layout(0, 0, 0, STEP), FIELDS_END)

    assert found.value is not None
    assert found.value[:2] == (0, 0)
    assert not found.note


@pytest.mark.parametrize(
    "stated",
    [
        Layout(1, 7, 112, STEP),
        Layout(2, 4, 0, STEP),
        Layout(0, 0, 0, 7),
        Layout(0, 0, 0, 0),
        Layout(1, 8, 0, 0),
        Layout(2**32 - 1, 2**32 - 1, 2**32 - 1, 2**32 - 1),
        Layout(2**32 - 1, 2**32 - 1, 0, 0),
    ],
)
def test_what_fits_nothing_is_refused_and_what_was_found_differs_from_what_was_expected(
    stated: Layout,
) -> None:
    found = layout_of(rows(1, 6)[:-1], stated, FIELDS_END)

    assert found.value is None
    assert found.refusal.startswith("95 bytes of data, expected ")
    assert not found.refusal.startswith("95 bytes of data, expected 95 ")
    with pytest.raises(KeyError, match="95 bytes"):
        found.accepted(KeyError)


@pytest.mark.parametrize(
    ("stated", "sizes", "step", "offsets", "words"),
    [
        # The number of the field times its own size, as a converter computed it.
        ([0, 4, 8, 12], [1, 4, 4, 4], 13, [0, 1, 5, 9], "have no gaps"),
        ([0, 4, 8, 12, 32], [1, 4, 4, 4, 8], 21, [0, 1, 5, 9, 13], "have no gaps"),
        # Room that no field fills, and a field of unknown size, may be anywhere.
        ([0, 4, 8, 32], [4, 4, 4, 8], 24, [0, 4, 8, 32], "read where they are stated"),
        ([0, 4, 8, 32], [4, 4, 4, 0], 12, [0, 4, 8, 32], "read where they are stated"),
    ],
)
def test_fields_beyond_their_point_follow_one_another_where_that_fills_it(
    stated: list[int], sizes: list[int], step: int, offsets: list[int], words: str
) -> None:
    found = offsets_of(stated, sizes, step)

    assert found.value == offsets
    assert words in found.note
