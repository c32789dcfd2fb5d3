"""`cell_size: auto` of clouds on disk, against the same of all points at once.

How one could cheat: to ask a sample only, so points that come first are unlike the others; to hold
all in one tile, so tiles are small and are counted; to forget what lies beyond a margin, so points
lie farther apart than the first margin is wide.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.cell_size import auto_cell_size
from mlscli.errors import InputError, UsageError
from mlscli.pipeline import large_cell_size, memory
from mlscli.scratch import Scratch
from mlscli.typing import Float64

Told = list[tuple[str, int, int | None]]


def on_disk(
    clouds: Iterable[Float64], held: int = 50, tile: int = 40, shift: int = 4, reach: int = 8
) -> tuple[float, Told]:
    """Return the size found with so many points in memory and in a tile, and the progress told."""
    told: Told = []
    with pytest.MonkeyPatch.context() as patch, Scratch() as disk:
        room = memory.Memory(2**40)
        patch.setattr(memory, "SORTED", room.room // (2 * held))
        patch.setattr(memory, "COMFORTABLE", tile)
        patch.setattr(large_cell_size, "SAMPLE", held)
        patch.setattr(large_cell_size, "SHIFT", shift)
        patch.setattr(large_cell_size, "REACH", reach)
        blocks = large_cell_size.put_in_blocks(clouds, room, disk)
        size = large_cell_size.large_cell_size(
            blocks, room, disk, lambda *so_far: told.append(so_far)
        )
    return size, told


@st.composite
def clouds(draw: st.DrawFn) -> Float64:
    """Return clusters of a spacing of their own, also in columns, far away, or in one place."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = []
    for _ in range(draw(st.integers(1, 4))):
        number, spread = draw(st.integers(1, 120)), 10.0 ** draw(st.integers(-6, 6))
        shape = draw(st.sampled_from([(1, 1, 1), (1, 1, 0), (0, 0, 1), (1, 0, 0), (0, 0, 0)]))
        place = draw(st.sampled_from([0.0, 1.0, -1e3, 9e7])) * rng.uniform(-1, 1, 3)
        part = place + spread * rng.normal(size=(number, 3)) * shape
        parts.append(np.clip(part, -1e8, 1e8))
    return np.concatenate(parts)


@given(
    clouds(),
    st.integers(1, 5),
    st.integers(1, 200),
    st.integers(1, 200),
    st.integers(0, 4),
    st.integers(2, 8),
)
def test_it_is_that_of_all_points_at_once(
    cloud: Float64, pieces: int, held: int, tile: int, shift: int, reach: int
) -> None:
    def found(all_at_once: bool) -> float | str:
        try:
            if all_at_once:
                return auto_cell_size(cloud)
            return on_disk(np.array_split(cloud, pieces), held, tile, shift, reach)[0]
        except InputError as error:
            return str(error)

    assert found(all_at_once=False) == found(all_at_once=True)


def test_a_plain_takes_one_pass_over_many_tiles() -> None:
    plain = np.random.default_rng(1).uniform(0, 400, (40_000, 3)) * (1, 1, 0)
    size, told = on_disk(np.array_split(plain, 20), held=5000, tile=5000, shift=2)
    assert size == auto_cell_size(plain)
    assert len(told) > 10
    assert told[-1] == ("cell size", 40_000, 40_000)
    done = [so_far for _, so_far, _ in told]
    assert done == sorted(set(done))


def test_points_farther_apart_than_the_first_ones_are_looked_for_farther() -> None:
    rng = np.random.default_rng(2)
    dense, thin = rng.uniform(0, 1, (100, 3)), rng.uniform(0, 1e4, (900, 3)) * (1, 1, 0)
    size, told = on_disk([dense, thin], held=100, tile=100)
    assert size == auto_cell_size(np.concatenate((dense, thin)))
    assert size > large_cell_size.REACH * auto_cell_size(dense)
    assert [done for _, done, _ in told].count(1000) > 1


@pytest.mark.parametrize("share", [0.9, 1.1, 1.3])
def test_a_neighbour_beyond_the_margin_is_nearer_than_one_in_its_corner(share: float) -> None:
    rng = np.random.default_rng(4)
    dense = rng.uniform(0, 1, (100, 3))
    margin = large_cell_size.REACH * auto_cell_size(dense)
    thin = rng.uniform(0, 1, (2000, 3)) * (1, 1, 0)
    # The median distance on this plain is that share of the margin.
    thin *= share * margin / (auto_cell_size(thin) / 2)
    size, _ = on_disk([dense, thin], held=100, tile=1)
    assert size == auto_cell_size(np.concatenate((dense, thin)))


def test_a_cloud_without_points_is_refused_as_ever() -> None:
    with pytest.raises(InputError, match="more than 4 points, and there are 0"):
        on_disk([])


def test_a_crowd_that_memory_cannot_hold_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large_cell_size, "FOUND", 2**38)
    with pytest.raises(UsageError, match=r"surroundings hold [\d,]+ points; give at least \d+M"):
        on_disk([np.random.default_rng(3).uniform(0, 1, (50, 3))])
