"""YAML scalars, and documents that mean harm.

Ways to pass without being right: to leave scalars to the rules of YAML 1.1 (words and numbers
that the two versions read differently); to catch a hostile document with a guard for it alone
(any text at all must end in parameters or in faults, and no exception of another kind).
"""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.config import loads, to_yaml
from mlscli.errors import ConfigError
from mlscli.parameters.lengths import Cells
from tests.helpers.faults import faults_of, only_fault_of


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("1e-3", 0.001),
        ("1E2", 100.0),
        (".5", 0.5),
        ("+2.", 2.0),
        ("010", 10.0),
        ("2 cells", Cells(2)),
        ("1 cell", Cells(1)),
        ("'2.5  cells'", Cells(2.5)),
        ("1e-3 cells", Cells(0.001)),
    ],
)
def test_a_length_is_a_number_or_a_number_of_cells(written: str, value: Any) -> None:
    assert loads(f"map: {{thickness: {written}}}").map.thickness == value


NO_LENGTHS = [
    *[
        "0x10",
        "0o10",
        "1_000",
        "1:30",
        ".inf",
        "-.inf",
        ".nan",
        "1e999",
        "nan",
        "yes",
        "true",
        "''",
        "'0.5'",
        "=",
        "null",
    ],
    *["2cells", "two", "-1", "[1]", "{a:1}", "2001-01-01", "٢"],
    *["2 cell s", "two cells", "-1 cells", "1e999 cells", "9" * 400, "9" * 5000],
]


@pytest.mark.parametrize("written", NO_LENGTHS)
def test_what_is_no_length_is_refused_where_it_stands(written: str) -> None:
    fault = only_fault_of(f"map:\n  thickness: {written}")
    assert fault.startswith("p.yaml:2:14: map.thickness: found ")
    assert fault.endswith("expected a length of at least 0, as a number or N cells")
    assert len(fault) < 200


@pytest.mark.parametrize("word", ["yes", "on", "off", "no", "True", "1", "'true'", "~"])
def test_only_true_and_false_are_truth_values(word: str) -> None:
    assert "expected true or false" in only_fault_of(f"pipeline: [regions: {{snap: {word}}}]")


def test_true_is_no_number_and_a_fraction_no_count() -> None:
    text = "batch: {min_points: true}\npipeline:\n- median: {max_nb: 16.0}\n- orphans: {min_x: 1e3}"
    assert [fault.split(" ")[0] for fault in faults_of(text)] == [
        "p.yaml:1:21:",
        "p.yaml:3:20:",
        "p.yaml:4:20:",
    ]


HOSTILE = [
    *["[" * 50_000, "{a: " * 50_000, "- " * 50_000],
    *["a: \x07", "\x00", 'mode: "\\UFFFFFFFF"', '"\\ud800": 1', "\ta: 1", "? [", "'"],
    *["--- 1\n--- 2", "%YAML 9.9.9\n---", "&a [*a]", "mode: *undefined", "!!set {a}"],
    *["[1]: 2", "<<: {mode: x}", "7", "? !!python/name:os.system\n: 1"],
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_hostile_document_ends_in_lines_that_say_where(text: str) -> None:
    for fault in faults_of(text):
        assert re.match(r"p\.yaml:\d+:\d+: ", fault)
        assert len(fault.splitlines()) == 1
        assert len(fault) < 250


BOMB = "\n".join(
    f"{b}: &{b} [*{a}, *{a}, *{a}, *{a}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


def test_a_bomb_of_aliases_is_not_expanded() -> None:
    faults = faults_of(f"a: &a [x]\n{BOMB}")
    assert len(faults) == 50


@settings(max_examples=300)
@given(st.text(st.sampled_from("abmode: {}[]-&*!|>'\"\\%@#?,\n\t01eE.~<\u2028\x85")))
def test_any_text_is_parameters_or_faults(text: str) -> None:
    try:
        parameters = loads(text)
    except ConfigError as error:
        faults = error.faults
    else:
        faults = (to_yaml(parameters),)
    assert all(faults)
    assert faults
