"""The map that a command takes where none is named."""

from __future__ import annotations

from pathlib import Path

from mlscli.errors import UsageError

TRUTH = ".truth.npz"
"""How the name of the exact truth ends that `mls synth` writes beside a cloud."""


def the_one_map() -> Path:
    """Return the only map in the current folder; the truth beside it, of `mls synth`, is another.

    Raises
    ------
    UsageError
        Where there is none, or there are several: the newest is named first.
    """
    from mlscli.io.writing.npz import is_map

    maps = sorted(file for file in Path().glob("*.npz") if is_map(file))
    maps = [each for each in maps if not each.name.endswith(TRUTH)] or maps
    if not maps:
        raise UsageError("MAP: no map (.npz) in the current folder; name one")
    if len(maps) > 1:
        maps.sort(key=lambda file: -file.stat().st_mtime_ns)
        newest, *others = map(str, maps)
        names = f"{newest} (the newest), {', '.join(others)}"
        raise UsageError(f"MAP: {len(maps)} maps in the current folder; name one of {names}")
    return maps[0]
