"""The preset scenes, by number and name, and the one dimension that some leave open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from mlscli.errors import UsageError, nearest
from mlscli.scenes import more_scenes, thesis_scenes
from mlscli.scenes.surfaces import Scene

LARGEST_VILLAGE = 500


class Dimension(NamedTuple):
    """The crucial dimension of a scene: what it is, its default, and its range.

    Attributes
    ----------
    what : str
        What it measures, in words.
    default : float
        The value where none is given, in the unit of the scene.
    above, high : float
        It must be greater than `above`, and at most `high`.
    """

    what: str
    default: float
    above: float
    high: float

    @property
    def range(self) -> str:
        """The range in words."""
        return f"a number above {self.above:g} and at most {self.high:g}"


@dataclass(frozen=True)
class Preset:
    """A scene that is made by name.

    Attributes
    ----------
    name, summary : str
        Its name, and a line on what it is.
    make : callable
        Returns the scene. Takes the value of the dimension where there is one; that of the
        village, its size.
    dimension : Dimension or None
        What `add_param` sets.
    number : int or None
        The thesis's number for it.
    """

    name: str
    summary: str
    make: Callable[..., Scene]
    dimension: Dimension | None = None
    number: int | None = None


_HEIGHT = "height of the bridge"
_DIAMETER = "diameter of the holes"
_OFFSET = "offset of the planes"

SCENE_PRESETS = (
    Preset(
        "bridge",
        "a horizontal surface over a valley",
        thesis_scenes.bridge,
        Dimension(_HEIGHT, 1.5, 0.6, 100),
        1,
    ),
    Preset(
        "bridge-walls",
        "a bridge between walls, with a narrow underpass",
        thesis_scenes.bridge_walls,
        Dimension(_HEIGHT, 1.2, 0, 100),
        2,
    ),
    Preset(
        "house",
        "ground and a part of a house, a hole in each",
        thesis_scenes.house,
        Dimension(_DIAMETER, 0.7, 0, 1.2),
        3,
    ),
    Preset(
        "planes",
        "three planes, one of them tilted",
        thesis_scenes.planes,
        Dimension(_OFFSET, 0.9, 0, 100),
        4,
    ),
    Preset(
        "planes-walls",
        "three planes, one of them tilted, connected by walls",
        thesis_scenes.planes_walls,
        Dimension(_OFFSET, 0.9, 0, 100),
        5,
    ),
    Preset("table", "a table on a floor of newspapers", thesis_scenes.table),
    Preset("gym", "a bare floor with two bands, a window at its end", thesis_scenes.gym),
    Preset(
        "village-thesis",
        "road, creek, bridge, ruins and white roofs",
        thesis_scenes.village,
    ),
    Preset(
        "bridge-gap",
        "a gap beside a bridge that two directions close differently",
        thesis_scenes.bridge_gap,
    ),
    Preset(
        "house-storeys",
        "a house with roof, two storeys and windows",
        more_scenes.house_storeys,
    ),
    Preset("street", "houses, trees, a crane's arm over the street", more_scenes.street),
    Preset("tunnel", "a road through a hill", more_scenes.tunnel),
    Preset("stair", "a stair up to a gallery", more_scenes.stair),
    Preset("parking", "two decks on columns, with ramps", more_scenes.parking),
    Preset("village", "N by N houses, for scale (`size` N)", more_scenes.village),
)


def preset(type_: str) -> Preset:
    """Return a preset by its name or the thesis's number.

    Raises
    ------
    UsageError
        Where there is no such preset.
    """
    for candidate in SCENE_PRESETS:
        if type_ == candidate.name or (candidate.number and type_ == str(candidate.number)):
            return candidate
    known = [candidate.name for candidate in SCENE_PRESETS]
    raise UsageError(f"`type_` {type_}: no such scene; {nearest(type_, known)}")


def make(type_: str, add_param: float | None = None, size: int | None = None) -> Scene:
    """Return a preset's scene.

    Parameters
    ----------
    type_ : str
        The preset's name or the thesis's number.
    add_param : float, optional
        Its crucial dimension, in the unit of the scene.
    size : int, optional
        Houses along each side of the village; 4 by default.

    Raises
    ------
    UsageError
        Where there is no such preset, it does not take the argument given, or the argument is out
        of range.
    """
    chosen = preset(type_)
    if chosen.make is more_scenes.village:
        if add_param is not None:
            raise UsageError(f"`add_param` {add_param:g}: {chosen.name} takes `size` instead")
        houses = 4 if size is None else size
        if not 1 <= houses <= LARGEST_VILLAGE:
            raise UsageError(f"`size` {houses}: expected 1 to {LARGEST_VILLAGE} houses a side")
        return chosen.make(houses)
    if size is not None:
        raise UsageError(f"`size` {size}: {chosen.name} has one size; the village takes `size`")
    dimension = chosen.dimension
    if dimension is None:
        if add_param is not None:
            with_one = ", ".join(each.name for each in SCENE_PRESETS if each.dimension)
            raise UsageError(
                f"`add_param` {add_param:g}: {chosen.name} has none; these have: {with_one}"
            )
        return chosen.make()
    value = dimension.default if add_param is None else add_param
    if not dimension.above < value <= dimension.high:
        raise UsageError(
            f"`add_param` {value:g}: the {dimension.what} is expected to be {dimension.range}"
        )
    return chosen.make(value)
