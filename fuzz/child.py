"""A run of the program in a process of its own, watched: its end, what it takes and touches."""

from __future__ import annotations

import atexit
import faulthandler
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from mlscli.runtime.kernel_files import OWN as KERNELS
from tests.helpers.program import become

PATIENCE = 5


class Limits(NamedTuple):
    """What a run may take.

    Attributes
    ----------
    seconds : float
        Of processors; beyond them it is ended, and where it only waits, after `PATIENCE` times
        as many by the clock: so much else may a machine have to do.
    memory : int
        Bytes of memory beyond what the program takes before it has read anything.
    """

    seconds: float = 10.0
    memory: int = 1 << 30


class Ended(NamedTuple):
    """How a run ended.

    Attributes
    ----------
    status : int
        The exit status; negative: the signal.
    is_late : bool
        Whether it was ended, as it took too long.
    out, err : str
        What it printed.
    touched : list of str
        What it did that it must not do: files written elsewhere, programs started, maps written
        that cannot be read.
    seconds : float
    memory : int
        The peak of bytes beyond those of the program itself.
    """

    status: int
    is_late: bool
    out: str
    err: str
    touched: list[str]
    seconds: float
    memory: int


@contextmanager
def new_folder() -> Iterator[Path]:
    """Yield an empty folder; not one that a fork of this process removes when it ends."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


_THREADS = 1 << 29
"""Bytes of addresses that threads reserve and do not fill."""


def run(words: list[str], folder: Path, limits: Limits, main: Callable[[], object] | None) -> Ended:
    """Run the program with words in a folder, in a fork of this process.

    Parameters
    ----------
    words : list of str
    folder : Path
        Holds ``in``, ``out`` and ``tmp``; nothing but the latter two may be written.
    limits : Limits
    main : callable or None
        What runs; None: the program.
    """
    said = folder / "said"
    said.mkdir()
    for name in ("out", "err", "touched", "began"):
        (said / name).touch()
    size = _size("VmSize")
    begin = time.perf_counter()
    child = os.fork()
    if not child:
        _become(words, folder, limits, size, main)
    is_late = not _ends(child, limits.seconds)
    if is_late:
        # It tells where it is.
        os.kill(child, signal.SIGUSR1)
        _ends(child, 0.2)
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    texts = {name: _text(said / name) for name in ("out", "err", "touched", "began")}
    return Ended(
        os.waitstatus_to_exitcode(status),
        is_late,
        texts["out"],
        texts["err"],
        sorted(set(texts["touched"].splitlines())),
        time.perf_counter() - begin,
        max(0, usage.ru_maxrss * 1024 - int(texts["began"] or 0)),
    )


def _size(name: str) -> int:
    """Return a size of this process, in bytes."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    (line,) = (line for line in lines if line.startswith(f"{name}:"))
    return int(line.split()[1]) * 1024


def _ends(child: int, seconds: float) -> bool:
    """Wait for a process to end; return whether it did within its time."""
    handle, last = os.pidfd_open(child), time.perf_counter() + PATIENCE * seconds
    try:
        while time.perf_counter() < last and _worked(child) < seconds:
            if select.select([handle], [], [], min(0.5, seconds))[0]:
                return True
        return False
    finally:
        os.close(handle)


def _worked(child: int) -> float:
    """Return how many seconds of processors a process took."""
    fields = Path(f"/proc/{child}/stat").read_text("utf-8", "replace").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _text(path: Path) -> str:
    # What fills the disk in place of the terminal is not read whole.
    with path.open("rb") as file:
        return file.read(1 << 20).decode("utf-8", "surrogateescape")


def _become(
    words: list[str], folder: Path, limits: Limits, size: int, main: Callable[[], object] | None
) -> None:
    """Become the run; does not return, whatever happens."""
    status = 70
    try:
        os.setsid()
        said = folder / "said"
        # Less than its parent has: of files, pages are loaded when they are used.
        (said / "began").write_text(str(_size("VmRSS")))
        _watch(folder, said / "touched")
        atexit.register(_read_again, folder / "out", said / "touched")
        tempfile.tempdir = None
        most = size + limits.memory + _THREADS
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        faulthandler.register(signal.SIGUSR1, file=2)
        environment = {
            "PATH": os.environ.get("PATH", os.defpath),
            "LANG": "C.UTF-8",
            "HOME": str(folder),
            "TMPDIR": str(folder / "tmp"),
            "COLUMNS": "100",
        }
        become(words, str(folder), environment, str(said / "out"), str(said / "err"), main)
    except BaseException:
        import traceback

        traceback.print_exc(file=sys.__stderr__)
    finally:
        if sys.__stderr__ is not None:
            sys.__stderr__.flush()
        os._exit(status)


_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# Which of what an event tells are names, and the folders that they are in.
_NAMES = {
    "os.rename": ((0, 2), (1, 3)),
    "os.link": ((1, 3),),
    "os.symlink": ((1, 2),),
    "os.mkdir": ((0, 2),),
    "os.chmod": ((0, 2),),
    "os.utime": ((0, 3),),
    **dict.fromkeys(("os.remove", "os.rmdir"), ((0, 1),)),
}
_NEVER = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "socket.connect")


def _watch(folder: Path, told: Path) -> None:
    """Have written down what this process writes elsewhere, and what it starts."""
    handle = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    allowed = tuple(
        os.path.realpath(each) + end
        for each, end in ((folder / "out", "/"), (folder / "tmp", "/"), (folder / "said", "/"),
                          (KERNELS, "/"), (os.devnull, ""))
    )  # fmt: skip

    def hook(event: str, given: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(given[2], int) and given[2] & _WRITING:
            places = [(given[0], -1)]
        else:
            places = [(given[name], given[parent]) for name, parent in _NAMES.get(event, ())]
        told = [f"{event}: {given[0]!r}"] if event in _NEVER else []
        for place, parent in places:
            if isinstance(place, (str, bytes, os.PathLike)):
                within = f"/proc/self/fd/{parent}" if parent >= 0 else ""
                path = os.path.realpath(os.path.join(within, os.fsdecode(place)))  # noqa: PTH118
                if not f"{path}/".startswith(allowed) and not path.startswith(("/proc/", "/dev/")):
                    told.append(f"{event}: {path}")
        if told:
            os.write(handle, "".join(f"{line}\n" for line in told).encode("utf-8", "replace"))

    sys.addaudithook(hook)


def _read_again(out: Path, told: Path) -> None:
    """Read the maps that were written, and write down what is wrong with them."""
    from mlscli.errors import MlsError
    from mlscli.io.writing.npz import is_map, read_map

    for path in out.glob("*.npz"):
        try:
            if is_map(path):
                read_map(path)
        except MlsError as error:
            with told.open("a", encoding="utf-8") as file:
                file.write(f"unsound: {error}\n")
