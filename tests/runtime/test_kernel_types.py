"""Types of kernels' arguments as text: what is written is read again, what is wrong is refused.

How one could cheat: to lose what makes another type of it, so arrays that may not be written to,
that lie otherwise in memory, records and the fields of named tuples are tried.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest

from mlscli.maps.order import OccupiedCells
from mlscli.maps.records import PATCH
from mlscli.runtime import kernel_types
from mlscli.runtime.kernel_types import read, written

typeof: Any = numba.typeof
KERNEL = "mlscli.maps.cells.unpack"


def frozen(array: Any) -> Any:
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1, "int64"),
        (1.5, "float64"),
        (True, "bool"),
        (np.uint32(1), "uint32"),
        (np.zeros((2, 2)), "float64[:, :]"),
        (frozen(np.zeros(2, np.uint8)), "readonly(uint8[:])"),
        (np.zeros(2, bool), "bool[:]"),
        (np.zeros(2, PATCH), "mlscli.maps.records.PATCH[:]"),
        ((1, 2.0), "(int64, float64,)"),
        ((1, 2), "(int64, int64,)"),
        (
            OccupiedCells(np.zeros(1, np.int32), np.zeros(1, np.int32), np.zeros(1, np.int64)),
            "mlscli.maps.order.OccupiedCells(ix=int32[:], iy=int32[:], start=int64[:])",
        ),
    ],
)
def test_what_is_written_is_read_again(value: Any, text: str) -> None:
    kind = typeof(value)
    assert written(kind) == text
    kernel, (again, number) = read(f"{KERNEL}({text}, int64)")
    assert (again, number) == (kind, numba.types.int64)
    assert kernel.__name__ == "unpack"


def test_arrays_that_kernels_should_not_get_have_no_text_that_is_read() -> None:
    with pytest.raises(ValueError, match="no type"):
        read(f"{KERNEL}({written(typeof(np.zeros((4, 4))[:, 1]))})")


@pytest.mark.parametrize(
    "line",
    [
        KERNEL,
        "mlscli.maps.cells.nothing(int64)",
        "mlscli.nowhere.unpack(int64)",
        "unpack(int64)",
        f"{KERNEL}(integer)",
        f"{KERNEL}(mlscli.maps.order.OccupiedCells(iy=int32[:], ix=int32[:], start=int64[:]))",
    ],
)
def test_a_line_of_no_kernel_or_no_types_is_refused(line: str) -> None:
    with pytest.raises(ValueError, match=r"kernel|there is no|no type|fields"):
        read(line)


def test_a_record_is_found_beside_dtypes_that_numba_does_not_know(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # By name, it is looked at first.
    module = ModuleType("mlscli.aaa")
    module.__dict__["ODD"] = np.dtype([("bytes", "V24")])
    monkeypatch.setitem(sys.modules, module.__name__, module)
    kernel_types._name_of.cache_clear()
    assert written(typeof(np.empty(2, PATCH))).endswith("mlscli.maps.records.PATCH[:]")
