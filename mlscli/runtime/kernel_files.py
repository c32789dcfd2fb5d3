"""Where compiled kernels are kept, and which of them are current.

A file holds one kernel, compiled for one list of types. Its name says of which kernel, and has a
digest of all that the result depends on: the types, what the kernel is compiled from, the versions
of Python, numba, llvmlite and numpy, the platform and the processor. So a file is current if it has
the right name, wherever it was copied to, and no index is kept. It begins with a checksum: what is
cut short or of another kernel is no file of it.

What lies in the package's own folder comes with it, compiled for any processor of the platform
(`GENERIC`); what is compiled when it is first called is for the processor at hand.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import platform
import sys
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.util import MAGIC_NUMBER, find_spec
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import FunctionType
from typing import Any

import llvmlite  # type: ignore[import-untyped, unused-ignore]
import numba
import numpy as np
from numba.core import caching, compiler, serialize, sigutils
from numba.np import linalg

from mlscli.runtime.kernel_sources import digest
from mlscli.runtime.kernel_types import written

OWN = Path(__file__).with_name("compiled")
"""The package's own folder of kernels."""

# numba is typed in part.
_config: Any = numba.config
_Result: Any = compiler.CompileResult
_dumps: Any = serialize.dumps
_normalized: Any = sigutils.normalize_signature
_linalg: Any = linalg

GENERIC = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
"""The environment of a process that compiles for any processor of the platform."""

_MADE_FOR = "made-for.json"
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
        _leave_scipy_out()
        # Without it, numba knows no types yet.
        target_context.refresh()
        processor = target_context.codegen().magic_tuple()
        for place in _folders(self._is_own):
            for one in (_any_processor(processor), processor):
                kept = _read(place / self.name(sig, one))
                if kept is not None:
                    return _Result._rebuild(target_context, *pickle.loads(kept))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what a kernel was compiled to, unless it cannot be, or no folder can be written."""
        place = folder(self._is_own)
        if place and not data.lifted and not data.library.has_dynamic_globals:
            # What numba notes of types is long, and tells where modules lie.
            reduced = data._replace(type_annotation="")._reduce()
            with suppress(OSError):
                _write(place / self.name(sig, data.codegen.magic_tuple()), _dumps(reduced))

    def enable(self) -> None:
        """Do nothing: what is kept is always used."""

    def disable(self) -> None:
        """Do nothing: what is kept is always used."""

    def flush(self) -> None:
        """Do nothing: what is kept is right."""

    def name(self, sig: Any, processor: tuple[str, ...]) -> str:
        """Return the name of the file for types of arguments, and a processor as numba tells it."""
        arguments, _ = _normalized(sig)
        depends = (
            # The one has the names of fields, the other the types of those of records.
            *(f"{written(kind)} {kind!r}" for kind in arguments),
            digest(self._function),
            repr(sorted(self._options.items())),
            repr(environment()),
            repr(processor),
        )
        ending = hashlib.sha256("\n".join(depends).encode()).hexdigest()[:32]
        return f"{self._function.__module__}.{self._function.__qualname__}-{ending}.kernel"


def _leave_scipy_out() -> None:
    """Import what numba compiles with, but for scipy, which takes a third of a second.

    numba imports it only to know whether it is there; whatever calls it imports it once more.
    """
    if "numba.np.arraymath" in sys.modules or not hasattr(_linalg, "ensure_blas"):
        return
    asks = _linalg.ensure_blas
    _linalg.ensure_blas = _require_scipy
    try:
        import_module("numba.np.arraymath")
    finally:
        _linalg.ensure_blas = asks


def _require_scipy() -> None:
    if find_spec("scipy") is None:
        raise ImportError("scipy is required for linear algebra")


def _any_processor(processor: tuple[str, ...]) -> tuple[str, ...]:
    """Return what numba tells in a process with the environment `GENERIC`."""
    return (processor[0], *GENERIC.values())


@cache
def environment() -> dict[str, str]:
    """Return what compiled kernels depend on beside their sources and the processor, by name."""
    switches = [_config.OPT, _config.LOOP_VECTORIZE, _config.SLP_VECTORIZE, _config.BOUNDSCHECK]
    return {
        "Python": f"{sys.implementation.cache_tag}{sys.abiflags} {MAGIC_NUMBER.hex()}",
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "numpy": ".".join(np.__version__.split(".")[:2]),
        "platform": f"{sys.platform} {platform.machine()}",
        "switches": " ".join(map(str, switches)),
    }


def note_environment() -> None:
    """Write down beside the package's own kernels what they were compiled for."""
    if OWN.is_dir():
        (OWN / _MADE_FOR).write_text(json.dumps(environment(), indent=1), encoding="utf-8")


def mismatch() -> str:
    """Return what the package's own kernels were compiled for, where it is not at hand; or ""."""
    with suppress(OSError, ValueError):
        made_for = json.loads((OWN / _MADE_FOR).read_text(encoding="utf-8"))
        unlike = [name for name, here in environment().items() if made_for.get(name) != here]
        return ", ".join(f"{name} {made_for.get(name)}" for name in unlike)
    return ""


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
