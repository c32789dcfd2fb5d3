"""What native code prints itself, kept from the user's terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def muted() -> Iterator[None]:
    """Send standard error nowhere for the time of the block, also what is no Python's.

    Libraries in Rust print where they panic, and a backtrace, before Python sees an exception.
    """
    try:
        kept = os.dup(2)
    except OSError:
        # It is closed: nobody hears anything.
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
