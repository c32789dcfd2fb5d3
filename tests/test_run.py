"""What `benchmarks/run.py` times beside the program does the same work; levels decide.

How one could cheat: compare with something that does more, or less, than is asked for; a level
that no figure misses; a short form that leaves out what is missed; a README that shows another.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks import run
from benchmarks.clouds import CELL, cloud
from benchmarks.process import ran
from benchmarks.table import HEAD, SHORT_HEAD, Row, Timer, lines
from benchmarks.topics.median import MEDIAN, tree_median
from benchmarks.topics.patches import GAP, lexsorted, packed_groups
from mlscli.maps.grid import Grid
from mlscli.pipeline.grouping import group

README = (Path(__file__).resolve().parent.parent / "README.md").read_text(encoding="utf-8")


def test_what_is_compared_gives_the_same_medians_and_patches() -> None:
    points = cloud(3000, 4.0)
    mine = MEDIAN.apply(points, CELL).xyz[:, 2]
    assert 1000 < len(mine) < 3000
    np.testing.assert_array_equal(mine, tree_median(points.xyz))
    surface = group(points, Grid(CELL, GAP, CELL))
    for grouped in (packed_groups, lexsorted):
        top, mean, variance = grouped(points.xyz)
        np.testing.assert_array_equal(surface.top, top)
        np.testing.assert_allclose(surface.mean, mean, atol=1e-9)
        np.testing.assert_allclose(surface.variance, variance, atol=1e-9)


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        (Row("", 30.0, "M/s", "", 10.0, 3.0, 25.0), "reached"),
        (Row("", 30.0, "M/s", "", 10.1, 3.0, 25.0), "MISSED"),
        (Row("", 24.9, "M/s", "", 1.0, 3.0, 25.0), "MISSED"),
        (Row("", 1.0, "s", "", 3.0, 3.0), "reached"),
        (Row("", 1.0, "s", "", 2.9, 3.0), "MISSED"),
        (Row("", 1.1, "", most=1.1), "reached"),
        (Row("", 1.11, "", most=1.1), "MISSED"),
        (Row("", 24.9, "M/s"), ""),
    ],
)
def test_a_level_is_missed_where_a_figure_or_a_ratio_is_on_the_wrong_side(
    row: Row, verdict: str
) -> None:
    assert row.verdict == verdict
    assert row.cells()[-1] == verdict
    assert row.short_cells("")[-2] == verdict


def test_works_take_turns_and_the_first_turn_does_not_count() -> None:
    turns: list[str] = []
    seconds = Timer(repeats=2).seconds(lambda: turns.append("a"), lambda: turns.append("b"))
    assert turns == ["a", "b"] * 3
    assert len(seconds) == 2


def test_a_process_says_its_own_time_and_memory_not_its_parents() -> None:
    mine = np.ones(40_000_000)
    small, large = (
        ran([sys.executable, "-c", f"print('done', len(bytearray({size})))"])
        for size in (1, 100_000_000)
    )
    assert small.output == "done 1\n"
    assert large.peak - small.peak == pytest.approx(100_000_000, rel=0.05)
    assert small.peak < mine.nbytes / 4
    assert small.seconds > 0.0 < small.cpu


@pytest.mark.parametrize("short", [False, True])
def test_every_row_of_a_topic_is_printed_and_the_short_form_has_those_chosen(
    short: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = [Row("one", 3.0, "s", most=2.0, short=True), Row("other", 12345.6, "M/s")]

    def rows(topic: str, timer: Timer) -> Iterator[Row]:
        assert timer == Timer(5, cpu=True)
        return iter(found if topic == "stages" else [])

    monkeypatch.setattr(run, "rows", rows)
    options = ["--topic", "stages", "--repeats", "5", "--cpu", *(["--short"] if short else [])]
    printed = CliRunner().invoke(run.main, options, catch_exceptions=False).output.splitlines()
    if short:
        command = "`python -m benchmarks.run --topic stages`"
        assert printed[2:] == [f"| one | 3 s | at most 2 | MISSED | {command} |"]
    else:
        assert printed[-2] == "| one | 3 s |  |  |  | at most 2 | MISSED |"
        assert printed[-1] == "| other | 12,346 M/s |  |  |  |  |  |"


@pytest.mark.parametrize("slow", [False, True])
def test_what_takes_minutes_is_measured_where_it_is_asked_for(
    slow: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[str] = []

    def rows(topic: str, timer: Timer) -> Iterator[Row]:
        measured.append(topic)
        assert timer.slow is slow
        return iter(())

    monkeypatch.setattr(run, "rows", rows)
    CliRunner().invoke(run.main, ["--slow"] if slow else [], catch_exceptions=False)
    assert set(run.TOPICS) - set(measured) == (set() if slow else set(run.SLOW))


def test_every_topic_has_its_module() -> None:
    folder = Path(run.__file__).parent / "topics"
    assert {path.stem for path in folder.glob("*.py")} == set(run.TOPICS)


def test_the_readme_shows_what_the_short_form_prints() -> None:
    head, line = lines(SHORT_HEAD, [])
    shown = README.partition(f"{head}\n{line}\n")[2].partition("\n\n")[0].splitlines()
    topics = set()
    for row in shown:
        what, found, level, verdict, command = row.strip("| ").split(" | ")
        assert what
        assert re.match(r"\d[\d,.e-]*( |$)", found)
        assert re.fullmatch(r"(, )?(([\d.]+ times|at (least|most) [\d.]+)(, )?)+", level)
        assert verdict in ("reached", "MISSED")
        known = re.fullmatch(r"`python -m benchmarks\.run --topic (\w+)`", command)
        assert known
        topics.add(known[1])
    not_shown = {"clouds", "exports", "machine", "meshes", "plausibility", "queries", "reading"}
    assert topics == set(run.TOPICS) - not_shown - {"sizes", *run.SLOW}
    assert len(HEAD) == len(Row("", 1.0, "").cells())
