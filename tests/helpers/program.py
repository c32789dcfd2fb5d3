"""Runs the program as a user does, through its real entry point.

Half of the time of a short run is Python's, which imports numpy and numba. So a process that has
done so stands by, and forks for each run: what runs has a process of its own, from the command line
to the exit status. With an environment of its own it starts anew.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import NoReturn

_SECONDS = 300


def mls(
    *arguments: object,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    main: str = "mlscli.cli:main",
) -> subprocess.CompletedProcess[str]:
    """Run ``mls`` with arguments in a folder, and return status, output and errors.

    With another `main`, ``module:function``, that runs in its place, without an `env`.

    That a first run compiles kernels is left out of the errors: it is no matter of the command.
    """
    words = [*map(str, arguments)]
    done = _forked(words, cwd, main) if env is None else _started(words, cwd, env)
    said = done.stderr.splitlines(keepends=True)
    done.stderr = "".join(line for line in said if not line.startswith("mls: compiling kernels"))
    return done


def _started(
    words: list[str], cwd: Path | None, env: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "mlscli", *words],
        cwd=cwd,
        env={**os.environ, **env},
        capture_output=True,
        text=True,
        timeout=_SECONDS,
        check=False,
    )


def _forked(words: list[str], cwd: Path | None, main: str) -> subprocess.CompletedProcess[str]:
    stand_by = _stand_by()
    assert stand_by.stdin is not None
    assert stand_by.stdout is not None
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        asked = (words, str(cwd or Path.cwd()), dict(os.environ), str(out), str(err), main)
        stand_by.stdin.write(f"{json.dumps(asked)}\n".encode())
        stand_by.stdin.flush()
        ready, _, _ = select.select([stand_by.stdout], [], [], _SECONDS)
        if not ready:
            stand_by.kill()
            _stand_by.cache_clear()
            raise subprocess.TimeoutExpired(["mls", *words], _SECONDS)
        status = int(stand_by.stdout.readline())
        return subprocess.CompletedProcess(["mls", *words], status, _text(out), _text(err))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="surrogateescape")


@cache
def _stand_by() -> subprocess.Popen[bytes]:
    """Start the process that forks; it ends with this one, whose end closes its input."""
    return subprocess.Popen(
        [sys.executable, "-c", "from tests.helpers.program import stand_by; stand_by()"],
        cwd=Path(__file__).resolve().parents[2],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        preexec_fn=heed_interrupts,
    )


def stand_by() -> None:
    """Fork for each line of standard input, and answer it with the exit status of the run."""
    warm()
    answers = os.dup(1)
    # Not through a buffer, of which each fork would have a copy.
    with open(0, "rb", buffering=0) as lines:
        while line := lines.readline():
            child = os.fork()
            if not child:
                words, folder, environment, out, err, main = json.loads(line)
                become(words, folder, environment, out, err, partial(_called, main))
            _, status = os.waitpid(child, 0)
            os.write(answers, f"{os.waitstatus_to_exitcode(status)}\n".encode())


def _called(name: str) -> None:
    """Call ``module:function``."""
    module, _, function = name.partition(":")
    getattr(import_module(module), function)()


def warm() -> None:
    """Import what runs of the program import, and load the kernels, so that forks need not."""
    from mlscli.cli import COMMANDS

    drawing = ("matplotlib.figure", "matplotlib.backends.backend_agg", "matplotlib.collections")
    for module in (*(module for module, _ in COMMANDS.values()), *drawing):
        import_module(module)
    _load_kernels()


def _load_kernels() -> None:
    """Make a small map and a mesh, for whose kernels each run would take a third of a second.

    So small that no thread is started, which a fork would leave behind.
    """
    import threading

    import numpy as np

    import mlscli
    from mlscli.keyframes.keyframe import Keyframe

    rng = np.random.default_rng(1)
    sizes = ["map.cell_size=0.5", "map.free_space=true", "rays.noise=0.01"]
    builder = mlscli.MapBuilder(mlscli.load_parameters(None, sizes))
    for x in range(3):
        builder.add(Keyframe(rng.random((60, 3)) * (4, 4, 0.1), float(x), (float(x), 2.0, 3.0)))
    mlscli.build_mesh(builder.finish())
    mlscli.fit_sizes(rng.random((60, 3)))
    assert threading.active_count() == 1


def become(
    words: list[str],
    folder: str,
    environment: dict[str, str],
    out: str,
    err: str,
    main: Callable[[], object] | None = None,
) -> NoReturn:
    """Become a run of the program, or of another `main`; does not return."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["mls", *words]
    from mlscli.cli import main as program

    status: object = 0
    try:
        (main or program)()
    except SystemExit as end:
        status = end.code
    atexit._run_exitfuncs()
    # Without taking down all that was imported, which takes as long as a run.
    os._exit(status if isinstance(status, int) else 1)


def heed_interrupts() -> None:
    """Let a program that is about to start be interrupted, also if the tests run in the background.

    There a shell has interrupts ignored, which programs inherit.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
