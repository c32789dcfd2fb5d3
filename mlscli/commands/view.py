"""`mls view`: a map to look at, in the browser or in a window."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mlscli.commands.maps import the_one_map
from mlscli.commands.options import overwrite, say, tell
from mlscli.commands.piped import piped
from mlscli.commands.reading import read_points
from mlscli.errors import OutputError, UsageError

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.runtime.arrays import Float64

_PREFIX = "mls-view-"
# Pages in temporary folders are kept for a day (s).
_KEPT = 86_400.0


@click.command()
@click.argument("source", required=False, metavar="[MAP]")
@click.option(
    "--html",
    metavar="FILE",
    help="Write the page here and open nothing; by default it is a temporary file.",
)
@click.option(
    "--points",
    metavar="SOURCE",
    callback=piped,
    multiple=True,
    help="A recording whose points are shown with the map, read as the map's own was.",
)
@click.option("--window", is_flag=True, help="Open a window of Open3D instead, on a desktop.")
@overwrite
def command(
    source: str | None, html: str | None, points: tuple[str, ...], window: bool, overwrite: bool
) -> None:
    """Look at a map in the browser.

    Without MAP the one map (.npz) in the current folder is taken. The page is one file, complete in
    itself, and needs no network.
    """
    if window and (html or points):
        raise UsageError("--window: shows the map alone; leave out --html and --points")
    map_file = Path(source) if source is not None else the_one_map()

    from mlscli.io.writing.atomic import refuse_existing
    from mlscli.io.writing.npz import read_map

    if html is not None:
        refuse_existing(html, overwrite=overwrite, sources=[map_file, *points])
    surface = read_map(map_file)
    if window:
        from mlscli.view.window import show

        try:
            show(surface, map_file.name)
        except OutputError as error:
            instead = "leave out --window to see the map in the browser"
            raise OutputError(f"--window: {error}; {instead}") from error
        return

    from mlscli.view.page import write_page

    cloud = _points(surface, points) if points else None
    target = html or str(_new_folder() / f"{map_file.stem}.html")
    counts = write_page(target, surface, title=map_file.stem, points=cloud, overwrite=overwrite)
    held = ", ".join(f"{count:,} {name}" for name, count in counts.items())
    tell(f"{target}: {held}")
    if html is None:
        _open(target)


def _new_folder() -> Path:
    """Return a new temporary folder for a page; those of earlier days are removed.

    The browser reads a page after this program has ended, so that none can be removed at its end.
    """
    for old in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):
            told = old.lstat()
            is_old = told.st_mtime < time.time() - _KEPT
            if stat.S_ISDIR(told.st_mode) and told.st_uid == os.getuid() and is_old:
                shutil.rmtree(old)
    return Path(tempfile.mkdtemp(prefix=_PREFIX))


def _points(surface: SurfaceMap, sources: tuple[str, ...]) -> Float64:
    """Return the points of recordings, read with the options that the map was built with."""
    from mlscli.io.reading.recording import open_recording

    options = surface.meta.get("reading")
    if not isinstance(options, dict):
        # Another program may have written anything into it.
        options = {}
    try:
        recording = open_recording(*sources, **options)
    except (TypeError, UsageError) as error:
        given = ", ".join(f"{name} {value}" for name, value in options.items())
        raise UsageError(f"--points: read as the map's recording was ({given}): {error}") from error
    cloud = read_points(recording)
    if surface.size and len(cloud) and not _meet(surface, cloud):
        say(
            f"mls: {', '.join(sources)}: none of the points lies where the map is; they seem to "
            "be of another place, or in another frame"
        )
    return cloud


def _meet(surface: SurfaceMap, points: Float64) -> bool:
    """Return whether any of the points (N, 3) lies within the map's bounds."""
    import numpy as np

    cells = np.floor(points[:, :2] / surface.cell_size)
    low, high = (
        np.array([end(surface.ix), end(surface.iy)], dtype=float) for end in (np.min, np.max)
    )
    return bool(((cells >= low) & (cells <= high)).all(axis=1).any())


def _open(page: str) -> None:
    import webbrowser

    if not webbrowser.open(Path(page).resolve().as_uri()):
        raise OutputError(f"{page}: no browser is found to open it; open it yourself")
