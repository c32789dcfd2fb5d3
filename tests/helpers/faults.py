"""What is at fault in a configuration."""

from __future__ import annotations

import pytest

from mlscli.config import loads
from mlscli.errors import ConfigError


def faults_of(text: str, sets: tuple[str, ...] = ()) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        loads(text, "p.yaml", sets)
    return caught.value.faults


def only_fault_of(text: str, sets: tuple[str, ...] = ()) -> str:
    (fault,) = faults_of(text, sets)
    assert "\n" not in fault
    return fault
