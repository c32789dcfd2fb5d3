"""Pictures of maps: from above, cut upright, and two side by side (matplotlib).

Each `plot` function returns a `matplotlib.figure.Figure`, which `write_figure` writes and notebooks
show, or draws into `axes` that it is given. Lengths are in the unit of the map.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

from mlscli.errors import UsageError, expect, expect_path
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.plot.above import plot_above
from mlscli.plot.differences import plot_differences
from mlscli.plot.section import plot_section

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "FORMATS",
    "plot_above",
    "plot_differences",
    "plot_section",
    "require_format",
    "write_figure",
]

Format: TypeAlias = Literal["png", "svg", "pdf"]
FORMATS: tuple[Format, ...] = get_args(Format)

DPI = 120


def require_format(path: str | os.PathLike[str]) -> Format:
    """Return the format that a file's ending names.

    Raises
    ------
    UsageError
        Where it names none of `FORMATS`.
    """
    ending = Path(path).suffix.lower()
    for kind in FORMATS:
        if ending == f".{kind}":
            return kind
    endings = ", ".join(f".{kind}" for kind in FORMATS)
    raise UsageError(f"{os.fspath(path)}: ends in {ending!r}; expected one of {endings}")


def write_figure(path: str | os.PathLike[str], figure: Figure, *, overwrite: bool = False) -> None:
    """Write a figure as PNG, SVG or PDF by the file's ending, whole or not at all.

    Raises
    ------
    UsageError
        Where the ending is none of these.
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    expect_path(path, "path", "the file to write")
    from matplotlib.figure import Figure

    expect(figure, Figure, "figure", "a figure of matplotlib (Figure)")
    kind = require_format(path)
    refuse_existing(path, overwrite=overwrite)
    with atomic_write(path, overwrite=overwrite) as stream:
        figure.savefig(stream, format=kind, dpi=DPI, bbox_inches="tight", pad_inches=0.12)
