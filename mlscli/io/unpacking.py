"""How much a compressed block may unpack to: the one bound, for every format.

What real recordings hold shrinks to a tenth, empty images to a hundredth. A block that grows more
than `RATIO` times, and beyond `ALWAYS` bytes, is made to fill the memory, and counts as damaged.
"""

from __future__ import annotations

RATIO = 250
"""So many times as large as it lies in the file a block may become."""

ALWAYS = 1 << 26
"""So many bytes any block may unpack to, however small it is."""

LARGEST = 1 << 32
"""No block that is held in memory may unpack to more bytes than this."""


def most_unpacked(packed: int) -> int:
    """Return how many bytes a block of so many bytes may unpack to."""
    return max(ALWAYS, RATIO * packed)


def most_held(packed: int) -> int:
    """Return how many bytes a block may unpack to that is held in memory."""
    return min(LARGEST, most_unpacked(packed))


def excess(packed: int) -> str:
    """Say what is wrong with a block of so many bytes that unpacks to more."""
    return (
        f"its {packed:,} bytes would unpack to more than {most_unpacked(packed):,}, "
        f"{RATIO} times as many or {ALWAYS >> 20} MiB"
    )
