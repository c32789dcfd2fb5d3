"""Fixtures that tests of several rooms share."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import settings

# A kernel that is compiled or loaded within an example takes its time; clocks decide nothing. Each
# run tries other examples, so that few of them do.
settings.register_profile("mls", deadline=None, max_examples=25)
settings.load_profile("mls")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of real recordings, or skip where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}")
    return folder
