"""The how-tos: what they show runs, and prints what they show.

How one could cheat: as for the first hour, whose rules these pages keep.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.program import mls
from tests.helpers.told import agrees, steps

PAGES = sorted((Path(__file__).resolve().parent.parent / "docs/howto").glob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_prints_what_the_page_shows(page: Path, tmp_path: Path) -> None:
    shown = steps(page.read_text(encoding="utf-8"))
    assert len(shown) > 4
    for words, lines in shown:
        assert words[0] == "mls"
        done = mls(*words[1:], cwd=tmp_path)
        assert agrees(lines, done.stdout.splitlines()), (words, done.stdout, done.stderr)
