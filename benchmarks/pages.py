"""Time the page of a map of half a million triangles in Chromium: ``python -m benchmarks.pages``.

The browser is headless and draws in software (SwiftShader), on the processor: any graphics card is
faster. Measured is the time from frame to frame while every frame is redrawn. Each series begins
with the page at rest, so that its first frames are drawn in full detail.
"""

from __future__ import annotations

import os
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.scenes.presets import make
from mlscli.scenes.truth import truth
from mlscli.view.page import write_page
from tests.helpers.browser import Browser

# Acts in every frame; returns the milliseconds of each frame but the first.
FRAMES = """(async () => {
  const next = () => new Promise((done) => requestAnimationFrame(done));
  const key = (key) => dispatchEvent(new KeyboardEvent("keydown", { key }));
  const canvas = document.querySelector("canvas");
  const wheel = (deltaY) => {
    canvas.dispatchEvent(new WheelEvent("wheel", { deltaY, clientX: 600, clientY: 300 }));
  };
  const slider = document.querySelector("#slider");
  const slide = (share) => {
    slider.value = share * slider.max;
    slider.dispatchEvent(new Event("input"));
  };
  const times = [];
  let before = await next();
  for (let frame = 0; frame < %d; frame++) {
    %s;
    const now = await next();
    times.push(now - before);
    before = now;
  }
  return times.slice(1);
})()"""
COUNT = 40
DOING = {
    "turning": 'key("ArrowLeft")',
    "zooming to the cursor": "wheel(frame < 10 ? -150 : 150)",
    "moving the slider": f"slide(frame / {COUNT - 1})",
    "changing the colours": 'key("c")',
}


# Notes when the first frame is drawn, in milliseconds from the beginning of the page.
FIRST = """new MutationObserver(() => { window.firstFrame ??= performance.now(); })
  .observe(document, { attributes: true, subtree: true, attributeFilter: ["data-detail"] })"""


def measured(surface: SurfaceMap) -> SurfaceMap:
    """Return a true map as if it had been measured: heights and statistics are of chance."""
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.03, surface.size)
    count = rng.integers(1, 12, surface.size).astype(np.uint32)
    changed: dict[str, Any] = {
        name: getattr(surface, name) + noise for name in ("height", "bottom", "top", "mean")
    }
    changed |= {"count": count, "variance": rng.gamma(2, 0.0005, surface.size)}
    return replace(surface, **changed).sorted()


def village() -> SurfaceMap:
    """Return a map of 289 houses, seen from west to east, a keyframe every four cells."""
    surface = truth(make("village", size=17), 0.15, 0.5, 0.15)
    seen = ((surface.ix - surface.ix.min()) // 4).astype(np.int32)
    route = np.zeros((int(seen.max()) + 1, 4))
    route[:, 0] = np.arange(len(route))
    route[:, 1] = (surface.ix.min() + 4 * np.arange(len(route))) * surface.cell_size
    route[:, 3] = 4.0
    return replace(surface, first_keyframe=seen, last_keyframe=seen, route=route)


def main() -> None:
    """Write the page, open it, and print how long each step takes."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(Path(folder, "profile"))
        browser("Page.addScriptToEvaluateOnNewDocument", source=FIRST)
        surface = village()
        for name, shown in (("measured", measured(surface)), ("true", surface)):
            path, begin = Path(folder, f"{name}.html"), time.perf_counter()
            counts = write_page(path, shown)
            written = time.perf_counter() - begin
            triangles = sum(counts[layer] for layer in ("surface", "walls", "artificial"))
            size = path.stat().st_size
            browser.open(path)
            click.echo(
                f"{name}: {triangles:,} triangles, {size / 1e6:.1f} MB, {size / triangles:.1f} "
                f"bytes a triangle, written in {written:.2f} s; first frame after "
                f"{browser.evaluate('window.firstFrame') / 1000:.2f} s"
            )
        for what, act in DOING.items():
            before = processor_time(browser.pid)
            frames = browser.evaluate(FRAMES % (COUNT, act))
            spent = 1000 * (processor_time(browser.pid) - before) / COUNT
            median, worst = np.percentile(frames, (50, 95))
            click.echo(
                f"{what}: {median:.0f} ms a frame, 95 % within {worst:.0f} ms, "
                f"{spent:.0f} ms of the processor"
            )
        browser.close()


def processor_time(group: int) -> float:
    """Return the CPU time (s) that the processes of a group have used so far."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state = stat.read_text().rpartition(")")[2].split()
            if int(state[2]) == group:
                ticks += int(state[11]) + int(state[12])
    return ticks / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
