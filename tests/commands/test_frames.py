"""`mls build` of recordings whose clocks and transforms contradict themselves.

Ways to pass without being right: a map of some clouds, so each must be where the craft was when it
saw it; a word that does not say what is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from mlscli.io.writing.npz import read_map
from tests.helpers.bags import Told, write_told
from tests.helpers.craft import POINTS, at, recorded, run, seen, transform
from tests.helpers.program import mls


def built(folder: Path, told: Iterable[Told], *options: str) -> tuple[list[float], str]:
    """Return how far along x each cloud has been moved, in whole cells, and what was said."""
    write_told(folder / "flight.bag", told)
    sets = ("-c", "plain", "--set", "map.cell_size=1")
    done = mls("build", "flight.bag", *sets, *options, cwd=folder)
    assert done.returncode in (0, 1), done.stderr
    if done.returncode:
        return [], done.stderr
    surface = read_map(folder / "flight.npz")
    # The highest point of each cloud is the only one in its column.
    highest = surface.ix[surface.height > POINTS[:, 2].max() - 0.5]
    return sorted((highest - np.floor(POINTS[2, 0])).tolist()), done.stderr


def test_after_a_reset_each_cloud_goes_by_its_own_run(tmp_path: Path) -> None:
    moved, said = built(tmp_path, [*run(0, 0), *seen(0, 3), *run(20, 100), *seen(20, 3)])

    assert moved == [3, 103]
    assert "clock of the transforms jumps back" in said


def test_seconds_count_on_where_a_clock_jumps(tmp_path: Path) -> None:
    told = [*run(0, 0), *seen(0, 3, 7), *run(20, 100), *seen(20, 3, 7)]
    moved, said = built(tmp_path, told, "--end", "21")

    assert moved == [3, 7, 103]
    assert "--start and --end count" in said


def test_a_static_transform_that_changes_counts_from_its_stamp_on(tmp_path: Path) -> None:
    mounted = [
        recorded(transform(k, "base_link", "lidar", at(x), stays=True), k)
        for k, x in ((0, 0.0), (5, 50.0))
    ]
    clouds = seen(0, 3, 7, frame="lidar")
    moved, said = built(tmp_path, [*mounted, *run(0, 0), *clouds])

    assert moved == [3, 57]
    assert "lidar" in said


def test_of_two_robots_the_name_space_of_the_clouds_decides(tmp_path: Path) -> None:
    told = [
        *run(0, 0, topic="/one/tf"),
        *run(0, 100, topic="/two/tf"),
        *(each._replace(topic="/two/points") for each in seen(0, 3)),
    ]
    moved, said = built(tmp_path, told)

    assert moved == [103]
    assert "/one/tf" in said


def test_two_robots_on_one_topic_are_refused(tmp_path: Path) -> None:
    told = [each for pair in zip(run(0, 0), run(0, 100), strict=True) for each in pair]
    moved, said = built(tmp_path, [*told, *seen(0, 3)])

    assert moved == []
    assert said.count("\n") == 1
    assert "base_link" in said


def test_clouds_in_a_gap_of_the_transforms_are_left_out_and_counted(tmp_path: Path) -> None:
    told = [*run(0, 0), *run(0, 0, range(200, 211)), *seen(0, 3, 100, 207)]
    moved, said = built(tmp_path, told)

    assert moved == [3, 207]
    assert "1 of 3 keyframes" in said
