"""Multi-level surface maps and meshes from recorded drone flights.

The names below are loaded when they are first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mlscli.errors import MlsError
from mlscli.maps.display import shown_by
from mlscli.version import __version__

if TYPE_CHECKING:
    from mlscli.aligning.fit import align_maps
    from mlscli.building.build import build_map
    from mlscli.building.builder import MapBuilder
    from mlscli.building.sizes import fit_sizes
    from mlscli.config import load as load_parameters
    from mlscli.io.reading.recording import open_recording
    from mlscli.io.writing.clouds import write_cloud
    from mlscli.io.writing.glb import write_glb
    from mlscli.io.writing.grid_map import write_grid_map
    from mlscli.io.writing.nav2 import write_nav2
    from mlscli.io.writing.npz import read_map, write_map
    from mlscli.io.writing.obj import write_obj
    from mlscli.io.writing.octomap import write_octomap
    from mlscli.io.writing.ply import write_ply
    from mlscli.io.writing.raster import write_layers
    from mlscli.io.writing.sdf import write_sdf
    from mlscli.maps.grid import Grid
    from mlscli.maps.merging import merge_maps
    from mlscli.maps.space import space_at
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.mesh import build_mesh
    from mlscli.pipeline.parameters import Parameters
    from mlscli.plot import plot_above, plot_differences, plot_section, write_figure
    from mlscli.queries.clearance import clearance
    from mlscli.queries.explore import explore
    from mlscli.queries.levels import height_at, levels_at
    from mlscli.rasters.tables import to_pandas, to_xarray
    from mlscli.view.page import write_page
    from mlscli.view.replay import open_replay, write_replay

__all__ = [
    "Grid",
    "MapBuilder",
    "MlsError",
    "Parameters",
    "SurfaceMap",
    "__version__",
    "align_maps",
    "build_map",
    "build_mesh",
    "clearance",
    "explore",
    "fit_sizes",
    "height_at",
    "levels_at",
    "load_parameters",
    "merge_maps",
    "open_recording",
    "open_replay",
    "plot_above",
    "plot_differences",
    "plot_section",
    "read_map",
    "space_at",
    "to_pandas",
    "to_xarray",
    "write_cloud",
    "write_figure",
    "write_glb",
    "write_grid_map",
    "write_layers",
    "write_map",
    "write_nav2",
    "write_obj",
    "write_octomap",
    "write_page",
    "write_ply",
    "write_replay",
    "write_sdf",
]

shown_by("mlscli.plot.inline", "html_of")

_HOMES = {
    "Grid": ("mlscli.maps.grid", "Grid"),
    "MapBuilder": ("mlscli.building.builder", "MapBuilder"),
    "Parameters": ("mlscli.pipeline.parameters", "Parameters"),
    "SurfaceMap": ("mlscli.maps.surface_map", "SurfaceMap"),
    "align_maps": ("mlscli.aligning.fit", "align_maps"),
    "build_map": ("mlscli.building.build", "build_map"),
    "fit_sizes": ("mlscli.building.sizes", "fit_sizes"),
    "load_parameters": ("mlscli.config", "load"),
    "build_mesh": ("mlscli.mesh", "build_mesh"),
    "clearance": ("mlscli.queries.clearance", "clearance"),
    "explore": ("mlscli.queries.explore", "explore"),
    "height_at": ("mlscli.queries.levels", "height_at"),
    "levels_at": ("mlscli.queries.levels", "levels_at"),
    "merge_maps": ("mlscli.maps.merging", "merge_maps"),
    "open_recording": ("mlscli.io.reading.recording", "open_recording"),
    "open_replay": ("mlscli.view.replay", "open_replay"),
    "plot_above": ("mlscli.plot", "plot_above"),
    "plot_differences": ("mlscli.plot", "plot_differences"),
    "plot_section": ("mlscli.plot", "plot_section"),
    "write_figure": ("mlscli.plot", "write_figure"),
    "read_map": ("mlscli.io.writing.npz", "read_map"),
    "space_at": ("mlscli.maps.space", "space_at"),
    "write_cloud": ("mlscli.io.writing.clouds", "write_cloud"),
    "write_glb": ("mlscli.io.writing.glb", "write_glb"),
    "write_map": ("mlscli.io.writing.npz", "write_map"),
    "write_grid_map": ("mlscli.io.writing.grid_map", "write_grid_map"),
    "to_pandas": ("mlscli.rasters.tables", "to_pandas"),
    "to_xarray": ("mlscli.rasters.tables", "to_xarray"),
    "write_layers": ("mlscli.io.writing.raster", "write_layers"),
    "write_nav2": ("mlscli.io.writing.nav2", "write_nav2"),
    "write_obj": ("mlscli.io.writing.obj", "write_obj"),
    "write_octomap": ("mlscli.io.writing.octomap", "write_octomap"),
    "write_page": ("mlscli.view.page", "write_page"),
    "write_ply": ("mlscli.io.writing.ply", "write_ply"),
    "write_replay": ("mlscli.view.replay", "write_replay"),
    "write_sdf": ("mlscli.io.writing.sdf", "write_sdf"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
