"""A second flight added to a map.

How one could cheat: to merge the finished maps, which is not what one build gives; to read the
second recording with parameters of its own; to lose the counts, the route, or what was seen through
in the first flight; to say that points were kept where they were not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.building.build import build
from mlscli.building.onto import Earlier, build_onto, parameters_of
from mlscli.config import loads
from mlscli.errors import InputError, UsageError
from mlscli.io.reading.recording import Recording, open_recording
from mlscli.io.writing.npz import read_map, read_points, write_map
from mlscli.maps.change import Change
from mlscli.maps.merging import merge_maps
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Float64
from tests.helpers.program import mls

PLAIN = Parameters().with_cell_size(0.5)


def clouds(seed: int, sizes: tuple[int, int]) -> list[Float64]:
    """Return two clouds that overlap: a floor, a wall, and outliers."""
    rng = np.random.default_rng(seed)
    both = []
    for size in sizes:
        points = rng.uniform((0, 0, 0), (5, 5, 0.2), (size, 3))
        points[::7, 2] = rng.uniform(0, 2.5, len(points[::7]))
        points[::7, 0] = 2.2
        both.append(np.round(points, 2))
    return both


def flights(folder: Path) -> tuple[Path, Path]:
    """Write two flights with positions, in texts."""
    paths = []
    for name, cloud in zip("ab", clouds(3, (400, 300)), strict=True):
        paths.append(folder / f"{name}.txt")
        rows = [f"{x} {y} {z} {k // 50} {x / 2} 1 6" for k, (x, y, z) in enumerate(cloud.tolist())]
        paths[-1].write_text("x y z keyframe cx cy cz\n" + "\n".join(rows) + "\n")
    return paths[0], paths[1]


def earlier_of(recording: Recording, parameters: Parameters, *, keep: bool = True) -> Earlier:
    made = build(recording, parameters, keep_points=keep)
    return Earlier("a.npz", made.surface, made.points)


@settings(max_examples=15)
@given(seed=st.integers(0, 99), sizes=st.tuples(st.integers(30, 300), st.integers(1, 300)))
def test_with_its_points_a_map_is_that_of_both_recordings_built_as_one(
    seed: int, sizes: tuple[int, int]
) -> None:
    one, other = clouds(seed, sizes)
    earlier = earlier_of(open_recording(one), PLAIN)
    added = build_onto(earlier, open_recording(other), parameters_of(earlier))
    assert added.surface == build(open_recording(one, other), PLAIN).surface


@pytest.mark.parametrize("mode", ["consistent", "sequential"])
def test_route_free_space_and_counts_are_those_of_one_build(mode: str, tmp_path: Path) -> None:
    a, b = flights(tmp_path)
    text = f"mode: {mode}\nmap: {{cell_size: 0.5, free_space: true}}\nbatch: {{min_points: 80}}"
    parameters = loads(text)
    crop = (0.0, 5.0, 0.0, 5.0, -1.0, 2.0)
    earlier = earlier_of(open_recording(a, crop=crop), parameters)
    write_map(tmp_path / "a.npz", earlier.surface, points=earlier.points)
    again = Earlier("a.npz", read_map(tmp_path / "a.npz"), read_points(tmp_path / "a.npz"))
    second = open_recording(b, crop=crop)
    added = build_onto(again, second, parameters_of(again), keep_points=True)
    both = build(open_recording(a, b, crop=crop), parameters, keep_points=True)
    assert added.surface == both.surface
    assert added.surface.free is not None
    np.testing.assert_array_equal(added.surface.route, both.surface.route)
    for name in ("points", "keyframes", "batches", "sources", "reading", "parameters"):
        assert added.surface.meta[name] == both.surface.meta[name]
    assert added.points is not None
    assert both.points is not None
    np.testing.assert_array_equal(added.points.xyz, both.points.xyz)
    assert added.points[2:] == both.points[2:]
    assert added.surface.meta["onto"] == [{"map": "a.npz", "by": "points"}]


def test_without_its_points_a_map_grows_on_as_the_sequential_mode_does(tmp_path: Path) -> None:
    a, b = flights(tmp_path)
    # A batch for each keyframe: none holds keyframes of both.
    text = "mode: sequential\nmap: {cell_size: 0.5, free_space: true}\nbatch: {min_points: 1}"
    parameters = loads(text)
    earlier = earlier_of(open_recording(a), parameters, keep=False)
    added = build_onto(earlier, open_recording(b), parameters_of(earlier))
    both = build(open_recording(a, b), parameters).surface
    assert added.surface == both
    np.testing.assert_array_equal(added.surface.route, both.route)
    for name in ("points", "keyframes", "batches", "sources"):
        assert added.surface.meta[name] == both.meta[name]
    assert added.surface != merge_maps(earlier.surface, build(open_recording(b), parameters)[0])
    assert (
        earlier.how == "a.npz, which kept no points: batch by batch, as the sequential mode merges"
    )
    with pytest.raises(UsageError, match=r"`keep_points`: a.npz kept no points"):
        build_onto(earlier, open_recording(b), parameters, keep_points=True)


@pytest.mark.parametrize("keep", [True, False])
def test_who_follows_sees_the_map_become_that_of_both(keep: bool, tmp_path: Path) -> None:
    a, b = flights(tmp_path)
    parameters = loads("map: {cell_size: 0.5}\nbatch: {min_points: 50}\npipeline: [plaster: {}]")
    earlier = earlier_of(open_recording(a), parameters, keep=keep)
    changes: list[Change] = []
    added = build_onto(earlier, open_recording(b), parameters, follow=changes.append).surface
    grown = added.take(np.arange(0))
    for change in changes:
        grown = change.applied_to(grown)
    assert replace(grown, route=added.route) == added
    np.testing.assert_array_equal(np.concatenate([each.route for each in changes]), added.route)
    assert len(changes) > 3


def test_other_parameters_are_refused_and_named() -> None:
    earlier = earlier_of(open_recording(clouds(1, (200, 1))[0]), PLAIN)
    assert parameters_of(earlier) == parameters_of(earlier, "default")
    for given_settings, fault in (
        (("map.cell_size=0.25",), "map.cell_size 0.25, where it has 0.5"),
        (
            ("median.min_nb=3", "walls.join=1"),
            "median.min_nb 3, where it has 4; walls.join 1.0, where it has 2 cells",
        ),
        (("map.free_space=true",), "map.free_space True, where it has False"),
    ):
        with pytest.raises(UsageError, match=f"a.npz: was built with other parameters.*{fault}"):
            parameters_of(earlier, settings=given_settings)
    with pytest.raises(UsageError, match=r"stages none, where it has rays, median,"):
        parameters_of(earlier, "plain")
    for meta in ({}, {"parameters": {"map": {"cells": 1}}}, {"parameters": 5}):
        broken = earlier._replace(surface=replace(earlier.surface, meta=meta))
        with pytest.raises(InputError, match="meta holds no parameters that are valid here"):
            parameters_of(broken)


def test_recordings_of_other_frames_and_places_are_refused() -> None:
    cloud = clouds(1, (200, 1))[0]
    placed = open_recording(cloud, crs="EPSG:32632")
    earlier = earlier_of(placed, PLAIN)
    assert build_onto(earlier, open_recording(cloud), PLAIN).surface.meta["georeference"]
    with pytest.raises(UsageError, match=r"array onto a.npz: maps that were turned in different"):
        build_onto(earlier, open_recording(cloud, up="y"), PLAIN)
    with pytest.raises(UsageError, match=r"array onto a.npz: maps that lie in different places"):
        build_onto(earlier, open_recording(cloud, crs="EPSG:32633"), PLAIN)


def test_points_beside_a_map_are_checked(tmp_path: Path) -> None:
    made = build(open_recording(clouds(1, (200, 1))[0]), PLAIN, keep_points=True)
    file = tmp_path / "a.npz"
    write_map(file, made.surface)
    assert read_points(file) is None
    assert made.points is not None
    for wrong, fault in (
        (made.points._replace(sizes=made.points.sizes + 1), "points_sizes: holds 201 points"),
        (made.points._replace(sizes=np.array([-1])), "points_sizes: holds -1 points"),
        (made.points._replace(sizes=np.array([100, 100])), r"points_sizes: has shape \(2,\)"),
        (made.points._replace(xyz=made.points.xyz[:, :2]), "points_xyz: has shape"),
    ):
        write_map(file, made.surface, points=wrong, overwrite=True)
        with pytest.raises(InputError, match=f"a.npz: {fault}"):
            read_points(file)


def test_the_command_adds_a_flight_and_says_how(tmp_path: Path) -> None:
    a, b = flights(tmp_path)
    made = build(open_recording(a), PLAIN, keep_points=True)
    write_map(tmp_path / "kept.npz", made.surface, points=made.points)
    write_map(tmp_path / "bare.npz", made.surface)
    done = mls("build", "b.txt", "--onto", "kept.npz", "-o", "both.npz", cwd=tmp_path)
    assert "onto       kept.npz, by its points: as if both had been built together" in done.stdout
    assert read_map(tmp_path / "both.npz") == build(open_recording(a, b), PLAIN).surface
    refused = mls("build", "b.txt", "--onto", "bare.npz", "--memory", "2G", cwd=tmp_path)
    assert refused.stderr == (
        "mls: --onto: does not go with --memory, as the points of the map are held in memory; "
        "leave it out\n"
    )
    refused = mls("build", "b.txt", "--onto", "bare.npz", "--jobs", "2", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith("mls: --jobs: bare.npz kept no points, so that")
