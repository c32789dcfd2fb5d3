"""Compiles kernels before they are called: when the program is installed, or a container is made.

`KERNELS` lists all kernels and the types that the program calls them with. Other processes compile
them, for any processor of the platform: numba takes the processor from the environment of the
process, so kernels of others in this one are not touched.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from mlscli.errors import OutputError
from mlscli.runtime import kernel_files
from mlscli.runtime.kernel_types import read

KERNELS = Path(__file__).with_name("kernels.txt")
"""A line for each kernel and the types of its arguments."""

_ROOT = Path(__file__).parents[2]
_COMPILED, _PRESENT = "compiled", "present"
_WORK = "from mlscli.runtime.warming import work; work()"


class Warmed(NamedTuple):
    """What compiling kernels ahead came to.

    Attributes
    ----------
    folder : path
        Where those are kept that were compiled.
    compiled : int
        Kernels that were compiled.
    present : int
        Kernels that were there already.
    failed : list of str
        Of those that could not be compiled: the line of `KERNELS`, and why.
    """

    folder: Path
    compiled: int
    present: int
    failed: list[str]


def warm_up(jobs: int = 1, progress: Callable[[int, int], None] | None = None) -> Warmed:
    """Compile all kernels that are not kept yet, for any processor of the platform.

    Parameters
    ----------
    jobs : int
        Number of processes.
    progress : callable, optional
        Called with the number of kernels done, and of all that are to be compiled.

    Raises
    ------
    OutputError
        If there is no folder to keep them in.
    """
    folder = kernel_files.folder()
    if folder is None:
        raise OutputError("no folder to keep kernels in can be written; NUMBA_CACHE_DIR names one")
    lines = KERNELS.read_text(encoding="utf-8").splitlines()
    waiting: SimpleQueue[str] = SimpleQueue()
    for line in lines:
        waiting.put(line)
    done: list[str] = []

    def compile_some() -> None:
        for answer in _answers(waiting):
            done.append(answer)
            if progress is not None:
                progress(len(done), len(lines))

    with ThreadPoolExecutor(jobs) as pool:
        for future in [pool.submit(compile_some) for _ in range(jobs)]:
            future.result()
    if folder == kernel_files.OWN:
        kernel_files.note_environment()
    failed = [said for said in done if said not in (_COMPILED, _PRESENT)]
    return Warmed(folder, done.count(_COMPILED), done.count(_PRESENT), failed)


def _answers(waiting: SimpleQueue[str]) -> Iterator[str]:
    """Yield what a new process says of each line that it is given, until none waits."""
    others = filter(None, [os.environ.get("PYTHONPATH")])
    environment = {
        **os.environ,
        **kernel_files.GENERIC,
        "PYTHONPATH": os.pathsep.join([str(_ROOT), *others]),
    }
    with subprocess.Popen(
        [sys.executable, "-c", _WORK],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        while True:
            try:
                line = waiting.get_nowait()
            except Empty:
                process.stdin.close()
                return
            print(line, file=process.stdin, flush=True)
            yield process.stdout.readline().strip() or f"{line}: its process has ended"


def work() -> None:
    """Compile the kernels that standard input names, and answer each in a line."""
    _tell_no_places()
    for line in sys.stdin:
        sys.stdout.write(f"{_compiled(line.strip())}\n")
        sys.stdout.flush()


def _compiled(line: str) -> str:
    try:
        kernel, types = read(line)
        before = len(kernel.stats.cache_misses)
        kernel.compile(types)
        return _COMPILED if len(kernel.stats.cache_misses) > before else _PRESENT
    # Whatever it is, the program works without it: the kernel is compiled when it is called.
    except Exception as error:
        return f"{line}: {type(error).__name__}: {error}".replace("\n", " ")


def _tell_no_places() -> None:
    """Have sources named from the folders that they were installed in, in what is compiled."""
    from numba.core import ir

    place: Any = ir.Loc
    made = place.__init__
    folders = sorted((f"{path}{os.sep}" for path in sys.path if path), key=len, reverse=True)

    def shortened(self: Any, filename: str, *others: Any, **named: Any) -> None:
        known = (folder for folder in folders if filename.startswith(folder))
        made(self, filename[len(next(known, "")) :], *others, **named)

    place.__init__ = shortened
