"""Multi-level surface maps and meshes from recorded drone flights.

The names below are loaded when they are first used, so that importing the package is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mlscli.errors import MlsError

if TYPE_CHECKING:
    from mlscli.config import Parameters
    from mlscli.config import load as load_parameters
    from mlscli.io.recording import open_recording
    from mlscli.pipeline.builder import MapBuilder, build_map
    from mlscli.surface_map import SurfaceMap

__version__ = "0.1.0"

__all__ = [
    "MapBuilder",
    "MlsError",
    "Parameters",
    "SurfaceMap",
    "__version__",
    "build_map",
    "load_parameters",
    "open_recording",
]

_HOMES = {
    "MapBuilder": ("mlscli.pipeline.builder", "MapBuilder"),
    "Parameters": ("mlscli.config", "Parameters"),
    "SurfaceMap": ("mlscli.surface_map", "SurfaceMap"),
    "build_map": ("mlscli.pipeline.builder", "build_map"),
    "load_parameters": ("mlscli.config", "load"),
    "open_recording": ("mlscli.io.recording", "open_recording"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _HOMES[name]
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
