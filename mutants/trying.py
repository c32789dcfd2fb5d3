"""Tests that are collected once and run again and again, each time in a process of its own.

What failed last comes first, then what is quickest: most mutants are caught by the first test.
"""

from __future__ import annotations

import os
import resource
import select
import signal
import time
from collections.abc import Callable
from typing import NamedTuple

import pytest
from _pytest.runner import runtestprotocol

MEMORY = 4 * 2**30
"""So many bytes a run may take."""

_OPTIONS = (
    *("-qq", "-s", "-p", "no:faulthandler", "-p", "no:cacheprovider", "-p", "no:xdist"),
    # Another module's tests were collected before.
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),
)


class Outcome(NamedTuple):
    """What came of a run.

    Attributes
    ----------
    passed : bool
    failed : str
        The test that failed; none where the run ended otherwise.
    seconds : float
    """

    passed: bool
    failed: str
    seconds: float


class Tests:
    """Tests that were collected.

    Parameters
    ----------
    items : list of pytest.Item
    """

    def __init__(self, items: list[pytest.Item]) -> None:
        self._items = items
        self._took = dict[str, float]()
        self._last = dict[str, float]()

    def run(self, change: Callable[[], None] | None = None, spare: float = 10.0) -> Outcome:
        """Run all until one fails, after a change.

        Each may take five times what it took before, and so many seconds of a processor
        more, in which kernels are compiled.
        """
        begin = time.monotonic()
        # pytest tears down what the next test, in a list, has no use for: files stay together.
        items = sorted(self._items, key=lambda item: self._took.get(item.nodeid, 0.0))
        items.sort(key=lambda item: -self._last.get(item.nodeid, 0.0))
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            os.close(reading)
            limits = [spare + 5 * self._took.get(item.nodeid, 0.0) for item in items]
            _run(items, limits, change, writing)
        os.close(writing)
        # A test that waits for another process takes no time of a processor.
        lines = _lines(reading, child, begin + 60 + 20 * spare)
        _, status = os.waitpid(child, 0)
        failed = ""
        for line in lines:
            node, took, fine = line.rsplit(" ", 2)
            if fine == "1":
                self._took[node] = float(took)
            else:
                failed = node
                self._last[node] = time.monotonic()
        return Outcome(status == 0, failed, time.monotonic() - begin)


def _lines(reading: int, child: int, end: float) -> list[str]:
    """Return the lines that a process says until it ends, or is ended."""
    said = b""
    while True:
        ready, _, _ = select.select([reading], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            os.kill(child, signal.SIGKILL)
            break
        more = os.read(reading, 65536)
        if not more:
            break
        said += more
    os.close(reading)
    return said.decode().splitlines()


def _run(
    items: list[pytest.Item],
    limits: list[float],
    change: Callable[[], None] | None,
    writing: int,
) -> None:
    """Run tests until one fails, say each in a line, and end."""
    status = 70
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        for number in (1, 2):
            os.dup2(nothing, number)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        if change is not None:
            change()
        status = 0
        for item, limit, after in zip(items, limits, [*items[1:], None], strict=True):
            # Its signal ends the process.
            signal.setitimer(signal.ITIMER_PROF, limit)
            begin = time.process_time()
            reports = runtestprotocol(item, log=False, nextitem=after)
            fine = not any(report.failed for report in reports)
            took = time.process_time() - begin
            os.write(writing, f"{item.nodeid} {took:.4f} {int(fine)}\n".encode())
            if not fine:
                status = 1
                break
    finally:
        os._exit(status)


class _Collected:
    """Takes what was collected, in place of running it."""

    def __init__(self, use: Callable[[Tests], None]) -> None:
        self._use = use

    def pytest_collection(self) -> None:
        # A failing example is enough; a smaller one would take longer.
        from hypothesis import Phase, settings

        phases = [Phase.explicit, Phase.generate]
        settings.register_profile("mutants", settings.default, phases=phases)
        settings.load_profile("mutants")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self._use(Tests(session.items))
        return True


def collected(paths: list[str], use: Callable[[Tests], None]) -> bool:
    """Collect tests and use them; return whether they could be collected."""
    return pytest.main([*_OPTIONS, *paths], [_Collected(use)]) == 0
