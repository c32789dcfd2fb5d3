"""Arrays on disk are what they were, slice by slice.

How one could cheat: one array only, so that all begin at 0; a slice from the beginning only.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import OutputError
from mlscli.runtime.scratch import Scratch


def test_arrays_put_away_are_read_back_in_slices() -> None:
    arrays = [np.arange(10), np.array([], dtype=np.float64), np.ones(3, dtype=[("a", "<i4")])]
    with Scratch() as scratch:
        stored = [scratch.put(array) for array in arrays]
        for array, one in zip(arrays, stored, strict=True):
            assert one[0 : len(array)].tobytes() == array.tobytes()
        assert stored[0][3:7].tolist() == [3, 4, 5, 6]


def test_threads_do_not_read_each_others_arrays() -> None:
    arrays = [np.full(20_000, number) for number in range(8)]
    with Scratch() as scratch, ThreadPoolExecutor(8) as pool:
        stored = list(pool.map(scratch.put, arrays))
        for _ in range(20):
            back = pool.map(lambda one: one[1:20_000], stored)
            assert all((one == number).all() for number, one in enumerate(back))


def test_the_file_has_no_name(tmp_path: Path) -> None:
    with Scratch(tmp_path) as scratch:
        scratch.put(np.zeros(1000))
        assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"none: no room for temporary files: .*`scratch`"):
        Scratch(tmp_path / "none")


def test_what_is_lost_is_not_made_up(tmp_path: Path) -> None:
    with Scratch(tmp_path) as scratch:
        stored = scratch.put(np.arange(100))
        scratch._file.truncate(80)
        assert stored[0:10].tolist() == list(range(10))
        with pytest.raises(OutputError, match="lost its end"):
            stored[5:15]
