"""Points ordered by cell and height.

How one could cheat: cells that few bits can tell, heights that all differ, none far out.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.pipeline.stages.ordering import cells_of, order_by_cell
from mlscli.runtime.arrays import Array, Float64

LEAST, GREATEST = -(2**31), 2**31 - 1


def ordered(ix: Array, iy: Array, z: Float64) -> None:
    ix, iy = ix.astype(np.int32), iy.astype(np.int32)
    result = order_by_cell(ix, iy, z)
    order = result.order.astype(np.int64)
    assert sorted(order.tolist()) == list(range(len(z)))
    rows = list(zip(ix[order].tolist(), iy[order].tolist(), z[order].tolist(), strict=True))
    assert rows == sorted(zip(ix.tolist(), iy.tolist(), z.tolist(), strict=True))
    assert result.z.tolist() == z[order].tolist()
    cells = [row[:2] for row in rows]
    begins = [i for i in range(len(rows)) if i == 0 or cells[i] != cells[i - 1]]
    assert result.cells.start.tolist() == [*begins, len(rows)]
    assert list(zip(*(axis.tolist() for axis in result.cells[:2]), strict=True)) == [
        cells[i] for i in begins
    ]


@pytest.mark.parametrize("size", [1, 2, 100, 20_000])
@pytest.mark.parametrize("wide", [1, 5, 300, 10**6, 2**31 - 1])
def test_points_come_by_cell_and_by_height(size: int, wide: int) -> None:
    rng = np.random.default_rng(size)
    ix, iy = rng.integers(-wide, wide, (2, size))
    ordered(ix, iy, rng.normal(0, 1, size))
    # Many equal heights.
    ordered(ix, iy, rng.integers(-3, 3, size) / 2)


def test_no_point_has_an_order_too() -> None:
    none = np.empty(0, dtype=np.int32)
    result = order_by_cell(none, none, np.empty(0))
    assert (len(result.order), result.cells.start.tolist(), len(result.z)) == (0, [0], 0)


def test_the_whole_grid_is_ordered() -> None:
    ix = np.array([GREATEST, LEAST, 0, LEAST, -1, GREATEST])
    iy = np.array([GREATEST, GREATEST, 0, LEAST, -1, LEAST])
    ordered(ix, iy, np.zeros(6))


@pytest.mark.parametrize("farthest", [1e6, 1e300, 1.7e308, 5e-324])
def test_a_height_far_out_disturbs_no_order(farthest: float) -> None:
    rng = np.random.default_rng(2)
    z = rng.normal(0, 1, 5000)
    z[7], z[8] = farthest, -farthest
    ordered(rng.integers(0, 3, 5000), rng.integers(0, 3, 5000), z)
    # Those that are all as far out as each other are equal but for these.
    z[:] = 0.0
    z[7], z[8] = farthest, -farthest
    ordered(rng.integers(0, 3, 5000), rng.integers(0, 3, 5000), z)


def test_cells_are_floors_of_quotients() -> None:
    xyz = np.array([[-0.1, 0.0, 9.0], [0.3, 0.29999, 9.0], [-1e8, 1e8, 9.0]])
    ix, iy = cells_of(xyz, 0.1)
    assert ix.tolist() == [-1, int(np.floor(0.3 / 0.1)), int(np.floor(-1e8 / 0.1))]
    assert iy.tolist() == [0, 2, int(np.floor(1e8 / 0.1))]
