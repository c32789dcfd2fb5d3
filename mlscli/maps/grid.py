"""The grid of a map: all that must be known before it holds a patch."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

from mlscli.errors import UsageError, expect
from mlscli.parameters.lengths import alike

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

    def differing(self, other: Grid) -> list[str]:
        """Return the names of the lengths in which another grid differs by more than a rounding."""
        cell = min(self.cell_size, other.cell_size)
        return [
            name for name in LENGTHS if not alike(getattr(self, name), getattr(other, name), cell)
        ]

    def require_same(self, other: Grid) -> None:
        """Refuse a grid with other lengths; its frame may have another name.

        Raises
        ------
        UsageError
            Where cell size, gap size or thickness differ.
        """
        for name in self.differing(other):
            raise UsageError(
                f"maps of different {name} do not go together: {getattr(self, name)!r} and "
                f"{getattr(other, name)!r}"
            )
