"""Where compiled kernels are kept, and which of them are current.

A file holds one kernel, compiled for one list of types. Its name says of which kernel, and has a
digest of all that the result depends on: the types, what the kernel is compiled from, the versions
of Python, numba, llvmlite and numpy, the platform and the processor. So a file is current if it has
the right name, wherever it was copied to, and no index is kept. It begins with a checksum: what is
cut short or of another kernel is no file of it.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import MAGIC_NUMBER
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import FunctionType
from typing import Any

import llvmlite  # type: ignore[import-untyped, unused-ignore]
import numba
import numpy as np
from numba.core import caching, compiler, serialize, sigutils

from mlscli.runtime.kernel_sources import digest

OWN = Path(__file__).with_name("compiled")
"""The package's own folder of kernels."""

# numba is typed in part.
_config: Any = numba.config
_types: Any = numba.types
_Result: Any = compiler.CompileResult
_dumps: Any = serialize.dumps
_normalized: Any = sigutils.normalize_signature

_CHECKSUM = hashlib.sha256().digest_size


class UnknownCache(Exception):  # noqa: N818
    """The installed numba keeps compiled kernels in an unknown way."""


def keep(compiled: Any) -> None:
    """Have what a kernel is compiled to kept in files.

    Raises
    ------
    UnknownCache
        Where numba has no such fields as are needed.
    """
    results = ("_reduce", "_rebuild")
    known = all(hasattr(_Result, name) for name in results)
    if not known or not hasattr(compiled, "_cache"):
        raise UnknownCache(
            f"numba {numba.__version__} keeps them in a way that is not known here; install an "
            "older numba, and report this"
        )
    compiled._cache = KernelFiles(compiled.py_func, compiled.targetoptions)


class KernelFiles(caching._Cache):  # type: ignore[misc, unused-ignore]
    """The files of a kernel, as numba asks for them."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self._function, self._options = function, options
        self._is_own = function.__module__.split(".")[0] == __name__.split(".")[0]

    @property
    def cache_path(self) -> str:
        """Return the folder that is written to; empty: none can be."""
        return str(folder(self._is_own) or "")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return what a kernel was compiled to for the types of its arguments; None: nothing."""
        # Without it, numba knows no types yet.
        target_context.refresh()
        name = self._name(sig, target_context.codegen())
        for place in _folders(self._is_own):
            kept = _read(place / name)
            if kept is not None:
                return _Result._rebuild(target_context, *pickle.loads(kept))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what a kernel was compiled to, unless it cannot be, or no folder can be written."""
        place = folder(self._is_own)
        if place and not data.lifted and not data.library.has_dynamic_globals:
            with suppress(OSError):
                _write(place / self._name(sig, data.codegen), _dumps(data._reduce()))

    def enable(self) -> None:
        """Do nothing: what is kept is always used."""

    def disable(self) -> None:
        """Do nothing: what is kept is always used."""

    def flush(self) -> None:
        """Do nothing: what is kept is right."""

    def _name(self, sig: Any, codegen: Any) -> str:
        arguments, _ = _normalized(sig)
        depends = (
            *map(described, arguments),
            digest(self._function),
            repr(sorted(self._options.items())),
            environment(),
            repr(codegen.magic_tuple()),
        )
        ending = hashlib.sha256("\n".join(depends).encode()).hexdigest()[:32]
        return f"{self._function.__module__}.{self._function.__qualname__}-{ending}.kernel"


def described(kind: Any) -> str:
    """Return a text that says what a type of numba's is, with the fields of named tuples."""
    if isinstance(kind, _types.BaseNamedTuple):
        made = kind.instance_class
        fields = zip(kind.fields, kind.types, strict=True)
        inside = ", ".join(f"{field}: {described(one)}" for field, one in fields)
        return f"{made.__module__}.{made.__qualname__}({inside})"
    if isinstance(kind, _types.BaseTuple):
        return f"({', '.join(map(described, kind.types))})"
    return repr(kind)


@cache
def environment() -> str:
    """Return what compiled kernels depend on beside their sources and the processor."""
    python = f"{sys.implementation.cache_tag}{sys.abiflags} {MAGIC_NUMBER.hex()}"
    numpy = ".".join(np.__version__.split(".")[:2])
    switches = [_config.OPT, _config.LOOP_VECTORIZE, _config.SLP_VECTORIZE, _config.BOUNDSCHECK]
    return (
        f"{python}, numba {numba.__version__}, llvmlite {llvmlite.__version__}, numpy {numpy}, "
        f"{sys.platform} {platform.machine()}, {switches}"
    )


def folder(is_own: bool = True) -> Path | None:
    """Return the folder that kernels are written to; None: none can be written."""
    return next(filter(_can_be_written, _written(is_own)), None)


def _folders(is_own: bool) -> Iterator[Path]:
    """Yield the folders that kernels are looked for in."""
    if is_own:
        yield OWN
    yield from (place for place in _written(is_own) if place != OWN)


def _written(is_own: bool) -> Iterator[Path]:
    """Yield the folders that kernels can be written to, the best first."""
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
        return
    if is_own:
        yield OWN
    # Without a home, there is none.
    with suppress(RuntimeError):
        caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        yield Path(caches, "mls", "kernels")


@cache
def _can_be_written(place: Path) -> bool:
    try:
        place.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=place):
            return True
    except OSError:
        return False


def _read(path: Path) -> bytes | None:
    """Return what a file holds, if it is there and whole."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    checksum, kept = content[:_CHECKSUM], content[_CHECKSUM:]
    return kept if checksum == _checksum(path, kept) else None


def _write(path: Path, kept: bytes) -> None:
    """Write a file, which appears whole or not at all."""
    with NamedTemporaryFile(dir=path.parent, delete=False) as file:
        written = Path(file.name)
        try:
            file.write(_checksum(path, kept) + kept)
            file.close()
            # Others may read it, as they may the rest of the program.
            written.chmod(0o644)
            written.replace(path)
        except BaseException:
            written.unlink()
            raise


def _checksum(path: Path, kept: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + kept).digest()
