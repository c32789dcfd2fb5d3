"""Parameters that contradict each other.

Ways to pass without being right: to compare lengths only where their units agree, or to compare
them before the size of a cell is known (the same lengths with cells of two sizes, and with none).
"""

from __future__ import annotations

import pytest

from mlscli.config import loads
from mlscli.errors import ConfigError
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.parameters import BatchParameters, MapParameters, Parameters
from mlscli.pipeline.stages.median import Median
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
    assert loads(text, sets=["vehicle.height=5 cells"]).map.gap_size == Cells(5)


@pytest.mark.parametrize("cell_size", [0.0, -1.0, float("inf"), float("nan")])
def test_a_cell_size_that_is_none_is_refused(cell_size: float) -> None:
    with pytest.raises(ConfigError, match=r"^map\.cell_size: found"):
        Parameters().with_cell_size(cell_size)


def test_a_length_of_more_cells_than_can_be_numbered_is_refused() -> None:
    assert "at most 2147483647" in only_fault_of("map: {thickness: 1e300 cells}")
    text = "map: {cell_size: 1e-300}\npipeline: [regions: {height_thresh: 1e10}]"
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
