"""The first hour: every command of the page runs, and prints what the page shows.

How one could cheat: to show output that was never printed, or in another order; to leave out a
command, so all of a page's commands run, in one folder, as a reader types them.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.program import mls
from tests.helpers.told import agrees, steps

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs/first-hour.md").read_text(encoding="utf-8")


def test_every_command_prints_what_the_page_shows_and_its_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(steps(PAGE)) > 12
    for words, shown in steps(PAGE):
        assert words[0] == "mls"
        done = mls(*words[1:], cwd=tmp_path)
        assert agrees(shown, done.stdout.splitlines()), (words, done.stdout, done.stderr)
        assert "internal error" not in done.stderr
    assert (tmp_path / "flight.html").stat().st_size > 0

    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "shown.py").write_text(code)
    heights = runpy.run_path("shown.py")["heights"]
    np.testing.assert_allclose(heights, [1.5, 0.0], rtol=0, atol=0.05)
    assert (tmp_path / "mesh.ply").stat().st_size > 0


def test_lines_that_were_not_printed_are_noticed() -> None:
    printed = ["a: 1", "b: 2", "c: 3"]
    assert agrees(["a: 1", "...", "c: ..."], printed)
    for wrong in (["a: 1"], ["a: 1", "...", "b: 2"], ["b: 2", "..."], ["a: 2", "..."]):
        assert not agrees(wrong, printed)
