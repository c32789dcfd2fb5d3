"""The calls that the README shows: what they take, and what a wrong type is answered with.

How one could cheat: to take a path and lose the options of a recording, or an array and change
it; to refuse what is almost right with the words of whatever failed first. So maps of a path, a
recording and an array are held against each other, and wrong types must be TypeErrors that name
the argument and what would be right.
"""

from __future__ import annotations

import copy
import inspect
import pickle
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial, wraps
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mlscli
from mlscli.errors import ConfigError, UsageError
from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change
from mlscli.maps.merging import merge_maps
from mlscli.pipeline.parameters import MapParameters, Vehicle
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.queries.exploration import Camera
from mlscli.runtime.arrays import Float64
from mlscli.scoring import (
    compare_maps,
    score,
    score_columns,
    score_mesh,
    score_scan,
    seen_by,
)
from tests.helpers.maps import Patch, map_of

SAMPLE = Path(__file__).resolve().parent.parent / "data/samples/bridge.txt"
SURFACE = map_of([Patch(0, 0, 0.0, 0.0, 0, 1), Patch(0, 1, 0.1, 0.0, 0, 2)])
SCAN: Float64 = np.array([(0.2, 0.2, 0.0), (0.2, 0.8, 0.1)])
EDGE = mlscli.Parameters().with_cell_size(0.5)


def enter(opens: Callable[..., AbstractContextManager[object]]) -> Callable[..., object]:
    """Return a function that opens what another returns, with its signature."""

    @wraps(opens)
    def opened(**arguments: object) -> object:
        with opens(**arguments) as value:
            return value

    return opened


# --- what builds a map ---


def test_a_path_a_recording_and_its_points_make_one_map() -> None:
    recording = mlscli.open_recording(SAMPLE)
    expected = mlscli.build_map(recording, EDGE)
    assert mlscli.build_map(SAMPLE, EDGE) == expected
    assert mlscli.build_map(str(SAMPLE), EDGE) == expected
    points = np.concatenate([keyframe.points for keyframe in recording])
    surface = mlscli.build_map(points, EDGE)
    # All points are one keyframe there.
    assert surface.columns.keys() == expected.columns.keys()
    for name in set(surface.columns) - {"first_keyframe", "last_keyframe"}:
        np.testing.assert_array_equal(surface.columns[name], expected.columns[name])
    assert surface.meta["sources"] == ["array"]
    assert surface.meta["points"]["read"] == len(points)


def test_what_is_masked_is_dropped_and_counted() -> None:
    mask = np.zeros((4, 3), dtype=np.bool_)
    mask[1, 2] = mask[3] = True
    recording = mlscli.open_recording(np.ma.array(np.ones((4, 3)), mask=mask))
    assert [len(keyframe.points) for keyframe in recording] == [2]
    assert recording.tally.points_read == 4


def test_an_array_may_be_changed_once_it_is_opened() -> None:
    points: Float64 = np.ones((4, 3))
    recording = mlscli.open_recording(points)
    points[:] = 7.0
    (keyframe,) = recording
    assert (keyframe.points == 1.0).all()


def test_points_in_memory_are_accounted_for_and_left_as_they_are() -> None:
    points: Float64 = np.array([[0, 0, 1], [0.1, 0, np.nan], [0.2, 0, 1e9], [0.3, 0.1, 1.1]])
    before = points.copy()
    recording = mlscli.open_recording(points, up="-z")
    (keyframe,) = recording
    np.testing.assert_array_equal(keyframe.points, [[0, 0, -1], [0.3, -0.1, -1.1]])
    assert recording.tally.points_read == 4
    assert sum(recording.tally.dropped.values()) == 2
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize("dtype", [np.float32, np.int64, np.uint8, np.float64])
def test_points_are_of_any_numbers(dtype: type) -> None:
    points: Float64 = np.array([[1, 2, 3], [4, 5, 6]], dtype=dtype)
    (keyframe,) = mlscli.open_recording(points)
    assert keyframe.points.dtype == np.float64
    assert keyframe.points.tolist() == points.tolist()


@pytest.mark.parametrize(
    "points", [np.zeros(3), np.zeros((3, 4)), np.zeros((2, 3), complex), np.full((2, 3), "1")]
)
def test_an_array_of_something_else_is_refused(points: Any) -> None:
    with pytest.raises(UsageError, match=r"shape \(.*\) and dtype .*; expected .* \(N, 3\)"):
        mlscli.build_map(points)


def test_a_recording_is_iterated_as_often_as_needed() -> None:
    recording = mlscli.open_recording(SAMPLE)
    first, again = ([keyframe.stamp for keyframe in recording] for _ in range(2))
    assert first == again == [keyframe.stamp for keyframe in recording.keyframes()]


# --- what is written ---


@pytest.mark.parametrize("kind", ["ply", "obj", "glb"])
def test_a_map_is_written_as_the_mesh_of_it(kind: str, tmp_path: Path) -> None:
    write: Callable[..., None] = getattr(mlscli, f"write_{kind}")
    folders = [tmp_path / "map", tmp_path / "mesh"]
    for folder, shape in zip(folders, (SURFACE, mlscli.build_mesh(SURFACE)), strict=True):
        folder.mkdir()
        write(folder / f"a.{kind}", shape)
    first, second = ((folder / f"a.{kind}").read_bytes() for folder in folders)
    assert first == second


# --- wrong types ---

WRONG: list[tuple[Callable[[Path], object], str, str]] = [
    (lambda _: mlscli.build_map(1), "source", "points as an array"),  # type: ignore[arg-type]
    (lambda _: mlscli.open_recording(3.5), "sources", "path"),  # type: ignore[arg-type]
    (lambda _: mlscli.open_recording(SAMPLE, frame=5), "frame", "a text"),  # type: ignore[arg-type]
    (lambda _: mlscli.open_recording(SAMPLE, every="2"), "every", "whole"),  # type: ignore[arg-type]
    (lambda _: mlscli.open_recording(SAMPLE, crop="0,1"), "crop", "numbers"),  # type: ignore[arg-type]
    (lambda _: mlscli.build_map(SAMPLE, {}), "parameters", "Parameters"),  # type: ignore[arg-type]
    (lambda _: mlscli.MapBuilder("a.yaml"), "parameters", "Parameters"),  # type: ignore[arg-type]
    (lambda _: mlscli.build_mesh("a.npz"), "surface", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_ply(to / "a", 1), "mesh", "Mesh"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_obj(to / "a", 1), "mesh", "Mesh"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_glb(to / "a", 1), "mesh", "Mesh"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_map(to / "a", 1), "surface", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_page(to / "a", 1), "surface", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda to: mlscli.write_replay(to / "a", 1, []), "surface", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda _: merge_maps(SURFACE, 1), "other", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda _: compare_maps(SURFACE, 1), "b", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda _: score(1, SURFACE), "surface", "SurfaceMap"),  # type: ignore[arg-type]
    (lambda _: mlscli.Parameters(vehicle={"width": 1}), "vehicle", "Vehicle"),  # type: ignore[arg-type]
    (lambda _: mlscli.Parameters(map=0.5), "map", "MapParameters"),  # type: ignore[arg-type]
    (lambda _: mlscli.Parameters(pipeline=("median",)), "pipeline", "Median"),  # type: ignore[arg-type]
    (lambda _: mlscli.Parameters(pipeline=1), "pipeline", "Median"),  # type: ignore[arg-type]
    (lambda _: mlscli.build_map(SAMPLE, EDGE, jobs="2"), "jobs", "whole number"),  # type: ignore[arg-type]
    (lambda _: mlscli.fit_sizes([np.ones((3, 3))]), "clouds", "keyframes"),  # type: ignore[list-item]
    (lambda _: mlscli.MapBuilder(EDGE).add(np.ones((3, 3))), "keyframe", "Keyframe"),  # type: ignore[arg-type]
    (lambda _: SURFACE.with_columns(height=[1.0, 2.0]), "height", "an array"),
]


@pytest.mark.parametrize(("call", "argument", "right"), WRONG)
def test_a_wrong_type_is_refused_with_what_is_right(
    call: Callable[[Path], object], argument: str, right: str, tmp_path: Path
) -> None:
    with pytest.raises(TypeError) as refusal:
        call(tmp_path)
    assert str(refusal.value).startswith(f"`{argument}`: found ")
    assert right in str(refusal.value).partition("; expected ")[2]
    assert not list(tmp_path.iterdir())


# --- wrong types, of every argument ---

# Functions with arguments that are right.
CALLS: dict[str, tuple[Callable[..., object], dict[str, object]]] = {
    "build_map": (mlscli.build_map, {"source": SAMPLE, "parameters": EDGE}),
    "fit_sizes": (mlscli.fit_sizes, {"clouds": SCAN}),
    "open_recording": (partial(mlscli.open_recording, SAMPLE), {}),
    "load_parameters": (mlscli.load_parameters, {}),
    "read_map": (mlscli.read_map, {}),
    "write_map": (mlscli.write_map, {"path": "a", "surface": SURFACE}),
    "write_ply": (mlscli.write_ply, {"path": "a", "mesh": SURFACE}),
    "write_obj": (mlscli.write_obj, {"path": "a", "mesh": SURFACE}),
    "write_glb": (mlscli.write_glb, {"path": "a", "mesh": SURFACE}),
    "write_nav2": (mlscli.write_nav2, {"path": "a.yaml", "surface": SURFACE}),
    "write_octomap": (mlscli.write_octomap, {"path": "a", "surface": SURFACE}),
    "write_cloud": (mlscli.write_cloud, {"path": "a.pcd", "surface": SURFACE}),
    "write_grid_map": (mlscli.write_grid_map, {"path": "a", "surface": SURFACE}),
    "write_layers": (mlscli.write_layers, {"path": "a", "surface": SURFACE, "kind": "npz"}),
    "to_pandas": (mlscli.to_pandas, {"surface": SURFACE}),
    "to_xarray": (mlscli.to_xarray, {"surface": SURFACE}),
    "write_sdf": (mlscli.write_sdf, {"path": "a.sdf", "mesh": SURFACE}),
    "write_page": (mlscli.write_page, {"path": "a", "surface": SURFACE}),
    "write_replay": (mlscli.write_replay, {"path": "a", "surface": SURFACE, "changes": []}),
    "open_replay": (enter(mlscli.open_replay), {"path": "a"}),
    "build_mesh": (mlscli.build_mesh, {"surface": SURFACE}),
    "plot_above": (mlscli.plot_above, {"surface": SURFACE}),
    "plot_section": (
        mlscli.plot_section,
        {"surface": SURFACE, "start": (0.2, 0.2), "end": (0.2, 0.8)},
    ),
    "plot_differences": (mlscli.plot_differences, {"one": SURFACE, "other": SURFACE}),
    "write_figure": (
        mlscli.write_figure,
        {"path": "a.png", "figure": mlscli.plot_above(SURFACE)},
    ),
    "levels_at": (mlscli.levels_at, {"surface": SURFACE, "xy": SCAN[:, :2]}),
    "clearance": (
        mlscli.clearance,
        {"surface": SURFACE, "polyline": SCAN, "width": 0.2, "height": 0.1},
    ),
    "explore": (
        mlscli.explore,
        {"surface": SURFACE, "width": 0.2, "height": 0.1, "camera": Camera(), "most": 1},
    ),
    "space_at": (mlscli.space_at, {"surface": SURFACE, "xyz": SCAN}),
    "height_at": (mlscli.height_at, {"surface": SURFACE, "xy": SCAN[:, :2]}),
    "align_maps": (mlscli.align_maps, {"one": SURFACE, "other": SURFACE}),
    "merge_maps": (mlscli.merge_maps, {"one": SURFACE, "other": SURFACE}),
    "compare_maps": (compare_maps, {"a": SURFACE, "b": SURFACE}),
    "score": (score, {"surface": SURFACE, "truth": SURFACE}),
    "score_scan": (score_scan, {"surface": SURFACE, "scan": SCAN}),
    "score_mesh": (score_mesh, {"mesh": mlscli.build_mesh(SURFACE), "scan": SCAN, "within": 1.0}),
    "score_columns": (score_columns, {"surface": SURFACE, "scan": SCAN, "within": 1.0}),
    "seen_by": (seen_by, {"flight": SCAN, "scan": SCAN, "within": 1.0}),
    "Parameters": (mlscli.Parameters, {}),
    "Grid": (mlscli.Grid, {"cell_size": 1.0, "gap_size": 1.0, "thickness": 1.0}),
    "MapBuilder": (mlscli.MapBuilder, {"parameters": EDGE}),
    "add": (mlscli.MapBuilder(EDGE).add, {}),
    "process_cloud": (mlscli.MapBuilder(EDGE).process_cloud, {}),
    "of": (mlscli.SurfaceMap.of, {"grid": SURFACE.grid}),
    "take": (SURFACE.take, {}),
    "union": (SURFACE.union, {}),
    "crop": (SURFACE.crop, {}),
    "in_cells": (SURFACE.in_cells, {}),
    "replace": (SURFACE.replace, {"cells": CellSet.of(SURFACE.ix, SURFACE.iy), "other": SURFACE}),
}
# Whatever counts as true is taken as True; the mode is a value of a configuration, see below.
OTHERS = {
    "artificial",
    "as_recorded",
    "cumulative",
    "filled",
    "latest",
    "overwrite",
    "whole",
    "mode",
}


def arguments(call: Callable[..., object]) -> list[str]:
    named = inspect.signature(call).parameters.values()
    return [a.name for a in named if a.kind is not a.VAR_POSITIONAL and a.name not in OTHERS]


@pytest.mark.parametrize(
    ("name", "argument"), [(name, a) for name in CALLS for a in arguments(CALLS[name][0])]
)
def test_what_no_function_takes_is_refused_by_each_for_every_argument(
    name: str, argument: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    call, right = CALLS[name]
    with pytest.raises(TypeError, match=f"^`{argument}`: found object; expected ."):
        call(**right | {argument: object()})
    assert not list(tmp_path.iterdir())


def test_every_public_function_is_among_those() -> None:
    public = {name for name in mlscli.__all__ if callable(getattr(mlscli, name))}
    assert public - {"SurfaceMap", "MlsError"} <= CALLS.keys()


@pytest.mark.parametrize(
    "call",
    [
        lambda: mlscli.load_parameters(sets="map.cell_size=0.2"),
        lambda: mlscli.MapBuilder(EDGE, sources="a.bag"),
    ],
)
def test_a_text_is_no_list_of_texts(call: Callable[[], object]) -> None:
    with pytest.raises(TypeError, match=r"^`s[a-z]*`: found the text '.*'; expected a list of "):
        call()


@pytest.mark.parametrize("points", ["abc", [["a", 1.0, 2.0]], [[1.0, 2.0, 3.0], [1.0]]])
def test_a_cloud_of_no_numbers_is_refused(points: Any) -> None:
    with pytest.raises((TypeError, UsageError), match=r"^`points`: .* an array \(N, 3\)"):
        mlscli.MapBuilder(EDGE).process_cloud(points)


def test_stages_are_taken_from_whatever_yields_them() -> None:
    stages = (Median(), Orphans())
    assert mlscli.Parameters(pipeline=iter(stages)).pipeline == stages  # type: ignore[arg-type]


def test_jobs_and_points_that_are_none_are_wrong_usage() -> None:
    with pytest.raises(UsageError, match=r"^`jobs` 0: expected a whole number of at least 1"):
        mlscli.build_map(SAMPLE, EDGE, jobs=0)
    for shape in ((30, 4), (12, 5, 3), (3,)):
        words = re.escape(f"`points`: found an array of shape {shape}; expected (N, 3)")
        with pytest.raises(UsageError, match=f"^{words}$"):
            mlscli.MapBuilder(EDGE).process_cloud(np.ones(shape))


@pytest.mark.parametrize(
    ("parameters", "fault"),
    [
        (mlscli.Parameters(map=MapParameters(cell_size=-1.0)), "map.cell_size"),
        (mlscli.Parameters(Vehicle("wide"), map=MapParameters(1.0)), "mode"),  # type: ignore[arg-type]
        (mlscli.Parameters(vehicle=Vehicle("wide"), map=MapParameters(1.0)), "vehicle.width"),  # type: ignore[arg-type]
    ],
)
def test_values_out_of_range_are_refused_before_a_map_is_made(
    parameters: mlscli.Parameters, fault: str
) -> None:
    with pytest.raises(ConfigError) as refusal:
        mlscli.MapBuilder(parameters)
    assert refusal.value.faults[0].startswith(f"{fault}: found ")


# --- what a map holds ---


def test_the_arrays_of_a_map_are_read_only_however_it_was_made(tmp_path: Path) -> None:
    mlscli.write_map(tmp_path / "a.npz", SURFACE)
    changes: list[Change] = []
    built = mlscli.build_map(SAMPLE, EDGE, follow=changes.append)
    maps = [
        SURFACE,
        mlscli.read_map(tmp_path / "a.npz"),
        built,
        built.crop(min_x=0),
        built.union(SURFACE),
        merge_maps(SURFACE, SURFACE),
        changes[0].added,
        copy.deepcopy(built),
        pickle.loads(pickle.dumps(built, protocol=2)),
    ]
    for surface in maps:
        for name, column in {**surface.columns, "route": surface.route}.items():
            assert not column.flags.writeable, name
    with pytest.raises(ValueError, match="read-only"):
        built.height[0] = 0.0
