"""Parameters that contradict each other.

Ways to pass without being right: to compare lengths only where their units agree, or to compare
them before the size of a cell is known (the same lengths with cells of two sizes, and with none);
to let a craft of any size pass by checking nothing (what follows from it is computed here, and a
gap that the user sets is refused as before); to take lengths for equal that are not (a millionth of
a cell is told).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest

from mlscli.config import PRESETS, load, loads
from mlscli.errors import ConfigError
from mlscli.parameters.lengths import Cells, Length, in_units
from mlscli.pipeline.parameters import (
    BatchParameters,
    MapParameters,
    Parameters,
    Vehicle,
    conditional_faults,
)
from mlscli.pipeline.stages.gaps import GapStage
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from tests.helpers.faults import only_fault_of


def test_a_python_default_that_another_parameter_decides_takes_its_value() -> None:
    parameters = Parameters(map=MapParameters(gap_size=0.2), pipeline=(Pyramids(),))
    assert parameters.pipeline == (Pyramids(max_height=0.2),)
    explicit = (Pyramids(max_height=Cells(1)),)
    assert Parameters(pipeline=explicit).pipeline == explicit


def test_contradictions_that_need_the_cell_size_show_once_it_is_known() -> None:
    text = "pipeline: [plaster: {max_gap: 0.5, max_gap_enhanced: 2 cells}]"
    assert loads(text).with_cell_size(0.25).map.cell_size == 0.25
    with pytest.raises(ConfigError, match=r"^plaster\.max_gap_enhanced: 2 cells"):
        loads(text).with_cell_size(0.2)
    assert "p.yaml:1:54: plaster.max_gap_enhanced" in only_fault_of(text, ("map.cell_size=0.2",))


def test_lengths_in_cells_are_compared_whatever_the_size_of_a_cell() -> None:
    text = "vehicle: {height: 4 cells}\npipeline: [pyramids: {max_height: 5 cells}]"
    assert only_fault_of(text).startswith("p.yaml:2:35: pyramids.max_height: 5 cells")
    assert loads(text, sets=["vehicle.height=5 cells"]).vehicle.height == Cells(5)


@pytest.mark.parametrize("cell_size", [0.0, -1.0, float("inf"), float("nan")])
def test_a_cell_size_that_is_none_is_refused(cell_size: float) -> None:
    with pytest.raises(ConfigError, match=r"^map\.cell_size: found"):
        Parameters().with_cell_size(cell_size)


def test_a_length_of_more_cells_than_can_be_numbered_is_refused() -> None:
    assert "at most 2147483647" in only_fault_of("map: {thickness: 1e300 cells}")
    text = "map: {cell_size: 1e-9}\npipeline: [regions: {height_thresh: 1e10}]"
    assert "p.yaml:2:37: regions.height_thresh: " in only_fault_of(text)


def test_parameters_made_in_python_are_checked_too() -> None:
    parameters = Parameters(batch=BatchParameters(0), pipeline=(Median(max_nb=-1),))
    with pytest.raises(ConfigError) as caught:
        parameters.check()
    assert [fault.split(":")[0] for fault in caught.value.faults] == [
        "batch.min_points",
        "median.max_nb",
    ]


def test_a_stage_on_points_is_refused_after_one_on_the_map() -> None:
    fault = only_fault_of("pipeline:\n- orphans\n- regions\n- median")
    assert fault.startswith("p.yaml:4:3: median: works on points but stands after orphans")
    with pytest.raises(ConfigError, match=r"^median: works on points"):
        Parameters(pipeline=(Pyramids(), Median())).check()


# A craft of any size

SIZES: tuple[Length, ...] = (1e-6, 0.04, 0.3, 7.0, 1e5, Cells(0.01), Cells(1), Cells(5), Cells(77))


@pytest.mark.parametrize("preset", [*PRESETS, None])
def test_a_craft_of_any_size_needs_no_other_parameter(preset: str | None) -> None:
    for place, cell_size in product(range(len(SIZES)), (0.004, 0.06, 0.3, 2.5)):
        width, height = SIZES[place], SIZES[place - 4]
        sets = [f"vehicle.width={width}", f"vehicle.height={height}"]
        settled = load(preset, sets).with_cell_size(cell_size)
        assert load(preset, [*sets, f"map.cell_size={cell_size}"]).with_gap_size() == settled
        vehicle = Vehicle(width, height)
        assert replace(load(preset), vehicle=vehicle).with_cell_size(cell_size) == settled
        if preset is None:
            assert Parameters(vehicle=vehicle).with_cell_size(cell_size) == settled
        assert settled.map.gap_size == height
        for stage in settled.pipeline:
            if isinstance(stage, Pyramids):
                assert stage.max_height == height
            if isinstance(stage, GapStage):
                assert stage.max_gap == width
                widest = max(in_units(width, cell_size), 5 * cell_size)
                assert stage.max_gap_enhanced is not None
                assert in_units(stage.max_gap_enhanced, cell_size) == pytest.approx(widest)


def test_a_stage_alone_closes_the_gaps_that_it_would_in_a_pipeline() -> None:
    for max_gap, cell_size in ((0.3, 0.1), (0.3, 0.05), (Cells(7), 0.3), (None, 0.2)):
        alone = Plaster(max_gap=max_gap)
        (within,) = Parameters(pipeline=(alone,)).with_cell_size(cell_size).pipeline
        assert isinstance(within, Plaster)
        assert list(alone.passes(cell_size)) == list(within.passes(cell_size))
        assert alone.reach(cell_size) == within.reach(cell_size)


@pytest.mark.parametrize("stage", ["walls", "plaster"])
def test_a_second_pass_that_the_user_makes_too_narrow_is_refused(stage: str) -> None:
    sets = (f"{stage}.max_gap_enhanced=0.3", "vehicle.width=0.4")
    assert only_fault_of("", sets) == (
        f"`sets` {sets[0]}: {stage}.max_gap_enhanced: 0.3 is less than max_gap (0.4); at least "
        "that, or 0 for none"
    )
    assert loads("", sets=[*sets, f"{stage}.max_gap_enhanced=0"]).vehicle.width == 0.4


def test_a_craft_beyond_all_bounds_is_blamed_itself() -> None:
    for sets in (("vehicle.width=1e300",), ("map.cell_size=1e-3", "vehicle.height=1e300")):
        text = "map: {cell_size: 1}"
        assert only_fault_of(text, sets).startswith(f"`sets` {sets[-1]}: {sets[-1].split('=')[0]}")


# Lengths that differ by a rounding


def test_lengths_that_differ_by_a_rounding_are_the_same() -> None:
    for cells in range(1, 60):
        for cell_size in (0.1, 0.15, 0.3, 0.7, 1 / 3, 1e-3, 12.3):
            units = float(repr(round(cells * cell_size, 12)))
            for length, other in ((units, Cells(cells)), (Cells(cells), units)):
                plaster = Plaster(max_gap=length, max_gap_enhanced=other)
                pyramids = Pyramids(max_height=length)
                grid = MapParameters(cell_size, gap_size=other)
                Parameters(map=grid, pipeline=(plaster, pyramids)).check()


@pytest.mark.parametrize("cell_size", [0.1, 40.0])
def test_lengths_that_differ_by_a_millionth_of_a_cell_are_not(cell_size: float) -> None:
    less = 3 * cell_size - 1e-6 * cell_size
    plaster = Plaster(max_gap=Cells(3), max_gap_enhanced=less)
    pyramids = Pyramids(max_height=Cells(3))
    parameters = Parameters(
        map=MapParameters(cell_size, gap_size=less), pipeline=(plaster, pyramids)
    )
    with pytest.raises(ConfigError) as caught:
        parameters.check()
    assert [fault.split(":")[0] for fault in caught.value.faults] == [
        "plaster.max_gap_enhanced",
        "pyramids.max_height",
    ]


# What the size of a cell decides


def test_contradictions_for_some_sizes_of_cells_are_foretold() -> None:
    text = """
        vehicle: {height: 0.8}
        pipeline:
          - plaster: {max_gap: 0.5, max_gap_enhanced: 2 cells}
          - pyramids: {max_height: 2 cells}
    """
    foretold = conditional_faults(loads(text))
    assert [fault.partition(": ")[0] for fault in foretold] == [
        "cells smaller than 0.25",
        "cells larger than 0.4",
    ]
    for cell_size, expected in ((0.2, foretold[:1]), (0.3, []), (0.5, foretold[1:])):
        told = [fault.partition(": ")[2] for fault in expected]
        if not told:
            loads(text).with_cell_size(cell_size)
            continue
        with pytest.raises(ConfigError) as caught:
            loads(text).with_cell_size(cell_size)
        assert list(caught.value.faults) == told
    assert conditional_faults(loads(text, sets=["map.cell_size=0.3"])) == []
    assert conditional_faults(Parameters(vehicle=Vehicle(0.4, 1.2))) == []
