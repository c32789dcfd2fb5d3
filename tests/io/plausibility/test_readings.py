"""Which way to read coordinates is right.

How these tests could be cheated: by always taking little-endian, by a rule that fits round numbers
only, or one that never lets itself be convinced. So scenes are of many sizes and roundnesses,
little-endian and big-endian, with either flag; what cannot be told must not be.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mlscli.io.plausibility.readings import likelier, looks_right, sample
from mlscli.runtime.arrays import Bool, Float64

Scene = Callable[[np.random.Generator, Float64, Float64], Float64]


def _with(scene: Float64, rows: Bool, value: float) -> Float64:
    scene[rows] = value
    return scene


SCENES: dict[str, Scene] = {
    "a floor and a ceiling": lambda g, a, b: np.c_[a, b, g.integers(2, size=len(a)) * 3 + a / 99],
    "quarters": lambda _, a, b: np.c_[np.round(4 * a), np.round(4 * b), np.round(a)] / 4,
    "whole numbers": lambda _, a, b: np.c_[np.round(a), np.round(b), a * 0 + 1],
    "a plane at 0": lambda _, a, b: np.c_[a, b, a * 0],
    "a plane at nearly 0": lambda g, a, b: np.c_[a, b, 1e-9 * g.normal(size=len(a))],
    "UTM": lambda _, a, b: np.c_[a + 4.5e5, b + 5.2e6, a / 9 + 100],
    "a small scale": lambda _, a, b: np.c_[a, b, a + b] / 2000,
    "mostly NaN": lambda g, a, b: _with(np.c_[a, b, a / 3], g.random(len(a)) < 0.6, np.nan),
    "mostly no return": lambda g, a, b: _with(np.c_[a, b, a / 3], g.random(len(a)) < 0.7, 0.0),
    "some infinite": lambda g, a, b: _with(np.c_[a, b, a / 3], g.random(len(a)) < 0.3, np.inf),
}


def drawn(scene: str, count: int, dtype: str) -> tuple[Float64, Float64]:
    """Return points of a scene, and the same bytes in the other order."""
    generator = np.random.default_rng(count)
    a, b = generator.uniform(-20, 20, (2, count))
    stored = SCENES[scene](generator, a, b).astype(dtype)
    with np.errstate(invalid="ignore"):
        swapped = stored.view(stored.dtype.newbyteorder()).astype(np.float64)
    return stored.astype(np.float64), swapped


def at_a_glance(points: Float64, dtype: str) -> bool:
    """Return whether points look right at a glance, as stored little-endian."""
    size = np.dtype(dtype).itemsize
    with np.errstate(over="ignore", invalid="ignore"):
        data = points.astype(f"<f{size}").view(np.uint8).ravel()
    tops = (size - 1, 2 * size - 1, 3 * size - 1)
    return looks_right(data, tops, 3 * size, len(points), size)


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8"])
@pytest.mark.parametrize("count", [8, 36, 300, 5000])
@pytest.mark.parametrize("scene", SCENES)
def test_the_right_byte_order_is_told_whichever_was_stated(
    scene: str, count: int, dtype: str
) -> None:
    right, wrong = drawn(scene, count, dtype)

    assert not at_a_glance(wrong, dtype)
    some = sample(right)
    assert likelier(right[some], [wrong[some]]) == -1
    some = sample(wrong)
    assert likelier(wrong[some], [right[some]]) == 0


@pytest.mark.parametrize("scene", [name for name in SCENES if "mostly" not in name])
def test_what_is_right_is_seen_at_a_glance(scene: str) -> None:
    for dtype in ("<f4", ">f8"):
        assert at_a_glance(drawn(scene, 300, dtype)[0], dtype)


@pytest.mark.parametrize("dtype", ["<i2", "<i4"])
def test_whole_numbers_are_told_by_their_neighbours(dtype: str) -> None:
    turns = np.linspace(0, 40, 4000)
    scan = np.c_[9000 * np.cos(turns), 9000 * np.sin(turns), 100 * turns].astype(dtype)
    right, wrong = (each.astype(float) for each in (scan, scan.view(scan.dtype.newbyteorder())))
    some = sample(right)

    assert likelier(right[some], [wrong[some]]) == -1
    assert likelier(wrong[some], [right[some]]) == 0


def test_what_cannot_be_told_is_not() -> None:
    generator = np.random.default_rng(1)
    noise = generator.integers(-30000, 30000, (500, 3)).astype("<i2")
    swapped = noise.view(">i2").astype(float)
    assert likelier(noise.astype(float), [swapped]) is None
    # Bytes that are no coordinates in either order.
    noise = generator.integers(0, 2**31, (500, 3)).astype("<i4").view("<f4")
    with np.errstate(invalid="ignore"):
        assert likelier(noise.astype(float), [noise.view(">f4").astype(float)]) is None
    # One number is not enough.
    one = np.array([[0.0, 0.5, 0.0]], dtype="<f4")
    assert likelier(one.astype(float), [one.view(">f4").astype(float)]) is None


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_where_nothing_was_measured_nothing_is_doubted(value: float) -> None:
    empty = np.full((50, 3), value, dtype="<f4")

    assert likelier(empty.astype(float), [empty.view(">f4").astype(float)]) == -1


def test_the_sample_is_small_and_finds_what_was_measured() -> None:
    points = np.zeros((100_000, 3))
    assert len(sample(points)) <= 256
    points[90_001:90_400] = 1
    assert (sample(points) >= 90_001).all()
    assert sample(points[:100]).tolist() == list(range(100))
