"""Where packed points lie in their bytes: what a message states of it, against the bytes there.

Sizes are unset, stale or wrong in what many drivers write, while the data is whole: a row_step of
0, of the whole cloud or of another one, a height or width of 0. Viewers that look only at the
number of points and their size show such clouds.

References
----------
sensor_msgs/PointCloud2: data holds height rows of row_step bytes, each with width points of
point_step bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

from mlscli.io.plausibility.finding import Finding, doubted, refused, right
from mlscli.runtime.arrays import UInt8

_FEWER = "width and height declare fewer points than there are; all are taken"
_JOINED = "row_step contradicts width and point_step; the rows follow one another without gaps"


class Layout(NamedTuple):
    """Where points lie in bytes.

    Attributes
    ----------
    height, width : int
        Number of rows, and of points in a row.
    row_step, point_step : int
        Bytes from row to row, and from point to point.
    """

    height: int
    width: int
    row_step: int
    point_step: int


def layout_of(data: UInt8, stated: Layout, fields_end: int) -> Finding[Layout]:
    """Return where the points of a cloud lie.

    Parameters
    ----------
    data : uint8 (bytes,)
    stated : Layout
        As the message states it.
    fields_end : int
        Number of bytes that the fields of a point span, for a cloud without `point_step`.

    Returns
    -------
    Finding of Layout
        It fits into `data`.
    """
    height, width, row_step, point_step = stated
    length, row = len(data), width * point_step
    if height and width:
        # A cloud of one row has no next row; many writers leave row_step unset there.
        apart = row_step if height > 1 else max(row, row_step)
        whole = height * apart
        # What stands behind the one row may be padding, unless it is whole points.
        more = height == 1 and row and length > row and not length % point_step
        if more and data[row:].any():
            return doubted(Layout(1, length // point_step, length, point_step), _FEWER)
        if height > 1 and _are_joined(data, height * row, row, apart):
            return doubted(Layout(1, height * width, height * row, point_step), _JOINED)
        if apart >= row and length in (whole, whole - apart + row) and (row or not length):
            return right(stated if apart == row_step else stated._replace(row_step=apart))
    elif length < max(point_step, 1):
        return right(Layout(0, 0, 0, point_step))
    points = height * width
    if not point_step:
        return _without_point_step(length, stated, fields_end)
    if points and length == points * point_step:
        return doubted(
            Layout(1, points, length, point_step),
            _JOINED,
        )
    if row_step > row > 0 and length > height * row_step and not length % row_step:
        return doubted(
            Layout(length // row_step, width, row_step, point_step),
            "height declares fewer rows than there are; all are taken",
        )
    there, rest = divmod(length, point_step)
    if rest or not there or there < points:
        return refused(_contradiction(length, stated))
    if points and not data[points * point_step :].any():
        return doubted(
            Layout(1, points, points * point_step, point_step),
            "there are zeros behind the points that width and height declare; they are left out",
        )
    return doubted(
        Layout(1, there, length, point_step),
        _FEWER if points else "width or height is 0, though there are points; all are taken",
    )


def offsets_of(stated: Sequence[int], sizes: Sequence[int], point_step: int) -> Finding[list[int]]:
    """Return where the fields of a point lie in it, if one of them is stated to lie beyond it.

    Parameters
    ----------
    stated : sequence of int
        The offset of each field in bytes, as the message states it.
    sizes : sequence of int
        How many bytes each field takes, in the same order; 0 where that is not known.
    point_step : int
        Bytes from point to point.

    Returns
    -------
    Finding of list of int
        One behind the other where that fills a point to the byte; else as stated.
    """
    if all(sizes) and sum(sizes) == point_step:
        packed = list(accumulate(sizes, initial=0))[:-1]
        return doubted(packed, "offsets of fields contradict point_step; the fields have no gaps")
    beyond = "offsets of fields contradict point_step; coordinates are read where they are stated"
    return doubted(list(stated), beyond)


def _are_joined(data: UInt8, points_end: int, row: int, row_step: int) -> bool:
    """Return whether rows lie in the gap behind the first one, with nothing but zeros behind them.

    So it is where row_step is that of the whole cloud, and data has as many times that.
    """
    if row_step < points_end:
        return False
    return bool(data[row:points_end].any()) and not data[points_end:].any()


def _without_point_step(length: int, stated: Layout, fields_end: int) -> Finding[Layout]:
    """Return the layout of points whose size is not stated: it follows from their number."""
    points = stated.height * stated.width
    size = length // points if points else fields_end
    if not size or size < fields_end or length % size:
        return refused(_contradiction(length, stated))
    return doubted(
        Layout(1, length // size, length, size),
        "point_step is 0; the size of a point follows from the data and the number of points",
    )


def _contradiction(length: int, stated: Layout) -> str:
    height, width, row_step, point_step = stated
    expected = max(height * width * point_step, height * row_step)
    return (
        f"{length:,} bytes of data, expected {expected:,} for width {width}, height {height}, "
        f"point_step {point_step} and row_step {row_step}"
    )
