"""Recorded clouds give one map in batches of any size and in tiles of any size.

How one could cheat: clouds in which the stages do nothing; a comparison that finds nothing, ever.
The whole clouds are compared by benchmarks/equality.py; here are parts that are large enough for
every stage.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.equality import RECORDED, SIZES, TILES, differ, part, rows
from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.walls import Walls

POINTS = 1200


def closing_more(parameters: Parameters) -> Parameters:
    """Return parameters with which gaps are closed whatever their ends are like."""
    stages = []
    for stage in parameters.pipeline:
        if isinstance(stage, Walls):
            stage = replace(stage, along=0, support=0)
        elif isinstance(stage, Plaster):
            stage = replace(stage, support=0, over_lower=True)
        stages.append(stage)
    return replace(parameters, pipeline=tuple(stages))


@pytest.mark.parametrize("name", RECORDED)
def test_a_part_of_a_recorded_cloud_gives_one_map(shared_data: Path, name: str) -> None:
    # In so few points no wide gap has evidence; without it, artificial patches are compared, too.
    parameters = closing_more(RECORDED[name].parameters)
    xyz = part(RECORDED[name].points(shared_data), POINTS)
    assert len(xyz) == POINTS
    builder = MapBuilder(parameters)
    builder.add(Keyframe(xyz))
    surface = builder.finish()
    assert (np.bincount(surface.origin) > 5).tolist() == [True] * 3
    assert np.count_nonzero(surface.depth > 0) >= 5
    assert surface.meta["points"]["dropped"]["median"] > 0
    compared = list(rows(xyz, parameters, looks=5))
    assert len(compared) == 2 * (len(SIZES) + 1) + len(TILES) + 1
    assert [row for row in compared if row.differing] == []
    assert {row.patches for row in compared} == {surface.size}
    pieces = [row.pieces for row in compared]
    assert pieces[0] == POINTS / 20
    assert pieces[len(SIZES)] == pieces[-1] == 1
    # Tiles of one cell: one for each cell that a point lies in.
    cells = np.floor(xyz[:, :2] / surface.cell_size)
    assert pieces[-1 - len(TILES)] == len(np.unique(cells, axis=0))


def test_a_patch_that_differs_is_counted_on_both_sides() -> None:
    maps = []
    for height in (0.0, 1e-12):
        builder = MapBuilder(load("plain", ["map.cell_size=0.5"]))
        builder.add(Keyframe(np.array([[0.1, 0.1, 0.0], [5.1, 0.1, height]])))
        maps.append(builder.finish())
    assert differ(*maps) == 2
    assert differ(maps[0], maps[0]) == 0
