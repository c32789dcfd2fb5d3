"""A map on the grid of another, by a similarity between their frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.similarity import Similarity
from mlscli.maps.cells import on_grid
from mlscli.maps.grid import Grid
from mlscli.maps.merging import linked_alone
from mlscli.maps.patches import shapes_of
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.pipeline.stages.inserted import Inserted, settle


def moved_map(surface: SurfaceMap, fit: Similarity, grid: Grid) -> SurfaceMap:
    """Return a map on another grid, its patches moved by a similarity.

    A patch goes whole into the cell in which its middle comes to lie. Measured ones that meet there
    within the gap size become one, as when maps are merged; inserted ones find room as after
    plaster. Free space is left out: what was seen through cannot be moved so.

    Parameters
    ----------
    surface : SurfaceMap
    fit : Similarity
        From its frame to that of the grid.
    grid : Grid

    Returns
    -------
    SurfaceMap
        With its route moved; no patch has a region.

    Raises
    ------
    InputError
        Where a patch comes to lie beyond all cells.
    """
    middles = np.column_stack(
        [(index + 0.5) * surface.cell_size for index in (surface.ix, surface.iy)]
        + [np.zeros(surface.size)]
    )
    places = fit.points(middles)
    if not on_grid(places, grid.cell_size).all():
        raise InputError(
            "patches come to lie beyond all cells; the scale or the shift is too large"
        )
    ix, iy = np.floor(places[:, :2] / grid.cell_size).astype(np.int32).T
    scale, up = fit.scale, fit.shift[2]
    top, bottom = scale * surface.top + up, scale * surface.bottom + up
    mean = np.clip(scale * surface.mean + up, bottom, top)
    variance = scale**2 * surface.variance
    height, depth = scale * surface.height + up, scale * surface.depth
    # What no stage has moved beyond its points is shaped anew, for the thickness of the grid.
    kept = np.flatnonzero((surface.origin == MEASURED) & (surface.moved == 0))
    height[kept], depth[kept] = shapes_of(
        top[kept], bottom[kept], mean[kept], variance[kept], grid.thickness
    )
    route = surface.route.copy()
    route[:, 1:] = fit.points(route[:, 1:])
    columns = surface.columns | {
        "ix": np.ascontiguousarray(ix),
        "iy": np.ascontiguousarray(iy),
        "height": height,
        "depth": depth,
        "top": top,
        "bottom": bottom,
        "mean": mean,
        "variance": variance,
        "noise": (scale**2 * surface.noise).astype(np.float32),
        "region": np.full(surface.size, -1, dtype=np.int32),
    }
    whole = SurfaceMap.of(grid, columns, route, dict(surface.meta))
    measured = linked_alone(whole.take(whole.origin == MEASURED).sorted())
    others = whole.take(whole.origin != MEASURED)
    inserted = Inserted(others.ix, others.iy, others.height, others.depth, others.origin)
    return replace(measured.with_inserted(*settle(inserted, measured)), free=None)
