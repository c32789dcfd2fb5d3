"""Write outputs whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from mlscli.errors import OutputError, expect_path


def refuse_existing(
    path: str | os.PathLike[str],
    *,
    overwrite: bool,
    sources: Iterable[str | os.PathLike[str]] = (),
) -> None:
    """Refuse to replace what exists, before any work is done for it.

    Parameters
    ----------
    path : path
        The output.
    overwrite : bool
        Whether an existing file may be replaced.
    sources : iterable of paths
        Files that must not be replaced in any case.

    Raises
    ------
    OutputError
        Where `path` exists and `overwrite` is False, is a folder or one of the `sources`, or its
        folder is missing.
    """
    expect_path(path, "path", "the file to write")
    target = Path(path)
    refuse_sources(target, sources)
    if target.is_dir():
        raise OutputError(f"{target}: is a folder; name a file")
    if not target.parent.is_dir():
        raise OutputError(f"{target}: the folder {target.parent} does not exist")
    if target.exists() and not overwrite:
        raise OutputError(f"{target}: exists already; choose another name or add `overwrite`")


def refuse_sources(target: Path, sources: Iterable[str | os.PathLike[str]]) -> None:
    """Refuse to replace a source, or a folder that one lies in.

    Raises
    ------
    OutputError
        Where `target` is one of the `sources`, or holds one.
    """
    for source in sources:
        if target.exists() and Path(source).exists():
            if target.samefile(source):
                raise OutputError(f"{target}: is the source itself; choose another name")
            if target.resolve() in Path(source).resolve().parents:
                raise OutputError(f"{target}: holds the source {source}; choose another name")


@contextmanager
def atomic_write(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[BinaryIO]:
    """Open a binary stream that becomes `path` when the block ends without an error.

    The bytes go to a temporary file in the same folder, which is renamed at the end and removed
    if anything goes wrong.

    Raises
    ------
    OutputError
        As `refuse_existing`, and where the file cannot be written.
    """
    refuse_existing(path, overwrite=overwrite)
    target = Path(path)
    temporary = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        temporary = Path(name)
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(0o666 & ~_umask())
        if overwrite:
            temporary.replace(target)
        else:
            # Unlike a rename, a link never replaces a file that was created meanwhile.
            _rename_new(temporary, target)
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with suppress(FileNotFoundError):
                temporary.unlink()


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


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
