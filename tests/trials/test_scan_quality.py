"""What each stage is worth on scans, in numbers that can be had by other commands, too.

How one could cheat: a scan cut down to what the map found, or a mesh to what is near the scan;
scores of the whole pipeline in every row; red counted as right, or left out of both sides; a
distance that grows until all agrees.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mlscli
from mlscli.config import load, loads
from mlscli.errors import InputError, UsageError
from mlscli.io.writing.flight_text import write_text
from mlscli.maps.surface_map import ARTIFICIAL
from mlscli.mesh import build_mesh
from mlscli.scenes.noise import Noise
from mlscli.scenes.scan_flight import fly_scan
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Scatter
from mlscli.scoring import score_mesh
from mlscli.trials.scan_quality import StageWorth, table, to_dict, to_markdown
from tests.scenes.clouds import level, upright

SLAM, FEATURES = Noise("slam", Scatter(0.08, 0.08)), 150
# So small that some hold no point.
SMALL = "map.cell_size=0.4"


def yard(name: str = "yard") -> Scan:
    """Return a floor with a hole, and a wall at its side."""
    floor, wall = level(3000, (0, 8), (0, 8), 0.0), upright(750, (0, 8), (0, 2), 0.0)
    hole = np.abs(floor[:, :2] - 4).max(axis=1) < 1
    return Scan.of(name, np.concatenate((floor[~hole], wall)))


@pytest.fixture(scope="module")
def rows() -> list[StageWorth]:
    return table([yard()], [0.1], [3], SLAM, FEATURES, load("default", [SMALL]))


def test_rows_are_the_scores_of_the_maps_that_a_build_makes(
    rows: list[StageWorth], tmp_path: Path
) -> None:
    assert [row.stages for row in rows] == [
        *("none", "rays", "median", "orphans", "plaster", "pyramids", "walls")
    ]
    scan = yard()
    flight = fly_scan(scan, FEATURES, SLAM, seed=3)
    write_text(tmp_path / "yard.txt", flight.keyframes)
    plain, default = (
        build_mesh(mlscli.build_map(tmp_path / "yard.txt", load(preset, [SMALL])))
        for preset in ("plain", "default")
    )
    for row, mesh in ((rows[0], plain), (rows[-1], default)):
        assert (row.cloud, row.outliers, row.cell_size, row.seen) == ("yard", 0.1, 0.4, flight.seen)
        expected = score_mesh(mesh, scan.xyz, 0.4, whole=True)
        scores = expected.precision, expected.recall, expected.f
        assert (row.precision, row.recall, row.f) == scores
        assert expected.f < 1
    # What lies beside the scan is wrong, and not left out.
    assert rows[0].precision < score_mesh(plain, scan.xyz, 0.4).precision
    # The mesh once more, its artificial triangles cut off; and these by themselves.
    red = default.group(default.triangles) == ARTIFICIAL
    rest, alone = (
        score_mesh(replace(default, triangles=default.triangles[which]), scan.xyz, 0.4, whole=True)
        for which in (~red, red)
    )
    without = rows[-1].precision_without_red, rows[-1].recall_without_red, rows[-1].f_without_red
    assert without == pytest.approx((rest.precision, rest.recall, rest.f))
    assert rows[-1].f_without_red < rows[-1].f
    assert rows[-1].red_right == pytest.approx(alone.precision)
    assert 0.7 < alone.precision < 0.95
    assert rows[0].red_right is None


def test_rows_are_means_over_the_seeds() -> None:
    plain = loads("pipeline: []")
    asked = ([yard()], [0.0, 0.2])
    one, two, both = (table(*asked, seeds, SLAM, FEATURES, plain) for seeds in ([1], [2], [1, 2]))
    assert [row.outliers for row in both] == [0.0, 0.2]
    for first, second, mean in zip(one, two, both, strict=True):
        for name in ("cell_size", "precision", "recall", "f"):
            values = getattr(first, name), getattr(second, name)
            assert getattr(mean, name) == pytest.approx(sum(values) / 2)
    assert one != two


def test_a_stage_that_does_harm_is_named() -> None:
    harmful = loads("pipeline: [median, orphans: {min_neighbours: 24}]")
    found = table([yard(), yard("again")], [0.0], [1], None, FEATURES, harmful)
    assert [(row.cloud, row.stages) for row in found if row.worse] == [
        ("yard", "orphans"),
        ("again", "orphans"),
    ]
    report = to_markdown(found)
    assert "## Stages that make a scan worse" in report
    assert "- orphans: again with 0% outliers" in report


def test_the_report_holds_every_row(rows: list[StageWorth]) -> None:
    assert json.loads(json.dumps(to_dict(rows)))[1]["stages"] == "rays"
    report = to_markdown(rows)
    head, *lines = [line for line in report.splitlines() if line.startswith("| ")]
    assert len(lines) == len(rows)
    cells = dict(zip(head.split(" | "), lines[1].split(" | "), strict=True))
    assert cells["F %"] == f"{100 * rows[1].f_without_red:.2f}"
    assert cells["precision %"] == f"{100 * rows[1].precision:.2f}"
    assert cells["cell"] == f"{rows[1].cell_size:.3g}"


def test_a_scan_of_which_no_map_is_left_is_named() -> None:
    nothing = loads("pipeline: [median: {min_nb: 8, max_nb: 16, nb_radius: 0.000001}]")
    with pytest.raises(InputError, match="yard: the map holds no patches"):
        table([yard()], [0.0], [1], None, FEATURES, nothing)
    with pytest.raises(UsageError, match="`features` 0"):
        table([yard()], features=0)
