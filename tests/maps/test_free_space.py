"""Free space as a map keeps it: looked up, added, cropped, checked.

How one could cheat: lookups in a full block of voxels only; sums of counts that share no voxel, or
that never reach 255; faults that break several rules at once.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.maps.cells import Limits
from mlscli.maps.free_space import FreeSpace, voxels_at
from mlscli.maps.merging import merge_maps
from mlscli.maps.space import FREE, NEVER_SEEN, OCCUPIED, UNKNOWN, space_at
from tests.helpers.lines import Voxel, counts_of, free_space_of
from tests.helpers.maps import CELL, Patch, map_of, random_map


def some_counts(rng: np.random.Generator) -> dict[Voxel, int]:
    """Return counts of voxels, some of them at the ends of all indices."""
    low = int(rng.choice([-3, -3, -3, -(2**31), 2**31 - 6]))
    voxels = low + rng.integers(0, 6, (int(rng.integers(0, 60)), 3))
    lines = rng.choice([1, 2, 200, 255], len(voxels))
    return {(x, y, z): int(n) for (x, y, z), n in zip(voxels.tolist(), lines, strict=True)}


def test_voxels_are_found_by_their_indices_and_all_others_have_no_line() -> None:
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(60):
        counts = some_counts(rng)
        free = free_space_of(counts)
        free.check()
        assert counts_of(free) == counts
        asked = [*counts, *rng.integers(-3, 4, (40, 3)).tolist()]
        asked += [(2**31, 0, 0), (0, -(2**40), 0), (-(2**31) - 1, 2**31 - 1, 0), (0, 0, 2**32)]
        ix, iy, iz = np.array(asked, dtype=np.int64).T
        expected = [counts.get(tuple(voxel), 0) for voxel in asked]
        assert free.lines_through(ix, iy, iz).tolist() == expected
        hits += sum(n > 0 for n in expected[len(counts) :])
    assert hits > 10


def test_places_lie_in_the_voxel_above_and_beside_which_they_are() -> None:
    xyz = np.array([[0.0, 0.49, 0.24], [-0.01, 0.5, 0.25], [1e300, np.nan, -np.inf]])
    indices = np.column_stack(voxels_at(xyz, 0.5))
    assert indices[:2].tolist() == [[0, 0, 0], [-1, 1, 1]]
    assert (indices[2] == -(2**63)).all()
    free = free_space_of({(0, 0, 0): 3})
    assert free.lines_through(*voxels_at(xyz, 0.5)).tolist() == [3, 0, 0]


def test_the_union_has_the_counts_of_both() -> None:
    rng = np.random.default_rng(2)
    shared = full = 0
    for _ in range(100):
        one, other = some_counts(rng), some_counts(rng)
        both = {voxel: min(n, 255) for voxel, n in (Counter(one) + Counter(other)).items()}
        shared += len(one.keys() & other.keys())
        full += 255 in both.values()
        union = free_space_of(one).union(free_space_of(other))
        assert union == free_space_of(both)
        assert union == free_space_of(other).union(free_space_of(one))
    assert shared > 50
    assert full > 20


def test_maps_that_are_merged_add_their_counts_where_both_have_them() -> None:
    rng = np.random.default_rng(3)
    one, other = random_map(rng), random_map(rng)
    seen = [free_space_of({(0, 0, 0): 3, (0, 1, 0): 1}), free_space_of({(0, 0, 0): 4})]
    merged = merge_maps(replace(one, free=seen[0]), replace(other, free=seen[1]))
    assert merged.free is not None
    assert counts_of(merged.free) == {(0, 0, 0): 7, (0, 1, 0): 1}
    assert merge_maps(replace(one, free=seen[0]), other).free is None
    assert merge_maps(one, replace(other, free=seen[0])).free is None
    # Nothing was seen, which is known.
    none = replace(one, free=FreeSpace.of_none())
    assert merge_maps(none, none).free == FreeSpace.of_none()


def test_a_part_of_a_map_has_the_free_space_of_its_cells() -> None:
    rng = np.random.default_rng(4)
    for _ in range(30):
        counts = some_counts(rng)
        surface = replace(random_map(rng), free=free_space_of(counts))
        limits = Limits(-2, 1, None, 0)
        inside = {v: n for v, n in counts.items() if -2 <= v[0] <= 1 and v[1] <= 0}
        assert surface.crop(*limits).free == free_space_of(inside)
        # Patches that are chosen by anything else leave space as it is.
        assert surface.take(surface.depth > 0).free == surface.free


def test_maps_with_other_free_space_are_not_equal() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.0, 0, 3)])
    free = free_space_of({(0, 0, 0): 3})
    assert replace(surface, free=free) == replace(surface, free=free_space_of({(0, 0, 0): 3}))
    others = [
        None,
        FreeSpace.of_none(),
        free_space_of({(0, 0, 0): 2}),
        free_space_of({(0, 0, 1): 3}),
    ]
    for other in others:
        assert replace(surface, free=free) != replace(surface, free=other)


GOOD = {(0, 0, 1): 3, (0, 0, 2): 1, (0, 3, -5): 9, (1, -2, 7): 255}


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"ix": [0.0, 0, 1]}, "free_ix: has dtype float64; it must be int32"),
        ({"lines": [1, 1, 1]}, r"free_lines: has shape \(3,\); it must be \(4,\)"),
        ({"iy": [0]}, r"free_iy: has shape \(1,\); it must be \(3,\)"),
        ({"start": [0, 2, 4]}, r"free_start: has shape \(3,\); it must be \(4,\)"),
        ({"start": [0, 2, 2, 4]}, "free_start: must ascend from 0 to 4"),
        ({"start": [1, 2, 3, 4]}, "free_start: must ascend from 0 to 4"),
        ({"start": [0, 2, 3, 5]}, "free_start: must ascend from 0 to 4"),
        ({"start": [0, 2**62 + 1, -(2**63), 4]}, "free_start: must ascend from 0 to 4"),
        ({"ix": [0, 1, 0]}, "free_ix, free_iy: cells are not sorted"),
        ({"iy": [3, 3, -2]}, "free_ix, free_iy: cells are not sorted by .* each once"),
        ({"iz": [2, 1, -5, 7]}, "free_iz: does not ascend in each cell"),
        ({"iz": [1, 1, -5, 7]}, "free_iz: does not ascend in each cell"),
        ({"lines": [3, 0, 9, 255]}, "free_lines: holds 0; it must be 1 or more"),
    ],
)
def test_what_breaks_a_rule_is_named(changed: dict[str, list[Any]], fault: str) -> None:
    free = free_space_of(GOOD)
    free.check()
    ((name, values),) = changed.items()
    kept = free.columns[name].dtype
    column = np.array(values) if isinstance(values[0], float) else np.array(values, dtype=kept)
    broken = replace(free, **{name: column})
    with pytest.raises(InputError, match=f"^{fault}"):
        broken.check()
    with pytest.raises(InputError, match=f"^{fault}"):
        replace(map_of([Patch(0, 0, 1.0, 0.0, 0, 3)]), free=broken).check()


def test_places_are_occupied_or_free_or_never_seen_or_unknown() -> None:
    # A floor at 0.1 and a wall from 1.0 to 1.6 in cell (0, 0); an inserted patch in (1, 0).
    patches = [
        Patch(0, 0, 0.1, 0.0, 0, 3),
        Patch(0, 0, 1.6, 0.6, 0, 3),
        Patch(1, 0, 0.6, 0.0, 2, 0),
    ]
    lines = {(0, 0, 0): 9, (0, 0, 1): 9, (0, 0, 2): 1, (0, 0, 5): 9, (1, 0, 2): 9, (1, 0, 3): 2}
    surface = replace(map_of(patches), free=free_space_of(lines))

    def space(ix: int, iz: int) -> int:
        place = np.array([[(ix + 0.5) * CELL, 0.1, (iz + 0.5) * CELL / 2]])
        return int(space_at(surface, place)[0])

    known = {iz: space(0, iz) for iz in range(-1, 8)}
    assert [iz for iz, what in known.items() if what == OCCUPIED] == [0, 4, 5, 6]
    # One line may be wrong.
    assert [iz for iz, what in known.items() if what == FREE] == [1]
    assert [space(1, iz) for iz in range(5)] == [
        *(NEVER_SEEN, NEVER_SEEN, OCCUPIED, FREE, NEVER_SEEN)
    ]
    places = np.array([[0.1, 0.1, 0.6], [np.nan, 0.1, 0.6], [1e300, 0.1, 0.6], [0.1, 0.1, np.inf]])
    assert space_at(surface, places).tolist() == [UNKNOWN, *[NEVER_SEEN] * 3]
    assert space_at(surface, places, least=1).tolist() == [FREE, *[NEVER_SEEN] * 3]
    with pytest.raises(UsageError, match="the map does not say what was seen through"):
        space_at(replace(surface, free=None), places)
