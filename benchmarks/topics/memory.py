"""What a build of a file of points takes of the memory that it was given."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from benchmarks.cloud_files import ply_head, write_binary, write_las, write_text
from benchmarks.process import ran
from benchmarks.table import Row, Timer

SIZE, LIMIT = 3_000_000, 350


def rows(timer: Timer) -> Iterator[Row]:  # noqa: ARG001
    """Yield the greatest resident size of builds with ``--memory``, beside those without."""
    written: dict[str, Callable[[Path], None]] = {
        "txt": partial(write_text, count=SIZE),
        "ply": partial(
            write_binary, count=SIZE, head=ply_head("binary_little_endian", SIZE).encode()
        ),
        "laz": partial(write_las, count=SIZE, compress=True),
    }
    for kind, write in written.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"cloud.{kind}")
            write(path)
            limited, free = (
                _peak(path, *options)
                for options in (["--memory", f"{LIMIT}M", "--scratch", folder], [])
            )
        what = f"`mls build --memory {LIMIT}M` of {kind} of {SIZE:,} points"
        yield Row(what, limited, "MB", "without `--memory`", free, most=LIMIT)


def _peak(path: Path, *options: str) -> float:
    """Return the greatest resident size (MB of 2^20 bytes) of a build."""
    command = [sys.executable, "-m", "mlscli", "build", str(path), "--overwrite", *options]
    command += ["-o", str(path.with_suffix(".npz"))]
    return ran([*command, "--set", "map.cell_size=0.3"]).peak / 2**20
