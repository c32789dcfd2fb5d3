"""Measure the replay of a village of 196 houses: ``python -m benchmarks.replays``.

It takes some minutes. A replay tells every state whole. Beside its size stands what its messages
hold, and how long it takes to find all that a viewer shows of one moment, with the reader of mcap.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

import click
import numpy as np
from mcap.reader import McapReader, make_reader

import mlscli
from mlscli.building.sizes import auto_cell_size
from mlscli.io.writing.bag_messages import TF
from mlscli.scenes.flight import fly
from mlscli.scenes.presets import make
from mlscli.view.replay import PATCHES, TOPICS, open_replay

MOMENTS = (0.3, 0.6, 0.95)
MEGA = 10**6


class Replayed(NamedTuple):
    """A replay, measured.

    Attributes
    ----------
    states, patches : int
        How many states it tells, and the patches of the last one.
    size, held : int
        Bytes of the file, and of its messages.
    jump : float
        Seconds until all that a viewer shows of a moment is found.
    """

    states: int
    patches: int
    size: int
    held: int
    jump: float


@click.command(help=__doc__)
@click.option("--size", default=14, show_default=True, help="Houses along each side.")
def main(size: int) -> None:
    """Build the map of the village with a replay, and print a table."""
    found = measured(size)
    print("| states | patches in the end | file | its messages | a jump |")  # noqa: T201
    print("|--:|--:|--:|--:|--:|")  # noqa: T201
    print(  # noqa: T201
        f"| {found.states:,} | {found.patches:,} | {found.size / MEGA:.1f} MB "
        f"| {found.held / MEGA:,.0f} MB | {found.jump:.1f} s |"
    )


def measured(size: int) -> Replayed:
    """Build the map of the village, so many houses along each side, with a replay."""
    keyframes = fly(make("village", size=size), 0.1, seed=0).keyframes
    points = np.concatenate([keyframe.points for keyframe in keyframes])
    parameters = mlscli.Parameters().with_cell_size(auto_cell_size(points))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "village.mcap"
        with open_replay(path) as replay:
            builder = mlscli.MapBuilder(parameters, follow=replay.follow)
            for keyframe in keyframes:
                builder.add(keyframe)
            surface = builder.finish()
            replay.finish(surface)
        with path.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            statistics, chunks = summary.statistics, summary.chunk_indexes
            states = next(
                statistics.channel_message_counts[number]
                for number, channel in summary.channels.items()
                if channel.topic == PATCHES
            )
            held = sum(chunk.uncompressed_size for chunk in chunks)
            begin, end = statistics.message_start_time, statistics.message_end_time
            jumps = [jump(reader, begin + int(part * (end - begin))) for part in MOMENTS]
        return Replayed(states, surface.size, path.stat().st_size, held, median(jumps))


def jump(reader: McapReader, moment: int) -> float:
    """Return the seconds it takes to find the latest message of each topic at a moment (ns)."""
    start = time.perf_counter()
    for topic in TOPICS.keys() - {TF}:
        next(iter(reader.iter_messages([topic], ending_at=moment, reverse=True)))
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
