"""Make the pictures of the gallery: ``python -m docs.gallery.make [NAME ...]``.

Names are those of the functions in `ALL`. All pictures are of synthetic scenes; figures 3.3 to 3.18
and 6.10 show the maps of `benchmarks.figures`, which prints their numbers.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw, ImageFont

from benchmarks import figures
from benchmarks.clearances import NOISES, trials
from benchmarks.clearances import mapped as with_free_space
from benchmarks.shown import Shown
from docs.gallery.render import View, render
from mlscli.config import load
from mlscli.io.writing.way import way_colours
from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.uncovering import patch_places
from mlscli.mesh import Mesh, build_mesh
from mlscli.plot import plot_above, plot_differences, plot_section
from mlscli.queries.clearance import clearance
from mlscli.runtime.arrays import Float64, UInt8
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import block, cell, cells, floor, inset, ramp, wall
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter, Scene
from mlscli.scoring.comparison import matches
from mlscli.trials.staged import mapped

FOLDER = Path(__file__).parent
MOST_BYTES = 150_000
WIDTH = 1100
CAPTION = 26
PEAK = 0.1  # a patch that is lowered by less gets no ring: it cannot be seen in a picture

Panel = tuple[str, Mesh]


# --- what is shown ---


def readme() -> None:
    """Draw a raised bridge over a creek, houses, a ruin, and red where there was no texture."""
    save("hamlet", render(build_mesh(hamlet()), WIDTH, View(68, 30)))


def overview() -> None:
    """Draw figures 2.2 and 2.3: a map without any stage, as a mesh and as patches."""
    flight = figures.cloud("bridge-walls", 1, figures.CALM)
    surface = mapped(flight, figures.stages())
    panels = [("surface", build_mesh(surface)), ("patches", build_mesh(surface, "patches"))]
    save("2.2-2.3", beside(panels, View(65, 25)))


def median() -> None:
    """Draw figures 3.3 to 3.6: without and with the median."""
    bare, filtered, harder = shown(figures.median)
    view = View(100, 22)
    save("3.3-3.4", beside(panels_of((bare, filtered)), view))
    save("3.5", beside(panels_of((bare, filtered), style="patches"), view))
    save("3.6", beside(panels_of((bare, harder)), view))


def orphans() -> None:
    """Draw figures 3.9 and 3.10: without and with orphans."""
    save("3.9-3.10", beside(panels_of(shown(figures.orphans)), View(65, 15)))


def pyramids() -> None:
    """Draw figures 3.12 and 3.13: without and with pyramids, rings where patches are lowered."""
    before, after = shown(figures.pyramids)
    was, now = matches(before.surface, after.surface)
    lower = after.surface.height[now] < before.surface.height[was] - PEAK
    rings = patch_places(before.surface)[was[lower]]
    save("3.12-3.13", beside(panels_of((before, after)), View(60, 38), rings))


def plaster() -> None:
    """Draw figure 3.17: gaps closed up to two widths, and a window."""
    save("3.17", beside(panels_of(shown(figures.plaster)), View(70, 32)))


def sparse() -> None:
    """Draw figure 3.18: sparse points, without and with plaster."""
    save("3.18", beside(panels_of(shown(figures.sparse)), View(70, 32)))


def birmensdorf() -> None:
    """Draw figures 6.2 and 6.3: a village, narrow gaps closed, and all stages from two sides."""
    partial = village(["mode=consistent", "plaster.max_gap_enhanced=0"])
    full = village(["mode=consistent"])
    panels = [("only narrow gaps closed", build_mesh(partial)), ("all stages", build_mesh(full))]
    save("6.2-6.3", beside(panels, View(62, 38)))
    save("6.3-north", render(build_mesh(full), WIDTH, View(-118, 38)))


def recordings() -> None:
    """Draw figures 6.6 and 6.7: a gym and a table, without and with the stages."""
    for name, scene, view in (("6.6", "gym", View(50, 40)), ("6.7", "table", View(65, 25))):
        flight = fly(make(scene), 0.1, seed=1)
        panels = [
            (what, build_mesh(mapped(flight, parameters)))
            for what, parameters in (
                ("no stage", figures.stages()),
                ("all stages", load("thesis", ["mode=consistent"])),
            )
        ]
        save(name, beside(panels, view))


def batches() -> None:
    """Draw figure 6.9: batches of 300 and of 80 points, in both modes."""
    for name, mode in (("6.9", "sequential"), ("6.9-consistent", "consistent")):
        one, other = (village([f"mode={mode}", f"batch.min_points={size}"]) for size in (300, 80))
        titles = (f"{mode}, batches of 300", f"{mode}, batches of 80")
        save(name, pixels(plot_differences(one, other, titles=titles)))


def gap() -> None:
    """Draw figure 6.10: a gap in a deck, closed along one axis first, the other first, and both."""
    save("6.10", beside(panels_of(shown(figures.beside_the_bridge)), View(65, 35)))


def plots() -> None:
    """Draw what ``mls plot`` draws: a hamlet from above, a house cut upright; and it as a mesh."""
    save("above", pixels(plot_above(hamlet(), title="mls plot hamlet.npz")))
    storeys = mapped(
        fly(make("house-storeys"), 0.08, figures.CALM, seed=1),
        load("default", ["map.cell_size=0.15", "map.free_space=true"]),
    )
    title = "mls plot house.npz --section -2.5,0,2.5,0"
    save("section", pixels(plot_section(storeys, (-2.5, 0), (2.5, 0), title=title)))
    save("storeys", render(build_mesh(storeys), WIDTH * 2 // 3, View(60, 25)))


def clearances() -> None:
    """Draw crafts of two sizes through a window: what they fill, in the colours of `write_way`."""
    trial = next(each for each in trials() if each.name.startswith("window"))
    surface = with_free_space(trial.scene, NOISES["sigma 0.02"], 0)
    pictures = []
    for size in (0.5, 0.9):
        title = f"mls clearance house.npz --craft {size},{size} --line 0,0.2,0.75,0,2,0.75"
        figure = plot_section(surface, (0, -0.5), (0, 2.7), title=title)
        found = clearance(surface, trial.corners, size, size)
        place, colours = found.pieces.place, way_colours(found) / 255
        for begin, end, colour in zip(place[:-1, 1], place[1:, 1], colours, strict=True):
            across = [begin + 0.5, end + 0.5]
            low, high = place[0, 2] - size / 2, place[0, 2] + size / 2
            figure.axes[0].fill_between(across, low, high, color=colour, alpha=0.6, linewidth=0)
        pictures.append(pixels(figure))
    save("clearance", np.vstack(pictures))


ALL: Sequence[Callable[[], None]] = (
    *(readme, overview, median, orphans, pyramids, plaster, sparse),
    *(birmensdorf, recordings, batches, gap, plots, clearances),
)


# --- how ---


def hamlet() -> SurfaceMap:
    """Return the map of a scene made for the README, by all default stages but the median.

    There is little noise to smooth, and the median would smooth the tops of walls as well.
    """
    scene, bed, deck = Scene("hamlet"), -0.9, 0.9
    house, eaves, ridge = (cells(14, 32), cells(8, 22)), 1.8, 2.2
    flat, roof = (cells(-38, -22), cells(6, 20)), 1.35
    hidden = inset(flat[0]), inset(flat[1])
    bare = [(cells(x, x + 5), cells(y, y + 4)) for x, y in ((20, -10), (34, -18), (-34, -8))]
    for shore in (cells(-44, -7), cells(7, 44)):
        inside = [hidden] if hidden[0][1] < shore[1] < 0 else []
        unseen = [(x, y) for x, y in bare if shore[0] <= x[0] < shore[1]]
        scene = floor(scene, shore, cells(-24, 26), 0.0, openings=inside, textureless=unseen)
    scene = floor(
        scene, cells(-8, 8), cells(-24, 26), bed, textureless=[(cells(-3, 2), cells(-17, -13))]
    )
    for x in (cell(-7.5), cell(7.5)):
        scene = wall(scene, (x, cell(-24)), (x, cell(26)), (bed, 0.0))
    scene = ramp(scene, cells(-24, -10), cells(-5, 4), (0.0, deck))
    scene = floor(scene, cells(-10, 10), cells(-5, 4), deck)
    scene = ramp(scene, cells(10, 24), cells(-5, 4), (deck, 0.0))
    scene = block(scene, *flat, (0.0, roof))
    (west, east), (south, north) = (inset(side, 0.5) for side in house)
    # Windows wider and higher than the gaps that are closed.
    windows = [(cells(left, left + 6), (0.45, 1.35)) for left in (1.5, 9.5)]
    for begin, end, openings in (
        ((west, south), (east, south), windows),
        ((west, north), (east, north), []),
        ((west, south), (west, north), [(cells(3, 10), (0.0, 1.2))]),
        ((east, south), (east, north), []),
    ):
        scene = wall(scene, begin, end, (0.0, eaves), openings=openings)
    middle = (house[0][0] + house[0][1]) / 2
    scene = ramp(scene, (house[0][0], middle), house[1], (eaves, ridge))
    scene = ramp(scene, (middle, house[0][1]), house[1], (ridge, eaves))
    scene = wall(scene, cells(-36, -14.5), cells(-20, -14.5), (0.0, 0.6))
    scene = wall(scene, (cell(-20), cell(-14.5)), (cell(-20), cell(-20)), (0.0, 0.9))
    flight = fly(scene, 0.07, Noise(sigma=Scatter(0.02, 0.02), salt_pepper=0.0), visibility=False)
    parameters = load("default", ["map.cell_size=0.15"])
    return mapped(flight, figures.only(parameters, ("orphans", "walls", "plaster", "pyramids")))


def village(settings: Sequence[str]) -> SurfaceMap:
    """Return the map of a flight over the thesis's village with little noise, by default stages.

    Parameters
    ----------
    settings : sequence of str
        Changes to the defaults, ``NAME=VALUE``.
    """
    noise = Noise(sigma=Scatter(0.03, 0.03), salt_pepper=0.05)
    flight = fly(make("village-thesis"), 0.1, noise, seed=1)
    return mapped(flight, load("default", [*settings, "map.cell_size=0.15"]))


def shown(figure: figures.Figure) -> list[Shown]:
    """Return the maps of a figure, without its claims."""
    return [row for row in figure(1) if isinstance(row, Shown)]


def panels_of(rows: Iterable[Shown], style: str = "surface") -> list[Panel]:
    """Return maps as panels: what was done, and the mesh."""
    return [
        (row.what, build_mesh(row.surface, "patches" if style == "patches" else "surface"))
        for row in rows
    ]


def beside(panels: Sequence[Panel], view: View, rings: Float64 | None = None) -> UInt8:
    """Return a picture of panels side by side, uint8 (height, `WIDTH`, 3).

    Parameters
    ----------
    panels : sequence of (str, Mesh)
        Captions and meshes.
    view : View
    rings : float64 (N, 3), optional
        Places in the map frame with a ring around them, in all panels.
    """
    width = WIDTH // len(panels)
    images = [render(mesh, width - 10, view, rings=rings) for _, mesh in panels]
    height = max(len(image) for image in images)
    page = Image.new("RGB", (WIDTH, height + CAPTION), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(size=15)
    for place, ((what, _), image) in enumerate(zip(panels, images, strict=True)):
        left = place * width + 5
        page.paste(Image.fromarray(image), (left, CAPTION + (height - len(image)) // 2))
        draw.text((left + width / 2 - 5, 4), what, fill="#222222", font=font, anchor="ma")
    return np.asarray(page)


def pixels(figure: Figure) -> UInt8:
    """Return a figure of matplotlib as a picture, uint8 (height, width, 3)."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=WIDTH / figure.get_figwidth())
    return np.asarray(Image.open(stream).convert("RGB"))


def save(name: str, image: UInt8) -> None:
    """Write a picture as PNG, in 256 colours or fewer where it would exceed `MOST_BYTES`."""
    path, picture = FOLDER / f"{name}.png", Image.fromarray(image)
    picture.save(path, optimize=True)
    for colours in (256, 128, 64, 32):
        if path.stat().st_size <= MOST_BYTES:
            break
        # Colours of few pixels, such as those of legends, count as much as those of many.
        few = picture.quantize(colours, Image.Quantize.MAXCOVERAGE, 2, dither=Image.Dither.NONE)
        few.save(path, optimize=True)
    print(path.name, path.stat().st_size)  # noqa: T201


if __name__ == "__main__":
    for job in ALL:
        if len(sys.argv) == 1 or job.__name__ in sys.argv[1:]:
            job()
