"""How much memory the program may take, and what there is room for."""

from __future__ import annotations

import os
from pathlib import Path

from mlscli.errors import UsageError
from mlscli.pipeline.blocks import PointBlocks
from mlscli.pipeline.tilewise import COMFORTABLE, Tile, tiles_of

# Bytes that it takes at most to put a point in order, and to know where the points of a block lie.
SORTED, INDEXED = 200, 100

# Bytes with which work can be done at all, besides those of the program itself.
LEAST = 32 * 2**20


class Memory:
    """So much memory for the program.

    Parameters
    ----------
    most : int
        Bytes that it may take, what it has taken before among them.

    Attributes
    ----------
    room : int
        Bytes that were left when this was made.

    Raises
    ------
    UsageError
        There is too little room for any work.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        # What the program takes by itself, its kernels loaded, is no room for points.
        self.room = most - resident()
        if self.room < LEAST:
            raise self.too_little(LEAST)

    def left(self, blocks: PointBlocks) -> int:
        """Return how many bytes there is room for besides the list of where points lie."""
        left = self.room - blocks.entries * INDEXED
        if left < LEAST:
            what = f"the points lie in {blocks.entries:,} blocks, which have to be listed"
            raise self.too_little(self.room - left + LEAST, what)
        return left

    def sortable(self, blocks: PointBlocks) -> int:
        """Return how many points can be held and put in order at a time."""
        return self.left(blocks) // 2 // SORTED

    def tiles(self, blocks: PointBlocks, reach: int, per_point: int) -> list[Tile]:
        """Divide the plane into tiles that there is room to work on.

        Parameters
        ----------
        blocks : PointBlocks
        reach : int
            How many cells the margins of tiles are wide.
        per_point : int
            Bytes for each point of a tile.

        Raises
        ------
        UsageError
            One that cannot be divided holds too many points.
        """
        left = self.left(blocks)
        most = left // per_point
        tiles = tiles_of(blocks, reach, min(most, COMFORTABLE))
        crowd = max(tile.points for tile in tiles)
        if crowd > most:
            what = f"{2**blocks.shift} cells square and their surroundings hold {crowd:,} points"
            raise self.too_little(self.room - left + crowd * per_point, what)
        return tiles

    def too_little(self, needed: int, why: str = "") -> UsageError:
        """Return the error that says how much there should be, for so many bytes of room."""
        least = -(-(self._most - self.room + needed) // 2**20)
        because = f": {why}" if why else ""
        return UsageError(
            f"--memory: {self._most // 2**20}M is too little{because}; give at least {least}M"
        )


def resident() -> int:
    """Return how many bytes of memory the program takes now; a guess where nothing tells."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 300 * 2**20
    return pages * os.sysconf("SC_PAGE_SIZE")
