"""A map in a window of Open3D, on a desktop.

Open3D is large and needs system libraries; it is imported nowhere else.
"""

from __future__ import annotations

import os
import sys
import warnings
from typing import Any

import numpy as np

from mlscli.errors import OutputError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import build_mesh

WIDTH, HEIGHT = 1200, 800

# From the south and above, as the page shows a map at first.
TOWARDS_EYE = (-0.26, -0.72, 0.64)


def show(surface: SurfaceMap, title: str) -> None:
    """Show the surfaces, walls and the route of a map until the window is closed.

    Raises
    ------
    OutputError
        Where there is no display, or Open3D cannot be loaded or cannot open a window.
    """
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    # Without a display, Open3D would wait for ever.
    if sys.platform == "linux" and not any(os.environ.get(name) for name in displays):
        raise OutputError(f"there is no display ({' and '.join(displays)} are not set)")
    open3d = _open3d()
    mesh = build_mesh(surface)
    colours = mesh.colours / 255
    # The window computes in float32: vertices far from its origin would jitter.
    places = mesh.vertices - (np.median(mesh.vertices, axis=0) if len(mesh.vertices) else 0)
    vectors = open3d.utility.Vector3dVector
    faces = open3d.geometry.TriangleMesh(
        vectors(places), open3d.utility.Vector3iVector(mesh.triangles)
    )
    faces.vertex_colors = vectors(colours)
    faces.compute_vertex_normals()
    lines = open3d.geometry.LineSet(vectors(places), open3d.utility.Vector2iVector(mesh.lines))
    lines.colors = vectors(colours[mesh.lines[:, 0]])
    window = open3d.visualization.Visualizer()
    if not window.create_window(window_name=title, width=WIDTH, height=HEIGHT):
        raise OutputError("Open3D cannot open a window on this display")
    try:
        options = window.get_render_option()
        options.mesh_show_back_face = True
        for shape in (faces, lines):
            window.add_geometry(shape)
        view = window.get_view_control()
        view.set_front(TOWARDS_EYE)
        view.set_up((0.0, 0.0, 1.0))
        window.run()
    finally:
        window.destroy_window()


def _open3d() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import open3d
        except (ImportError, OSError) as error:
            raise OutputError(
                f"Open3D cannot be loaded ({error}); pip install 'mlscli[window]'"
            ) from error
    # Keep Open3D's messages out of the program's output.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d
