"""Make the pictures of what other programs read: ``python -m docs.gallery.exports [NAME ...]``.

Names are those of the functions in `ALL`. Each picture is drawn from the files that
``mls export`` writes of the hamlet in the README.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from docs.gallery.make import CAPTION, WIDTH, hamlet, save
from mlscli.io.writing.nav2 import write_nav2
from mlscli.rasters.robot import Robot
from mlscli.runtime.arrays import Array, UInt8

EDGE = 8


def nav2() -> None:
    """Draw the images of four storeys."""
    with tempfile.TemporaryDirectory() as folder:
        written = write_nav2(Path(folder, "hamlet.yaml"), hamlet(), Robot(slope=25))
        chosen = [0, 3, 4, 5] if len(written.sheets) > 5 else range(len(written.sheets))
        images = [
            (sheet.file.name, np.asarray(Image.open(sheet.file.with_suffix(".pgm"))))
            for sheet in (written.sheets[number] for number in chosen)
        ]
    save("nav2", tiled(images))


ALL: Sequence[Callable[[], None]] = (nav2,)


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
