"""Connections to Dask clusters: to a running one, or to one that is started for the purpose."""

from __future__ import annotations

import logging
import re
import signal
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any

from mlscli.errors import ClusterError, UsageError
from mlscli.pipeline.tilewise.cluster import Cluster, first_line
from mlscli.runtime.interrupts import undisturbed
from mlscli.runtime.temporary import temporary_folder
from mlscli.runtime.threads import processors

LOCAL = "local"
"""In place of an address: a cluster on this machine, for as long as it is needed."""

# Seconds until a scheduler must have answered, and until workers of this machine must have started.
ANSWER, START = 10, 60

_ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s:/@\[\]]+):([0-9]{1,5})")

# Dask's own messages would mix with those of the program.
_QUIET = {"logging": {"distributed": "critical", "distributed.client": "critical"}}

# Tiles are larger than the tasks that Dask expects, on purpose.
_LARGE = {"distributed.admin.large-graph-warning-threshold": "1 TB"}


def refuse_local(scheduler: str | None) -> None:
    """Refuse workers on this machine where memory is limited: theirs would not be counted.

    Raises
    ------
    UsageError
        Where `scheduler` is ``local``.
    """
    if scheduler == LOCAL:
        raise UsageError(
            f"`memory`: does not count what workers of `scheduler` {LOCAL} take; say `jobs`"
        )


def check_address(scheduler: str) -> None:
    """Refuse what is neither the address of a scheduler nor ``local``.

    Raises
    ------
    UsageError
    """
    match = _ADDRESS.fullmatch(scheduler)
    if scheduler != LOCAL and (match is None or not 0 < int(match[3]) < 2**16):
        raise UsageError(
            f"`scheduler` {scheduler}: is no address; write tcp://host:port as dask's scheduler "
            f"prints it, or {LOCAL} for a cluster on this machine"
        )


@contextmanager
def connected(scheduler: str) -> Iterator[Cluster]:
    """Connect to a cluster, or start one; nothing of it is left when the context ends.

    Parameters
    ----------
    scheduler : str
        The address of its scheduler, ``tcp://host:port``, or ``local``: a cluster of one process
        for each processor of this machine.

    Yields
    ------
    Cluster

    Raises
    ------
    UsageError
        Where it is no address, or Dask cannot be loaded.
    ClusterError
        Where no scheduler answers, there is no worker, or versions differ.
    """
    check_address(scheduler)
    with ExitStack() as stack:
        try:
            import dask

            with dask.config.set(_QUIET):
                import distributed
        except ImportError as error:
            raise UsageError(
                f"`scheduler`: Dask cannot be loaded ({error}); pip install 'mlscli[dask]'"
            ) from error
        stack.enter_context(dask.config.set(_LARGE))
        if scheduler == LOCAL:
            reached = _started(dask, distributed)
        else:
            reached = _reached(scheduler, distributed)
        yield Cluster(scheduler, stack.enter_context(reached))


@contextmanager
def _reached(address: str, distributed: Any) -> Iterator[Any]:
    """Connect to a running scheduler."""
    try:
        _shake_hands(address, distributed)
        with warnings.catch_warnings():
            # Dask warns of other versions; `Cluster` checks them more closely.
            warnings.simplefilter("ignore")
            client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
    except Exception as error:
        why = first_line(error) or f"nothing said within {ANSWER} s"
        raise ClusterError(f"`scheduler` {address}: no scheduler answers there: {why}") from error
    with client:
        yield client


def _shake_hands(address: str, distributed: Any) -> None:
    """Try to connect; Dask's client would wait for ever where no answer follows."""
    import asyncio

    async def reach() -> None:
        security = distributed.Security().get_connection_args("client")
        reached = distributed.comm.connect(address, timeout=ANSWER, **security)
        await (await asyncio.wait_for(reached, ANSWER)).close()

    # In a thread of its own: in a notebook this one runs an event loop already.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, reach()).result()


@contextmanager
def _started(dask: Any, distributed: Any) -> Iterator[Any]:
    """Start a cluster on this machine."""
    with ExitStack() as stack:
        # After a signal it is closed in order, which takes longer than ending the program would.
        stack.enter_context(undisturbed)
        folder = stack.enter_context(temporary_folder(None, "cluster"))
        stack.enter_context(dask.config.set({"temporary-directory": str(folder)}))
        with _interrupts_held():
            local = distributed.LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            stack.enter_context(local)
        local.scale(processors())
        client = stack.enter_context(distributed.Client(local, set_as_default=False))
        try:
            client.wait_for_workers(processors(), timeout=START)
        except TimeoutError:
            raise ClusterError(
                f"`scheduler` {LOCAL}: the workers did not start within {START} s; say `jobs`"
            ) from None
        yield client


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Block keyboard interrupts in the threads, and through them the processes, that are started.

    A terminal sends an interrupt to all processes; this one ends the others itself.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # If it were started later, it would unblock interrupts in the thread that starts it.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
