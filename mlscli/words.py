"""Counts in sentences."""

from __future__ import annotations


def some(count: int, noun: str) -> str:
    """Return a count with its noun: ``1 cell``, ``1,234 cells``."""
    ending = "" if count == 1 else "es" if noun.endswith("ch") else "s"
    return f"{count:,} {noun}{ending}"


def are(count: int) -> str:
    """Return the verb of so many: ``is`` or ``are``."""
    return verb(count, "is", "are")


def verb(count: int, one: str, more: str) -> str:
    """Return what one does, or what more do, whichever count it is."""
    return one if count == 1 else more
