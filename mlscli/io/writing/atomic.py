"""Write outputs whole or not at all."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO

from mlscli.errors import OutputError, expect_path
from mlscli.io.files import special
from mlscli.io.ros import METADATA_FILE
from mlscli.runtime.interrupts import undisturbed
from mlscli.runtime.notices import detail
from mlscli.runtime.temporary import temporary_file

# Files that are read together, by how their names begin.
_TOGETHER = (
    ("points3D.", "images.", "cameras.", "frames.", "rigs."),
    ("reconstruction.json", "tracks.csv"),
)
# Nothing that lies in a folder as a part of a recording ends like this.
_NO_PARTS = (".npz", ".html", ".png")


def refuse_existing(
    path: str | os.PathLike[str],
    *,
    overwrite: bool,
    sources: Iterable[str | os.PathLike[str]] = (),
) -> None:
    """Refuse to replace what exists, before any work is done for it.

    Of a link, what counts is the file that it leads to: this is written, the link stays.

    Parameters
    ----------
    path : path
        The output.
    overwrite : bool
        Whether an existing file may be replaced.
    sources : iterable of paths
        Inputs that must not be replaced in any case, see `refuse_sources`.

    Raises
    ------
    OutputError
        Where `path` exists and `overwrite` is False, is a folder, a device, a FIFO or one of the
        `sources`, or its folder is missing.
    """
    expect_path(path, "path", "the file to write")
    if os.fspath(path) == "-":
        raise OutputError("-: only text and JSON are written to standard output; name a file")
    named = Path(path)
    target = behind(named)
    refuse_sources(named, sources)
    if target.is_dir():
        raise OutputError(f"{named}: is a folder; name a file")
    if not target.parent.is_dir():
        # Of a link, the folder that it leads to.
        folder = target.parent if named.is_symlink() else named.parent
        raise OutputError(f"{named}: the folder {folder} does not exist")
    if found := special(target):
        raise OutputError(f"{named}: is {found}, which is never replaced; name a file")
    if target.exists() and not overwrite:
        raise OutputError(f"{named}: exists already; choose another name or add `overwrite`")


def behind(path: Path) -> Path:
    """Return the file that is written where an output is named: that which a link leads to.

    Raises
    ------
    OutputError
        Links lead to each other in a circle.
    """
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise OutputError(f"{path}: is a link that leads to itself; choose another name")
    return target


def is_same(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Return whether two names lead to one file, whether it exists or not."""
    try:
        return Path(one).samefile(other)
    except OSError:
        return os.path.realpath(one) == os.path.realpath(other)


def refuse_sources(target: Path, sources: Iterable[str | os.PathLike[str]]) -> None:
    """Refuse to replace an input, a part of one, or a folder that one lies in.

    A file in a folder that is read is a part of it, unless it ends as maps, pages and pictures do;
    so are the files beside one with which it is read, as images.bin of points3D.bin.

    Raises
    ------
    OutputError
        Where `target` is one of the `sources`, or a part of one, or holds one.
    """
    if not target.exists():
        return
    real = target.resolve()
    for source in map(Path, sources):
        if not source.exists():
            continue
        if is_same(target, source):
            raise OutputError(f"{target}: is the source itself; choose another name")
        whole = source.resolve()
        if real in whole.parents:
            raise OutputError(f"{target}: holds the source {source}; choose another name")
        if whole.name == METADATA_FILE:
            whole = whole.parent
        inside = whole in real.parents and target.suffix.lower() not in _NO_PARTS
        if inside or (real.parent == whole.parent and _are_together(real.name, whole.name)):
            raise OutputError(f"{target}: is a part of the source {source}; choose another name")


def _are_together(one: str, other: str) -> bool:
    return any(one.startswith(group) and other.startswith(group) for group in _TOGETHER)


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[BinaryIO]:
    """Open a binary stream that becomes `path` when the block ends without an error.

    The bytes go to a temporary file in the same folder, which is renamed at the end and removed
    if anything goes wrong. Who may read what is replaced, may read the new file.

    Raises
    ------
    OutputError
        As `refuse_existing`, and where the file cannot be written.
    """
    refuse_existing(path, overwrite=overwrite)
    target = behind(Path(path))
    try:
        with temporary_file(target.parent, target.name) as (stream, temporary):
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
            refuse_existing(path, overwrite=overwrite)
            temporary.chmod(_mode(target))
            with undisturbed:
                if overwrite:
                    temporary.replace(target)
                else:
                    # Unlike a rename, a link never replaces a file that was created meanwhile.
                    _rename_new(temporary, target)
        detail(f"{path}: written, {target.stat().st_size:,} bytes")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def write_together(files: Mapping[Path, bytes], *, overwrite: bool = False) -> None:
    """Write several files, all or none; those that exist stay as they were where one fails.

    Parameters
    ----------
    files : mapping of Path to bytes
        What each holds.
    overwrite : bool

    Raises
    ------
    OutputError
        As `atomic_write`, of any of them.
    """
    for file in files:
        refuse_existing(file, overwrite=overwrite)
    before = {file: file.read_bytes() if file.exists() else None for file in files}
    with undisturbed:
        try:
            with ExitStack() as opened:
                for file, content in files.items():
                    opened.enter_context(atomic_write(file, overwrite=overwrite)).write(content)
        except BaseException:
            for file, content_before in before.items():
                if content_before is None:
                    # It was not there, or is of somebody else.
                    if file.exists() and file.read_bytes() == files[file]:
                        file.unlink()
                elif file.read_bytes() != content_before:
                    file.write_bytes(content_before)
            raise


def _rename_new(temporary: Path, target: Path) -> None:
    try:
        os.link(temporary, target)
    except FileExistsError:
        refuse_existing(target, overwrite=False)
    except OSError:
        # A file system without hard links.
        refuse_existing(target, overwrite=False)
        temporary.replace(target)


def _mode(target: Path) -> int:
    """Return who may read and write a file: as before, or as the system has it for new ones."""
    if target.exists():
        return stat.S_IMODE(target.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
