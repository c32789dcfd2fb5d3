"""`mls bench`, as a user runs it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from mlscli.commands.bench import command
from mlscli.config import load
from mlscli.errors import UsageError, with_options
from mlscli.trials.pace import measured, parse_sizes
from tests.helpers.program import mls
from tests.scenes.clouds import level

QUICK = ("--scenes", "planes", "--outliers", "0.1")
PLAIN = ("--quality", "--outliers", "0", "-c", "plain", "--json")


def test_the_report_is_a_table_or_json(tmp_path: Path) -> None:
    text = mls("bench", "--quality", *QUICK, cwd=tmp_path)
    assert text.returncode == 0, text.stderr
    assert "## planes" in text.stdout
    rows = json.loads(mls("bench", "--quality", *QUICK, "--json", cwd=tmp_path).stdout)
    assert [row["stages"] for row in rows][:2] == ["none", "median"]
    assert list(tmp_path.iterdir()) == []


def test_the_report_is_written_to_a_file_once(tmp_path: Path) -> None:
    for status in (0, 1):
        done = mls("bench", "--quality", *QUICK, "-o", "quality.md", cwd=tmp_path)
        assert done.returncode == status, done.stderr
        assert done.stdout == ""
    assert (tmp_path / "quality.md").read_text().startswith("## planes")


def bench(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_the_noise_asked_for_is_flown() -> None:
    usual, exact, slam = (
        json.loads(bench(*PLAIN, "--scenes", "planes", *noise).stdout)[0]
        for noise in ((), ("--sigma", "0.05,0.01"), ("--noise", "slam"))
    )
    assert [row["unit"] for row in (usual, exact, slam)] == ["sigma", "sigma", "cell"]
    assert 0.01 * exact["rmse"] < 0.5 * 0.05 * usual["rmse"]
    assert usual["cell_size"] == 0.15 != slam["cell_size"]


@pytest.fixture
def scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write two scans into the current folder, the second one cut, their y up."""
    x, y, z = np.vstack((level(1500, (0, 6), (0, 6), 0.0), level(300, (2, 4), (2, 4), 2.0))).T
    turned = np.column_stack((x, z, -y))
    np.savetxt(tmp_path / "table.txt", turned, fmt="%.17g")
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 1800\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    (tmp_path / "cut.ply").write_bytes(head.encode() + turned.astype("<f4").tobytes()[:-24])
    monkeypatch.chdir(tmp_path)
    return tmp_path


TABLE = ("--cloud", "table.txt", "--up", "y", "--sigma", "0,0")


@pytest.mark.usefixtures("scans")
def test_flights_over_scans_are_scored_by_them() -> None:
    rows = json.loads(bench(*PLAIN, *TABLE).stdout)
    fewer = json.loads(bench(*PLAIN, *TABLE, "--features", "20").stdout)
    assert [row["cloud"] for row in rows] == ["table.txt"]
    # All of it is seen, and is where it is seen.
    assert rows[0]["f"] > 0.99
    assert fewer[0]["cell_size"] > rows[0]["cell_size"]
    assert not bench(*PLAIN, "--cloud", "no.ply").stdout


def test_each_scan_has_a_table_as_far_as_it_can_be_read(scans: Path) -> None:
    done = mls("bench", *PLAIN[:-1], *TABLE, "--cloud", "cut.ply", cwd=scans)
    assert done.returncode == 3
    assert "cut.ply" in done.stderr
    for name in ("table.txt", "cut.ply"):
        assert f"## {name}\n\n| outliers | stages | cell | seen % |" in done.stdout


def test_batches_are_timed_compared_and_drawn(tmp_path: Path) -> None:
    done = mls("bench", "--sizes", "40,400", "--json", "-o", "old.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    old = json.loads((tmp_path / "old.json").read_text())
    assert [(row["size"], row["batches"], row["thesis"]) for row in old["rows"]] == [
        (40, 80, 0.02),
        (400, 8, 2.06),
    ]
    # Two sizes lie on the line through them.
    one, other = (row["seconds"] for row in old["rows"])
    assert old["exponent"] == pytest.approx(math.log10(other / one))
    again = mls(
        *("bench", "--sizes", "40..60:10", "--compare", "old.json", "--plot", "times.png"),
        cwd=tmp_path,
    )
    assert again.returncode == 0, again.stderr
    rows = [line.split("|") for line in again.stdout.splitlines() if line.startswith("| ")][1:]
    assert [row[1].strip() for row in rows] == ["40", "50", "60"]
    assert [row[6].strip() for row in rows] == [f"{1e3 * one:.2f}", "", ""]
    assert (tmp_path / "times.png").read_bytes().startswith(b"\x89PNG")
    compared = mls(
        "bench", "--sizes", "40,50", "--compare", "old.json", "--json", cwd=tmp_path
    ).stdout
    both, other_alone = json.loads(compared)["rows"]
    assert both["before"] == one
    assert both["ratio"] == pytest.approx(both["seconds"] / one)
    assert (other_alone["before"], other_alone["ratio"]) == (None, None)


def test_batches_larger_than_a_small_flight_are_cut_from_a_longer_one() -> None:
    pace = measured([6000, 10_000], load("plain"))
    assert [(row.size, row.batches) for row in pace.rows] == [(6000, 3), (10_000, 2)]
    # Batches of these sizes, and not of what was left of a flight.
    assert pace.rows[1].seconds > 0 < pace.rows[0].seconds


def test_the_sizes_of_the_thesis_are_those_of_its_figure() -> None:
    assert parse_sizes("20..400") == [*range(20, 201, 20), *range(240, 401, 40)]
    assert parse_sizes("20..400:40") == list(range(20, 401, 40))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "--quality"),
        (["--quality", "--sizes", "20"], "--quality or"),
        (["--quality", "--plot", "times.png"], "--sizes"),
        (["--sizes", "20", "--scenes", "bridge"], "--quality"),
        (["--sizes", "20", "--outliers", "0"], "--quality"),
        (["--sizes", "20", "--seeds", "2"], "--quality"),
        (["--sizes", "20.."], "A..B"),
        (["--sizes", "0..40"], "A..B"),
        (["--sizes", "0..1000000000000"], "10,000"),
        (["--sizes", "20..1000000000000"], "10,000"),
        (["--sizes", "20,10001"], "10,000"),
        (["--sizes", "400..20"], "A..B"),
        (["--sizes", "40", "--plot", "times.docx"], "png"),
        (["--quality", "--scenes", "brigde"], "bridge"),
        (["--quality", "--outliers", "many"], "--outliers"),
        (["--quality", "--outliers", "2"], "salt-pepper"),
        (["--quality", "--outliers", "nan"], "salt-pepper"),
        (["--quality", "--seeds", "1.5"], "--seeds"),
        (["--quality", "--seeds", "nan"], "--seeds"),
        (["--quality", "--seeds", "-1"], "--seed"),
    ],
)
def test_wrong_usage_is_one_line(tmp_path: Path, options: list[str], said: str) -> None:
    done = mls("bench", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("held", "said"),
    [
        ("[" * 100_000, "is no JSON"),
        ("{}", "holds no times"),
        (None, "cannot be read: No such file"),
    ],
)
def test_times_that_are_none_are_refused_in_one_line(
    tmp_path: Path, held: str | None, said: str
) -> None:
    if held is not None:
        (tmp_path / "old.json").write_text(held)
    done = mls("bench", "--sizes", "20", "--compare", "old.json", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert f"old.json: {said}" in done.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--sizes", "20", "--noise", "thesis"], "--noise: goes with --quality"),
        (["--sizes", "20", "--sigma", "1,1"], "--sigma: goes with --quality"),
        (["--sizes", "20", "--cloud", "table.txt"], "--cloud: goes with --quality"),
        (["--quality", "--compare", "old.json"], "--compare: goes with --sizes"),
        (["--quality", *TABLE, "--scenes", "planes"], "--scenes: names scenes, and --cloud"),
        (["--quality", *TABLE, "--features", "0"], "--features 0: expected 1 or more"),
        (["--quality", *TABLE, "--seeds", "0,x"], "--seeds 0,x"),
        (["--quality", "--features", "9"], "--features: goes with --cloud SCAN"),
        (["--quality", "--up", "y"], "--up: goes with --cloud SCAN"),
        (["--quality", "--sigma", "1,-1"], "--sigma 1,-1: expected two numbers"),
    ],
)
@pytest.mark.usefixtures("scans")
def test_what_does_not_go_together_is_told(options: list[str], said: str) -> None:
    result = bench(*options)
    assert isinstance(result.exception, UsageError)
    assert said in with_options(str(result.exception))
    assert result.stdout == ""
