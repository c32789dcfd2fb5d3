"""What makes a map: two builds of the same end with the same bits."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mlscli.pipeline.parameters import Parameters, to_dict
from mlscli.pipeline.tilewise.cluster import versions

if TYPE_CHECKING:
    from mlscli.io.reading.recording import Recording


def identity(recording: Recording, parameters: Parameters) -> dict[str, Any]:
    """Return what makes the map of a recording, but for what the sources hold; ready for JSON.

    Parameters
    ----------
    recording : Recording
    parameters : Parameters
        As they were given.
    """
    return {
        "program": {**versions(), "code": _code()},
        "sources": recording.sources,
        "bytes": {source: _size(Path(source)) for source in recording.sources},
        "reading": recording.options,
        "parameters": to_dict(parameters),
    }


def _code() -> str:
    """Return a digest of the program's modules: a checkout changes between versions."""
    folder = Path(__file__).parents[1]
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(folder.rglob("*.py")):
        digest.update(f"{path.relative_to(folder)} {path.stat().st_size} ".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _size(path: Path) -> int | None:
    """Return how many bytes a file holds, or all files of a folder together."""
    if path.is_dir():
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    return path.stat().st_size if os.path.lexists(path) else None
