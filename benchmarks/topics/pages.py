"""The page of half a million triangles, in a headless browser that draws in software."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from benchmarks.pages import FIRST, measured, village
from benchmarks.table import Row, Timer
from mlscli.io.writing.glb import write_glb
from mlscli.view.page import write_page
from tests.helpers.browser import NAMES, Browser


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the size of the file, and when the first frame is there; none without a browser."""
    surface = measured(village())
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path, other = Path(folder, "page.html"), Path(folder, "mesh.glb")
        counts = write_page(path, surface)
        write_glb(other, surface)
        triangles = sum(counts[layer] for layer in ("surface", "walls", "artificial"))
        size, instead = (file.stat().st_size / triangles for file in (path, other))
        what = f"page of {triangles:,} triangles"
        yield Row(f"{what}: bytes a triangle", size, "", "GLB", instead, most=12)
        if not any(map(shutil.which, NAMES)):
            return
        browser = Browser(Path(folder, "profile"))
        browser("Page.addScriptToEvaluateOnNewDocument", source=FIRST)
        times = []
        for _ in range(timer.repeats):
            browser.open(path)
            times.append(browser.evaluate("window.firstFrame") / 1000)
        browser.close()
    yield Row(f"{what}: first frame", median(times), "s", most=1)
