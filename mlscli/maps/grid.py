"""The grid of a map: all that must be known before it holds a patch."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

from mlscli.errors import UsageError, expect

LENGTHS = ("cell_size", "gap_size", "thickness")


@dataclass(frozen=True)
class Grid:
    """The cells of a map, and how the heights in a cell become patches.

    Lengths are in the unit of the recording.

    Attributes
    ----------
    cell_size : float
        Side of a cell.
    gap_size : float
        Successive heights farther apart belong to different patches.
    thickness : float
        A patch with a greater spread is vertical.
    frame_id : str
        Name of the map frame.
    """

    cell_size: float
    gap_size: float
    thickness: float
    frame_id: str = "map"

    def __post_init__(self) -> None:
        for name in LENGTHS:
            expect(getattr(self, name), (float, Real), name, "a number")
        expect(self.frame_id, str, "frame_id", "a text")

    def require_same(self, other: Grid) -> None:
        """Refuse a grid with other lengths; its frame may have another name.

        Raises
        ------
        UsageError
            Where cell size, gap size or thickness differ.
        """
        for name in LENGTHS:
            mine, others = getattr(self, name), getattr(other, name)
            if mine != others:
                raise UsageError(
                    f"maps of different {name} do not go together: {mine!r} and {others!r}"
                )
