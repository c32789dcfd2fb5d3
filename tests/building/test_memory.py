"""How much memory a build takes: points are let go as soon as they are used.

How one could cheat: so few points that what does not grow with them hides what does; points that
are dropped. What kernels allocate for themselves is not seen here, but by `benchmarks/run.py`.
"""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from benchmarks.large import CELL, write_survey
from mlscli.building.build import build_map
from mlscli.config import load
from mlscli.io.reading.recording import open_recording

POINTS, MOST = 400_000, 100


@pytest.mark.parametrize("cell_size", [str(CELL), "auto"])
def test_a_build_takes_at_most_100_bytes_a_point(tmp_path: Path, cell_size: str) -> None:
    write_survey(tmp_path / "survey.bag", POINTS)
    recording = open_recording(tmp_path / "survey.bag")
    parameters = load(None, [f"map.cell_size={cell_size}"])
    build_map(open_recording(tmp_path / "survey.bag", every=10), parameters)
    tracemalloc.start()
    try:
        surface = build_map(recording, parameters)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert surface.meta["points"]["kept"] > 0.9 * POINTS
    assert 40 * POINTS < peak < MOST * POINTS
