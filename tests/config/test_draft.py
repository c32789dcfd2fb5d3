"""The faults of a document and of settings on top of it.

Ways to pass without being right: to stop at the first fault (documents with many, each expected
at its place); to locate everything alike (any choice of faults, any key, wherever they stand); to
let a misspelt key pass (every key there is, misspelt); to report what only follows from another
fault (documents with one cause, of which one fault is expected).
"""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.config import loads, to_yaml
from mlscli.pipeline.parameters import Parameters
from tests.helpers.faults import faults_of, only_fault_of


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("map: {cell_size: 0}", "auto or a number of at least 1e-09 and at most 1e+09"),
        ("map: {cell_size: 2 cells}", "auto or a number of at least 1e-09 and at most 1e+09"),
        ("vehicle: {width: 0}", "a length above 0, as a number or N cells"),
        ("batch: {min_points: 0}", "a whole number of at least 1"),
        ("mode: sequental", "consistent or sequential"),
        ("pipeline: [orphans: {min_x: a}]", "a whole number or null"),
    ],
)
def test_a_value_out_of_range_is_told_the_range(text: str, right: str) -> None:
    assert only_fault_of(text).endswith(f"; expected {right}")


def test_the_least_value_allowed_is_allowed() -> None:
    parameters = loads("map: {gap_size: 0}\nbatch: {min_points: 1}\npipeline: []")
    assert parameters.map.gap_size == 0
    assert parameters.batch.min_points == 1


MANY = """\
mode: sequental
vehicel: {width: 1}
vehicle: {width: -1, heigth: 2}
map: {cell_size: 2 cells, gap_size: on}
on: 3
map: {}
pipeline:
  - orphans: {horizontal: a}
  - median: {max_nb: 3}
  - medain: {nb_radius: 1}
  - plaster: {max_gap: 0.5, max_gap_enhanced: 0.2, height_thresh: -1}
  - pyramids:
    height_factor_thresh: 3
  - walls: !!python/object/apply:os.system ["exit 1"]
  - walls: {max_gap: &wide 3, max_gap_enhanced: *wide}
  - 7
"""


FAULTS = [
    ("1:7", "mode", "consistent or sequential"),
    ("2:1", "vehicel", "did you mean vehicle?"),
    ("3:18", "vehicle.width", "above 0"),
    ("3:22", "vehicle.heigth", "did you mean height?"),
    ("4:18", "map.cell_size", "auto or a number of at least 1e-09 and at most 1e+09"),
    ("4:37", "map.gap_size", "found 'on'"),
    ("5:1", "on", "unknown key"),
    ("6:1", "map", "first in line 4"),
    ("8:27", "orphans.horizontal", "found 'a'"),
    ("9:5", "median", "after orphans"),
    ("9:5", "median.min_nb", "max_nb"),
    ("10:5", "pipeline.medain", "did you mean median?"),
    ("11:47", "plaster.max_gap_enhanced", "max_gap"),
    ("11:67", "plaster.height_thresh", "of at least 0"),
    ("12:5", "pipeline", "the keys pyramids, height_factor_thresh"),
    ("14:12", "tag:yaml.org,2002:python/object/apply:os.system", "tags are not taken"),
    ("15:22", "&wide", "anchors are not taken"),
    ("15:49", "*wide", "aliases are not taken"),
    ("16:5", "pipeline", "found 7"),
]


def test_every_fault_is_reported_at_once_each_in_its_place_in_order() -> None:
    faults = faults_of(MANY)
    assert len(faults) == len(FAULTS)
    for fault, (place, key, word) in zip(faults, FAULTS, strict=True):
        assert fault.startswith(f"p.yaml:{place}: {key}: ")
        assert word in fault


@given(st.sets(st.integers(0, 4), min_size=1))
def test_any_choice_of_faults_is_reported_in_full(chosen: set[int]) -> None:
    lines = [
        ("mode: x", "mode: sequential"),
        ("vehicle: {width: x}", "vehicle: {width: 1}"),
        ("map: {thicknes: 1}", "map: {thickness: 1}"),
        ("batch: {min_points: 0}", "batch: {min_points: 1}"),
        ("pipeline: [regions: {min_size: 0}]", "pipeline: []"),
    ]
    text = "\n".join(wrong if n in chosen else right for n, (wrong, right) in enumerate(lines))
    places = [int(fault.split(":")[1]) - 1 for fault in faults_of(text)]
    assert places == sorted(chosen)


KEY_LINES = [
    (number, match[1], match[2])
    for number, line in enumerate(to_yaml(Parameters()).splitlines())
    if (match := re.match(r"( *(?:- )?)([a-z_]{2,}):", line))
]


@given(st.sampled_from(KEY_LINES), st.data())
def test_a_misspelt_key_is_one_fault_that_names_the_right_one(
    key_line: tuple[int, str, str], data: st.DataObject
) -> None:
    number, indent, key = key_line
    at = data.draw(st.integers(1, len(key) - 2) if len(key) > 2 else st.just(0))
    slip = data.draw(st.sampled_from(["", key[at] * 2]))
    lines = to_yaml(Parameters()).splitlines()
    misspelt = key[:at] + slip + key[at + 1 :]
    lines[number] = lines[number].replace(key, misspelt, 1)
    fault = only_fault_of("\n".join(lines))
    assert fault.startswith(f"p.yaml:{number + 1}:{len(indent) + 1}: ")
    assert re.search(rf"\b{misspelt}: unknown (key|stage); did you mean {key}\?$", fault)


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("plaster.max_gp=3", "did you mean max_gap?"),
        ("plastr.max_gap=3", "did you mean plaster?"),
        ("regions.min_size=3", "its stages: rays, median, orphans, walls, plaster, pyramids"),
        ("vehicle=3", "such as vehicle.width"),
        ("max_gap=3", "walls.max_gap or plaster.max_gap"),
        ("plaster.max_gap", "plaster.max_gap=VALUE"),
        ("plaster.max_gap=", "plaster.max_gap=VALUE"),
        ("plaster.max_gap=[1", "no valid YAML"),
        ("plaster.max_gap=*a", "aliases are not taken"),
        ("plaster.max_gap=-1", "of at least 0"),
        ("plaster.max_gap={x: 1}", "found keys with values"),
        ("median.min_nb=30", "max_nb"),
        ("=3", "no name is given"),
        ("a.b.c=3", "unknown name"),
        ("pipeline=[]", "unknown name"),
    ],
)
def test_a_setting_at_fault_is_named_in_full(setting: str, told: str) -> None:
    fault = only_fault_of("", (setting,))
    assert fault.startswith(f"`sets` {setting}: ")
    assert told in fault


def test_faults_of_settings_come_with_those_of_the_file() -> None:
    faults = faults_of("mode: x", ("map.cell_size=0", "regions.min_size=1", "median.max_nb=-1"))
    starts = ("p.yaml:1:7: mode", "`sets` map.cell", "`sets` regions", "`sets` median")
    assert [f.startswith(s) for f, s in zip(faults, starts, strict=True)] == [True] * 4


def test_a_setting_at_fault_in_several_stages_is_one_fault() -> None:
    assert "x" in only_fault_of("pipeline: [orphans, orphans]", ("orphans.vertical=x",))
    assert "30" in only_fault_of("pipeline: [median, median]", ("median.min_nb=30",))


def test_a_value_at_fault_in_the_file_is_a_fault_even_where_a_setting_replaces_it() -> None:
    assert "p.yaml:1:18" in only_fault_of("map: {cell_size: x}", ("map.cell_size=1",))


def test_nothing_is_concluded_from_a_value_at_fault() -> None:
    text = "vehicle: {width: x}\npipeline: [walls: {max_gap_enhanced: 0.1 cells}]"
    assert "vehicle.width" in only_fault_of(text)
    assert "medain" in only_fault_of("pipeline: [medain]", ("median.min_nb=1",))
    assert "pipeline" in only_fault_of("pipeline: median", ("median.min_nb=1",))
