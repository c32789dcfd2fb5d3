"""Fixtures that tests of reading and writing share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.texts import text


@pytest.fixture
def timed(tmp_path: Path) -> Path:
    """Return a text of six keyframes, one point each, half a second apart."""
    rows = [f"{k},0,0,{k},{100 + k / 2}\n" for k in range(6)]
    return text(tmp_path, "x,y,z,keyframe,t\n" + "".join(rows), "timed.txt")
