"""`mls bench --quality`, as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.program import mls

QUICK = ("--scenes", "planes", "--outliers", "0.1")


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


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "--quality"),
        (["--quality", "--scenes", "brigde"], "bridge"),
        (["--quality", "--outliers", "many"], "--outliers"),
        (["--quality", "--outliers", "2"], "salt-pepper"),
        (["--quality", "--seeds", "1.5"], "--seeds"),
    ],
)
def test_wrong_usage_is_one_line(tmp_path: Path, options: list[str], said: str) -> None:
    done = mls("bench", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
