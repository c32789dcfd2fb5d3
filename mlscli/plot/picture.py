"""A figure that shows itself where it is the value of a notebook's cell."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

INLINE_DPI = 80


class Picture(Figure):
    """A figure of matplotlib that notebooks show as it is, with no window and no pyplot."""

    def _repr_png_(self) -> bytes:
        return png(self)


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG, small enough to stand in a text."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=INLINE_DPI, bbox_inches="tight", pad_inches=0.12)
    return stream.getvalue()
