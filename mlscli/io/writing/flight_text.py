"""Write a recording as text: a line for each point, columns named in a header.

Numbers are written so that they read back as the same bits.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from mlscli.io.writing.atomic import atomic_write
from mlscli.keyframes.keyframe import Keyframe

COLUMNS = ("x", "y", "z", "keyframe", "t", "cx", "cy", "cz")


def write_text(
    path: str | os.PathLike[str], keyframes: Iterable[Keyframe], *, overwrite: bool = False
) -> None:
    """Write keyframes as a text cloud, whole or not at all.

    Columns are separated by commas in a ``.csv``, otherwise by blanks. A keyframe without points
    has no lines, and its number is skipped.

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    mark = "," if Path(path).suffix.lower() == ".csv" else " "
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(f"{mark.join(COLUMNS)}\n".encode())
        for number, keyframe in enumerate(keyframes):
            seen = map(repr, (number, float(keyframe.stamp), *map(float, keyframe.position)))
            rest = mark.join(["", *seen])
            lines = [f"{x!r}{mark}{y!r}{mark}{z!r}{rest}\n" for x, y, z in keyframe.points.tolist()]
            stream.write("".join(lines).encode())
