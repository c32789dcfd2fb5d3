"""Configurations, read and written.

Ways to pass without being right: to write what is merely readable (what was written must read
back as equal, through YAML and through JSON); to keep defaults where another parameter decides
(the same document with other vehicles); to check a preset against itself (its values stand here).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mlscli.config import PRESETS, load, loads, preset_text, to_yaml
from mlscli.errors import ConfigError
from mlscli.parameters.fields import fields_of
from mlscli.parameters.lengths import Cells, Length
from mlscli.pipeline.parameters import (
    DEFAULT_PIPELINE,
    BatchParameters,
    MapParameters,
    Parameters,
    Vehicle,
    to_dict,
)
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.registry import STAGES
from mlscli.pipeline.stages.stage import PointStage, Stage
from mlscli.pipeline.stages.walls import Walls


def test_the_starting_values_are_those_of_the_contract_and_the_quality_bench() -> None:
    assert Parameters() == Parameters(
        mode="consistent",
        vehicle=Vehicle(width=Cells(1), height=Cells(3)),
        map=MapParameters(cell_size="auto", gap_size="auto", thickness=Cells(1)),
        batch=BatchParameters(min_points=80),
        pipeline=(
            Rays("auto", Cells(4), Cells(2), max_nb=24, min_nb=8, min_share=0.4),
            Median(
                nb_radius=Cells(3),
                max_nb=24,
                min_nb=4,
                recentre=Cells(0.75),
                level=Cells(0.75),
                min_share=0.4,
                max_slope=2.0,
                layer_share=0.3,
                across=Cells(0.75),
            ),
            Orphans(horizontal=Cells(4), vertical=Cells(2), min_neighbours=1, min_share=0.03),
            Walls(
                height_thresh=0.5,
                max_gap=Cells(1),
                max_gap_enhanced=Cells(5),
                join=Cells(2),
                along=Cells(3),
                support=1,
                pieces=Cells(1.5),
            ),
            Plaster(
                height_thresh=0.5,
                height_clearance=Cells(0.5),
                max_gap=Cells(1),
                max_gap_enhanced=Cells(5),
                slope_reach=Cells(2),
                support=2,
                over_lower=False,
                sight=Cells(6),
            ),
            Pyramids(height_factor_thresh=1.5, max_height=None, pits=True),
        ),
    )


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n", "~", "map:\nvehicle: {}\n", "\ufeff"])
def test_a_document_that_says_nothing_means_the_defaults(text: str, tmp_path: Path) -> None:
    file = tmp_path / "empty.yaml"
    file.write_text(text, encoding="utf-8")
    assert load(file) == load(None) == Parameters()


def of_the_thesis(widest: Length) -> tuple[Stage, ...]:
    """Return the thesis's stages, of which plaster closes gaps up to `widest`."""
    return (
        Median(nb_radius=0.35, max_nb=16, min_nb=3),
        Orphans(horizontal=Cells(2), vertical=0.2),
        Plaster(height_thresh=0.5, height_clearance=0.1, max_gap=0.15, max_gap_enhanced=widest),
        Pyramids(height_factor_thresh=1.5, max_height=0.5),
    )


def test_the_configuration_of_the_contract_reads_as_it_says() -> None:
    parameters = loads("""
        mode: consistent
        vehicle: {width: 0.15, height: 0.5}
        map: {cell_size: 0.15, gap_size: 0.5, thickness: 0.15}
        batch: {min_points: 80}
        pipeline:
          - median: {nb_radius: 0.35, max_nb: 16, min_nb: 3}
          - orphans: {horizontal: 2 cells, vertical: 0.2}
          - plaster: {height_thresh: 0.5, height_clearance: 0.1, max_gap: 0.15,
                      max_gap_enhanced: 0.75}
          - pyramids: {height_factor_thresh: 1.5}
    """)
    expected = Parameters(
        vehicle=Vehicle(0.15, 0.5),
        map=MapParameters(0.15, 0.5, 0.15),
        pipeline=of_the_thesis(0.75),
    )
    assert parameters == expected


def test_what_is_left_out_follows_the_parameter_that_it_comes_from() -> None:
    text = "vehicle: {width: 0.3, height: 2 cells}\nmap: {cell_size: 1, gap_size: null}"
    parameters = loads(text)
    assert parameters.map.gap_size == Cells(2)
    widths = [s.max_gap for s in parameters.pipeline if isinstance(s, Walls | Plaster)]
    assert widths == [0.3, 0.3]
    assert parameters.pipeline[-1] == Pyramids(max_height=Cells(2), pits=True)


def test_a_setting_counts_before_what_is_left_out_is_filled_in() -> None:
    text = "vehicle: {height: 9}\npipeline: [plaster, pyramids]"
    sets = ["vehicle.width=2 cells", "vehicle.height=0.7", "map.gap_size=null"]
    parameters = loads(text, sets=sets)
    assert parameters.map.gap_size == 0.7
    plaster = Plaster(max_gap=Cells(2), max_gap_enhanced=Cells(5))
    assert parameters.pipeline == (plaster, Pyramids(max_height=0.7))


def test_a_setting_wins_over_the_file_and_the_last_one_over_the_others() -> None:
    text = "map: {cell_size: 1}\nmode: sequential"
    parameters = loads(text, sets=["map.cell_size=2", "map.cell_size=1e-3", "mode=consistent"])
    assert parameters.map.cell_size == 0.001
    assert parameters.mode == "consistent"


def test_a_setting_reaches_every_stage_of_its_name() -> None:
    parameters = loads("pipeline: [orphans, plaster, orphans]", sets=["orphans.horizontal=7"])
    stages = (Orphans(horizontal=7), Plaster(), Orphans(horizontal=7))
    assert parameters == Parameters(pipeline=stages)


def test_stages_stand_as_often_and_in_the_order_that_the_user_says() -> None:
    text = "pipeline:\n- median\n- median: {min_nb: 2}\n- regions:\n- orphans: {}\n- regions"
    stages = (Median(), Median(min_nb=2), Regions(), Orphans(), Regions())
    assert loads(text).pipeline == stages
    assert loads("pipeline: []").pipeline == ()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda _: None, "no such"),
        (lambda path: path.mkdir(), "directory"),
        (lambda path: path.write_bytes(b"\xff\xfem\x00"), "UTF-8"),
        (lambda path: path.write_bytes(b"#" * 1_000_001), "1000000 bytes"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(
    make: Callable[[Path], None], told: str, tmp_path: Path
) -> None:
    make(tmp_path / "odd.yaml")
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "odd.yaml")
    assert str(caught.value).startswith(f"{tmp_path / 'odd.yaml'}: ")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_presets_are_the_files_in_their_folder() -> None:
    folder = Path(__file__).parents[2] / "configs"
    assert sorted(file.stem for file in folder.iterdir()) == sorted(PRESETS)


def test_the_presets_say_what_they_are_named_for() -> None:
    assert load("default") == Parameters()
    assert load("plain") == Parameters(pipeline=())
    assert load("thesis") == Parameters(
        mode="sequential",
        vehicle=Vehicle(0.15, 0.5),
        map=MapParameters(0.15, 0.5, 0.15),
        pipeline=of_the_thesis(Cells(5)),
    )


def test_a_stage_that_is_named_follows_the_thesis_where_nothing_else_is_said() -> None:
    named = loads("pipeline: [median, orphans, walls, plaster, pyramids]").pipeline
    widths: dict[str, Any] = {"max_gap": Cells(1), "max_gap_enhanced": Cells(5)}
    gaps = Walls(**widths), Plaster(**widths)
    assert named == (Median(), Orphans(), *gaps, Pyramids())
    assert Median().recentre == Walls().join == Plaster().slope_reach == 0
    assert Median().level == Median().min_share == Median().max_slope == 0
    assert not Pyramids().pits
    # A setting changes the parameter that it names, and no other.
    median = Median(**DEFAULT_PIPELINE["median"] | {"min_nb": 5})
    assert load(None, ["median.min_nb=5"]).pipeline[1] == median


def test_the_default_preset_leaves_to_other_parameters_what_they_decide() -> None:
    sets = ["vehicle.width=2", "vehicle.height=0.3", "walls.max_gap_enhanced=3"]
    sets.append("plaster.max_gap_enhanced=3")
    assert load("default", sets) == load(None, sets)


@pytest.mark.parametrize("preset", PRESETS)
def test_each_key_of_a_preset_has_a_comment(preset: str) -> None:
    above = ""
    for line in preset_text(preset).splitlines():
        if re.match(r" +[a-z_]+:|mode:| +- ", line):
            assert above.lstrip().startswith("# "), line
        above = line
    load(preset).with_cell_size(0.15)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_configuration_fits_80_columns(preset: str) -> None:
    for text in (preset_text(preset), to_yaml(load(preset))):
        assert [line for line in text.splitlines() if len(line) > 80] == []


def test_a_name_of_no_preset_and_no_file_is_told_the_nearest() -> None:
    with pytest.raises(ConfigError, match=r"thess: .*did you mean thesis\?"):
        load("thess")


def values_for(stage: type) -> st.SearchStrategy[dict[str, Any]]:
    """Return values for a dataclass's parameters: each kind that a parameter allows, in range."""
    numbers = st.floats(0.001, 1e6)
    options = {}
    for name, item in fields_of(stage).items():
        kinds: list[st.SearchStrategy[Any]] = [st.sampled_from(item.words)] if item.words else []
        if float in item.kinds:
            kinds.append(numbers)
        if Cells in item.kinds:
            kinds.append(st.builds(Cells, numbers))
        if bool in item.kinds:
            kinds.append(st.booleans())
        if int in item.kinds:
            kinds.append(st.integers(1 if item.low else 0, 2**31))
        if type(None) in item.kinds:
            kinds.append(st.none())
        options[name] = st.one_of(kinds)
    return st.fixed_dictionaries(options)


def built(part: type) -> st.SearchStrategy[Any]:
    return values_for(part).map(lambda values: part(**values))


def is_sound(stage: Stage) -> bool:
    return not list(stage.faults(1.0, None))


SOUND_STAGES = st.one_of([built(stage).filter(is_sound) for stage in STAGES.values()])


@st.composite
def parameter_sets(draw: st.DrawFn) -> Parameters:
    stages = draw(st.lists(SOUND_STAGES, max_size=4))
    stages.sort(key=lambda stage: not isinstance(stage, PointStage))
    parameters = Parameters(
        mode=draw(st.sampled_from(["consistent", "sequential"])),
        vehicle=draw(built(Vehicle)),
        map=draw(built(MapParameters)),
        batch=draw(built(BatchParameters)),
        pipeline=tuple(stages),
    )
    try:
        parameters.check()
    except ConfigError:
        assume(False)
    return parameters


@settings(max_examples=200)
@given(parameter_sets())
def test_what_is_written_reads_back_as_the_same(parameters: Parameters) -> None:
    assert loads(to_yaml(parameters)) == parameters
    assert loads(json.dumps(to_dict(parameters), allow_nan=False)) == parameters


@given(parameter_sets())
def test_each_parameter_is_written_below_what_it_does(parameters: Parameters) -> None:
    text = to_yaml(parameters)
    words = " ".join(re.sub(r"\n *# ", " ", text).split())
    for part in (parameters.vehicle, parameters.map, parameters.batch, *parameters.pipeline):
        for item in fields_of(type(part)).values():
            assert f"{item.help} ({item.accepts}; default: " in words
    assert max(map(len, text.splitlines())) <= 100
