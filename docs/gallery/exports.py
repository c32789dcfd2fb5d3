"""Make the pictures of what other programs read: ``python -m docs.gallery.exports [NAME ...]``.

Names are those of the functions in `ALL`. Each picture is drawn from the files that
``mls export`` writes of the hamlet in the README, or of a house; that of the page by Chromium.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import trimesh
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont
from rosbags.highlevel import AnyReader

from benchmarks import figures
from benchmarks.clearances import NOISES, trials
from benchmarks.clearances import mapped as with_free_space
from docs.gallery.make import CAPTION, WIDTH, hamlet, pixels, save
from docs.gallery.render import View, render
from mlscli.config import load
from mlscli.io.writing.clouds import write_cloud
from mlscli.io.writing.grid_map import TYPE, write_grid_map
from mlscli.io.writing.nav2 import write_nav2
from mlscli.io.writing.octomap import write_octomap
from mlscli.io.writing.sdf import write_sdf
from mlscli.mesh import Mesh
from mlscli.rasters.robot import Robot
from mlscli.runtime.arrays import Array, UInt8
from mlscli.scenes.flight import fly
from mlscli.scenes.presets import make
from mlscli.trials.staged import mapped
from mlscli.view.page import write_page

EDGE = 8


def nav2() -> None:
    """Draw the images of the storeys."""
    with tempfile.TemporaryDirectory() as folder:
        written = write_nav2(Path(folder, "hamlet.yaml"), hamlet(), Robot(slope=30, step=0.2))
        chosen = range(min(4, len(written.sheets)))
        images = [
            (sheet.file.name, np.asarray(Image.open(sheet.file.with_suffix(".pgm"))))
            for sheet in (written.sheets[number] for number in chosen)
        ]
    save("nav2", tiled(images))


def octomap() -> None:
    """Draw an octree, cut upright through a house with storeys, and level in the lower one."""
    import pyoctomap

    flight = fly(make("house-storeys"), 0.08, figures.CALM, seed=1)
    surface = mapped(flight, load("default", ["map.cell_size=0.15", "map.free_space=true"]))
    with tempfile.TemporaryDirectory() as folder:
        write_octomap(Path(folder, "house.bt"), surface)
        tree = pyoctomap.OcTree(1.0)
        tree.readBinary(str(Path(folder, "house.bt")))
    (x0, y0, z0), (x1, y1, z1) = tree.getMetricMin(), tree.getMetricMax()
    side = tree.getResolution()
    x, y, z = (
        np.arange(low + side / 2, high, side) for low, high in ((x0, x1), (y0, y1), (z0, z1))
    )
    middle, level = (y0 + y1) / 2 + side / 2, z0 + 0.7
    upright = [[(a, middle, c) for a in x] for c in z[::-1]]
    flat = [[(a, b, level) for a in x] for b in y[::-1]]
    images = [(name, _shades(tree, places)) for name, places in (
        (f"house.bt, cut at y = {middle:.2f}", upright), (f"house.bt, cut at z = {level:.2f}", flat)
    )]  # fmt: skip
    save("octomap", tiled(images))


def pointcloud() -> None:
    """Draw patches as points, by origin and by level, walls filled; the nearest in front."""
    with tempfile.TemporaryDirectory() as folder:
        write_cloud(Path(folder, "hamlet.las"), hamlet(), filled=True)
        cloud = laspy.read(Path(folder, "hamlet.las"))
    xyz = np.asarray(cloud.xyz) @ View(68, 30).axes().T
    order = np.argsort(xyz[:, 2])
    figure = Figure(figsize=(11, 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2), ("origin", "level"), strict=True):
        values = np.asarray(cloud[name])[order]
        dots = axes.scatter(*xyz[order, :2].T, c=values, s=3, cmap="viridis")
        figure.colorbar(dots, ax=axes, ticks=np.unique(values), shrink=0.6)
        axes.set(title=f"hamlet.las: {name}", aspect="equal")
        axes.set_axis_off()
    save("pointcloud", pixels(figure))


def layers() -> None:
    """Draw the layers of a grid map, as rosbags reads them."""
    with tempfile.TemporaryDirectory() as folder:
        write_grid_map(Path(folder, "hamlet.mcap"), hamlet())
        with AnyReader([Path(folder, "hamlet.mcap")]) as reader:
            ((_, _, data),) = reader.messages()
            message: Any = reader.deserialize(data, TYPE)
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    shown = ("elevation", "elevation_1", "clearance", "count")
    for axes, name in zip(figure.subplots(2, 2).flat, shown, strict=True):
        matrix = message.data[list(message.layers).index(name)]
        image = matrix.data.reshape([each.size for each in matrix.layout.dim])[:, ::-1]
        figure.colorbar(axes.imshow(image, interpolation="nearest"), ax=axes)
        axes.set(title=name, xticks=[], yticks=[])
    save("layers", pixels(figure))


def gazebo() -> None:
    """Draw the mesh of a world, as trimesh reads it, where the world has it."""
    with tempfile.TemporaryDirectory() as folder:
        world = write_sdf(Path(folder, "hamlet.sdf"), hamlet())
        found = trimesh.load_mesh(world.files[1], process=False)
    vertices = np.asarray(found.vertices) + world.place
    colours = np.full((len(vertices), 3), (196, 178, 140), dtype=np.uint8)
    of = np.zeros(len(vertices), dtype=np.int32)
    lines, points = np.empty((0, 2), dtype=np.int32), np.empty(0, dtype=np.int32)
    faces = np.asarray(found.faces, np.int32)
    mesh = Mesh(vertices, colours, of.astype(np.uint8), faces, lines, points, of)
    save("gazebo", render(mesh, WIDTH * 2 // 3, View(68, 30)))


def _shades(tree: Any, places: Sequence[Sequence[tuple[float, float, float]]]) -> UInt8:
    """Return a picture of what a tree holds at places: black, white, and grey where unknown."""
    image = np.full((len(places), len(places[0])), 160, dtype=np.uint8)
    for row, column in np.ndindex(image.shape):
        node = tree.search(np.array(places[row][column]))
        if node is not None:
            image[row, column] = 0 if tree.isNodeOccupied(node) else 255
    return image


def page() -> None:
    """Have a browser draw the page of a house, with a craft that does not fit its window."""
    trial = next(each for each in trials() if each.name.startswith("window"))
    surface = with_free_space(trial.scene, NOISES["sigma 0.02"], 0)
    way = ",".join(f"{number:g}" for number in trial.corners.ravel())
    with tempfile.TemporaryDirectory() as folder:
        written, drawn = Path(folder, "house.html"), Path(folder, "page.png")
        write_page(written, surface, title="house")
        subprocess.run(
            [
                *("chromium", "--headless=new", "--no-sandbox", f"--user-data-dir={folder}"),
                *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
                *(f"--window-size={WIDTH},700", "--virtual-time-budget=9000"),
                f"--screenshot={drawn}",
                f"{written.as_uri()}#view=-115,22,6.5,-0.3,0.6,0.7&fit=0.9,0.9,0,{way}",
            ],
            check=True,
            capture_output=True,
        )
        save("page", np.asarray(Image.open(drawn).convert("RGB")))


ALL: Sequence[Callable[[], None]] = (nav2, octomap, pointcloud, layers, gazebo, page)


def tiled(images: Sequence[tuple[str, Array]], columns: int = 2) -> UInt8:
    """Return pictures with captions in rows, each pixel as a square of pixels."""
    width = WIDTH // columns - 2 * EDGE
    scaled = []
    for caption, image in images:
        times = max(1, width // image.shape[1])
        scaled.append((caption, image.repeat(times, axis=0).repeat(times, axis=1)))
    height = max(len(image) for _, image in scaled) + CAPTION + EDGE
    rows = -(-len(scaled) // columns)
    page = Image.new("RGB", (WIDTH, rows * height), "#dfe6ee")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(size=15)
    for number, (caption, image) in enumerate(scaled):
        top, left = number // columns * height, number % columns * (WIDTH // columns) + EDGE
        page.paste(Image.fromarray(image).convert("RGB"), (left, top + CAPTION))
        draw.text((left + image.shape[1] / 2, top + 4), caption, fill="#222222", font=font,
                  anchor="ma")  # fmt: skip
    return np.asarray(page)


if __name__ == "__main__":
    for job in ALL:
        if len(sys.argv) == 1 or job.__name__ in sys.argv[1:]:
            job()
