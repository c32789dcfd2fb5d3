"""What each stage is worth, in numbers that repeat.

How one could cheat: a table whose rows are all made with the whole pipeline; a stage that does harm
and is not named.
"""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from mlscli.config import loads
from mlscli.errors import UsageError
from mlscli.pipeline.parameters import Parameters
from mlscli.trials.quality import ADDED, StageWorth, flown, scored, table, to_dict, to_markdown


@pytest.fixture(scope="module")
def rows() -> list[StageWorth]:
    return table(["planes-walls"], [0.0, 0.2])


def test_there_is_a_row_for_each_share_and_stage_in_the_order_they_are_added(
    rows: list[StageWorth],
) -> None:
    stages = ["none", *ADDED]
    assert [(row.outliers, row.stages) for row in rows] == [
        (share, stage) for share in (0.0, 0.2) for stage in stages
    ]


def test_the_median_makes_outliers_harmless_and_plaster_closes_what_is_missing(
    rows: list[StageWorth],
) -> None:
    none, median, _, plaster, *_ = (row for row in rows if row.outliers == 0.2)
    assert none.correctness < 0.8
    assert median.correctness > 0.97
    assert median.rmse < 0.5 < none.rmse
    assert plaster.completeness > median.completeness + 0.03


def test_each_row_is_the_score_of_a_pipeline_of_its_own(rows: list[StageWorth]) -> None:
    flight = flown("planes-walls", 0.2, seed=1)
    default = Parameters().with_cell_size(0.15)
    expected = scored(flight, replace(default, pipeline=default.pipeline[:1]))
    row = next(row for row in rows if (row.outliers, row.stages) == (0.2, "median"))
    assert row.completeness == expected.total.completeness.share
    assert row.false == expected.false_levels


def test_the_same_seeds_give_the_same_table_and_others_another() -> None:
    first, again, other = (table(["bridge"], [0.1], seeds=[seed]) for seed in (3, 3, 4))
    assert first == again != other


def test_a_stage_that_does_harm_is_named() -> None:
    harmful = loads("pipeline: [median, orphans: {min_neighbours: 40}, plaster]")
    rows = table(["planes"], [0.1], parameters=harmful)
    assert [row.stages for row in rows if row.worse] == ["orphans"]
    assert "- orphans: planes with 10% outliers" in to_markdown(rows)


def test_the_report_holds_every_row(rows: list[StageWorth]) -> None:
    assert json.loads(json.dumps(to_dict(rows)))[3]["stages"] == "plaster"
    lines = [line for line in to_markdown(rows).splitlines() if line.startswith("| ")]
    assert len(lines) == 1 + len(rows)


def test_without_a_seed_there_is_no_table() -> None:
    with pytest.raises(UsageError, match="`seeds`"):
        table(["planes"], [0.1], seeds=[])
