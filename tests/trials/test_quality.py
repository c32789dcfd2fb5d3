"""What each stage is worth, in numbers that repeat.

How one could cheat: a table whose rows are all made with the whole pipeline; a stage that does harm
and is not named; errors that look small in a unit that grows with them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import mlscli
from mlscli.config import loads
from mlscli.errors import UsageError
from mlscli.io.writing.flight_text import write_text
from mlscli.pipeline.parameters import Parameters
from mlscli.scenes.noise import Noise
from mlscli.scenes.surfaces import Scatter
from mlscli.scenes.truth import truth
from mlscli.scoring import score
from mlscli.trials.quality import StageWorth, flown, scored, table, to_dict, to_markdown
from mlscli.trials.staged import ADDED

SLAM = Noise("slam", Scatter(0.02, 0.02))


@pytest.fixture(scope="module")
def rows() -> list[StageWorth]:
    return table(["planes-walls"], [0.0, 0.2])


def test_there_is_a_row_for_each_share_and_stage_in_the_order_they_are_added(
    rows: list[StageWorth],
) -> None:
    # This noise is the same at every distance, so that there is nothing to be moved along rays.
    stages = ["none", *ADDED[1:]]
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
    median = tuple(stage for stage in default.pipeline if stage.name == "median")
    expected = scored(flight, replace(default, pipeline=median))
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


# --- noise that grows with the distance ---


@pytest.fixture(scope="module")
def grown() -> list[StageWorth]:
    return table(["planes"], [0.1], noise=SLAM)


def test_with_noise_along_the_rays_these_come_first_and_the_last_row_is_what_a_build_makes(
    grown: list[StageWorth], tmp_path: Path
) -> None:
    assert [row.stages for row in grown] == ["none", *ADDED]
    none, rays, *_, last = grown
    assert rays.flat_called_vertical < none.flat_called_vertical / 2
    flight = flown("planes", 0.1, 1, noise=SLAM)
    write_text(tmp_path / "planes.txt", flight.keyframes)
    surface = mlscli.build_map(tmp_path / "planes.txt")
    true = truth(flight.scene, surface.cell_size, surface.gap_size, surface.thickness)
    total = score(surface, true).total
    assert last.cell_size == surface.cell_size != 0.15
    assert last.correctness == total.correctness.share
    assert last.completeness == total.completeness.share
    assert last.flat_called_vertical == total.flat_called_vertical.share
    assert total.heights.rmse is not None
    # Such points have no one sigma.
    assert last.unit == "cell"
    assert last.rmse == pytest.approx(total.heights.rmse / surface.cell_size)


def test_heights_err_in_sigmas_where_there_is_one(rows: list[StageWorth]) -> None:
    assert {(row.unit, row.cell_size) for row in rows} == {("sigma", 0.15)}
    plain = loads("pipeline: []")
    found = {}
    for sigma in (0.02, 0.04, 0.0):
        noise = Noise(sigma=Scatter(sigma, sigma))
        (found[sigma],) = table(["planes"], [0.0], noise=noise, parameters=plain)
    # The scatter asked for is that of the flight: twice as much of it is as large in sigmas.
    assert found[0.02].rmse == pytest.approx(found[0.04].rmse, rel=0.3)
    assert [row.unit for row in found.values()] == ["sigma", "sigma", "cell"]
    assert found[0.0].rmse * 0.15 < 0.5 * found[0.02].rmse * 0.02


def test_the_table_says_the_unit_and_the_cells_where_they_are_not_the_thesis_s(
    rows: list[StageWorth], grown: list[StageWorth]
) -> None:
    thesis, slam = to_markdown(rows), to_markdown(grown)
    assert "| rmse / sigma | bias / sigma |" in thesis
    assert "cell" not in thesis
    assert "| rmse / cell | bias / cell |" in slam
    assert f"| {grown[0].cell_size:.3g} |\n" in slam


def test_a_size_that_the_configuration_names_stays() -> None:
    sized = loads("map: {cell_size: 0.4}\npipeline: []")
    (row,) = table(["planes"], [0.1], noise=SLAM, parameters=sized)
    assert row.cell_size == 0.4
