"""Which sources a kernel is compiled from: its own, and all of this package that it imports.

numba compiles a kernel anew only where its own file has changed, but functions and constants of
other modules are compiled into it, too.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

Stamp = tuple[tuple[str, int, int], ...]

_ROOT = Path(__file__).parents[1]
_IMPORT = re.compile(r"^(?:from|import) mlscli\.([\w.]+)", re.MULTILINE)


def stamp(path: Path) -> Stamp:
    """Return name, time of change (ns) and size (bytes) of a file and of all that it imports."""
    reached: set[Path] = set()
    waiting = {path}
    while waiting:
        reached |= waiting
        waiting = {source for one in waiting for source in _imported(one)} - reached
    return tuple(sorted(map(_state, reached)))


@cache
def _imported(path: Path) -> list[Path]:
    return [_source(name) for name in _IMPORT.findall(path.read_text(encoding="utf-8"))]


def _source(name: str) -> Path:
    place = _ROOT.joinpath(*name.split("."))
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


@cache
def _state(path: Path) -> tuple[str, int, int]:
    found = path.stat()
    name = str(path.relative_to(_ROOT)) if path.is_relative_to(_ROOT) else path.name
    return name, found.st_mtime_ns, found.st_size
