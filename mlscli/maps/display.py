"""How a map is shown in a notebook; what draws it stands above maps, and says where it is."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_home: dict[str, str] = {}


def shown_by(module: str, function: str) -> None:
    """Have maps shown by a function of a module, which is imported when one is shown."""
    _home.update(module=module, function=function)


def html(surface: Any) -> str | None:
    """Return a map as HTML; None where nothing draws maps."""
    if not _home:
        return None
    text: str = getattr(import_module(_home["module"]), _home["function"])(surface)
    return text
