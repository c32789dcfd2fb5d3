"""The whole pipeline in one pass: how its time grows with the points."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import CELL, cloud
from benchmarks.table import Row, Timer
from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Float64

SIZES = (10**6, 3 * 10**6, 10**7)


def rows(timer: Timer) -> Iterator[Row]:
    """Yield rates by the number of points, and the power of it with which time grows."""
    parameters = load(None, [f"map.cell_size={CELL}"])
    seconds = []
    for size in SIZES:
        xyz = cloud(size, 4.0).xyz
        seconds += timer.seconds(partial(build, xyz, parameters))
        yield Row(f"one pass over {size:,} points", size / seconds[-1] / 1e6, "M points/s")
    power = float(np.polyfit(np.log(SIZES), np.log(seconds), 1)[0])
    what = f"time of one pass, {SIZES[0]:,} to {SIZES[-1]:,} points: exponent"
    yield Row(what, power, "", most=1.04, short=True)


def build(xyz: Float64, parameters: Parameters) -> None:
    """Make the map of points (N, 3) in one pass."""
    builder = MapBuilder(parameters)
    builder.add(Keyframe(xyz))
    builder.finish()
