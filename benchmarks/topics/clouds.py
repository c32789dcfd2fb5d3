"""Files of points to keyframes, beside the readers of other programs alone."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from benchmarks.cloud_files import pcd_file, ply_head, write_binary, write_las, write_text
from benchmarks.table import Row, Timer
from mlscli import open_recording

SIZE, SLOW_SIZE = 10**6, 10**7
# Points a second (millions) that texts are to be read with.
LEAST = {"txt": 10.0}
_LITTLE = "binary_little_endian"

Reader = Callable[[Path], object]


def rows(timer: Timer) -> Iterator[Row]:
    """Yield for each format the rate beside the other readers that are installed."""
    size = SLOW_SIZE if timer.slow else SIZE
    written: dict[str, Callable[[Path], None]] = {
        "txt": partial(write_text, count=size),
        "ply": partial(write_binary, count=size, head=ply_head(_LITTLE, size).encode()),
        "pcd": partial(write_binary, count=size, head=pcd_file("binary", size)),
        "las": partial(write_las, count=size),
        "laz": partial(write_las, count=size, compress=True),
    }
    for kind, write in written.items():
        others = {name: reader for name, reader in _others()[kind].items() if reader is not None}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"cloud.{kind}")
            write(path)
            ours, *theirs = timer.rates(
                size, partial(by_mls, path), *(partial(other, path) for other in others.values())
            )
        what = f"{'text' if kind == 'txt' else kind.upper()} of {size:,} points"
        for instead, other in zip(others, theirs, strict=True):
            yield Row(what, ours, "M points/s", instead, other, least=LEAST.get(kind))
        if not others:
            yield Row(what, ours, "M points/s", least=LEAST.get(kind))


def by_mls(path: Path) -> int:
    """Read all keyframes; return how many points they have."""
    return sum(len(keyframe.points) for keyframe in open_recording(path).keyframes())


def _others() -> dict[str, dict[str, Reader | None]]:
    """Return for each ending the readers of other programs; None: not installed."""
    pandas, open3d = _pandas(), _open3d()
    return {
        "txt": {"numpy.loadtxt": np.loadtxt, "pandas": pandas, "Open3D": _open3d("xyz")},
        "ply": {"Open3D": open3d},
        "pcd": {"Open3D": open3d},
        "las": {"laspy": _laspy},
        "laz": {"laspy": _laspy},
    }


def _laspy(path: Path) -> object:
    return laspy.read(path).xyz


def _pandas() -> Reader | None:
    try:
        import pandas
    except ImportError:
        return None
    return lambda path: pandas.read_csv(path, sep=" ", header=None).to_numpy()


def _open3d(form: str = "auto") -> Reader | None:
    try:
        import open3d
    except ImportError:
        return None

    def read(path: Path) -> Any:
        return np.asarray(open3d.io.read_point_cloud(path, format=form).points)

    return read
