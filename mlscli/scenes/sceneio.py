"""Scenes in YAML: surfaces by the parameters of the building blocks, and legs flown near them.

A file is checked as a whole. Every fault in it is reported at once, each with its file, line and
column, what was found and what would be right. See ``docs/scenes.md``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from mlscli.config.yaml_nodes import (
    Key,
    ListNode,
    LocatedFault,
    MapNode,
    Node,
    Place,
    RefusedNode,
    ScalarNode,
    UnreadableYaml,
    describe,
    read_yaml,
)
from mlscli.errors import ConfigError, InputError, nearest, shorten
from mlscli.io.files import open_input
from mlscli.scenes.presets import SCENE_PRESETS
from mlscli.scenes.surfaces import Leg, Rectangle, Scatter, Scene, add_horizontal, add_vertical

MAX_SCENE_BYTES = 50_000_000


class _Kind(NamedTuple):
    """What a key takes: a number, a tuple of numbers or a list of tuples, within a range.

    Attributes
    ----------
    numbers : int
        How many numbers a tuple has; 1: a single number.
    form : str
        What the numbers of a tuple are, for messages; empty for a single number.
    least, most : float
        The range of each number, inclusive.
    above : float
        What each number must exceed.
    many : bool
        Whether the key takes a list of tuples.
    """

    numbers: int
    form: str
    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf
    many: bool = False

    @property
    def accepts(self) -> str:
        limits = [
            f"{word} {limit:g}"
            for word, limit in (
                ("above", self.above),
                ("of at least", self.least),
                ("at most", self.most),
            )
            if math.isfinite(limit)
        ]
        what = "a number" if self.numbers == 1 else f"{self.numbers} numbers, {self.form}"
        whole = " ".join([what, *limits])
        return f"a list, each item {whole}" if self.many else whole

    def holds(self, number: float) -> bool:
        return (
            math.isfinite(number)
            and self.least <= number <= self.most
            and number > self.above
            and abs(number) <= 1e8
        )


_SURFACE_KEYS = {
    "position": _Kind(3, "[x, y, z]"),
    "size": _Kind(2, "[length, width or height]", above=0),
    "orientation": _Kind(1, ""),
    "grade": _Kind(1, ""),
    "scatter": _Kind(2, "[horizontal, vertical]", least=0),
    "texture": _Kind(1, "", least=0, most=1),
    "openings": _Kind(4, "[a_low, a_high, b_low, b_high]", many=True),
    "textureless": _Kind(4, "[a_low, a_high, b_low, b_high]", many=True),
}
_LEG_KEYS = {
    "start": _Kind(3, "[x, y, z]"),
    "end": _Kind(3, "[x, y, z]"),
    "tilt": _Kind(1, "", least=0, most=180),
    "yaw": _Kind(1, ""),
}
_BLOCKS: dict[str, Callable[..., Scene]] = {
    "horizontal": add_horizontal,
    "vertical": add_vertical,
}
_TOP_KEYS = ("surfaces", "legs")
_TAKES = {"scene": "a scene", "legs": "a route"}

Read = TypeVar("Read")


def load_scene(path: str | os.PathLike[str]) -> Scene:
    """Read a scene from a file; its name is the file's, without the ending.

    Raises
    ------
    InputError
        Where the file cannot be read, is too large, or is not UTF-8 text.
    ConfigError
        Where the scene is at fault; lists every fault in it.
    """
    return parse_scene(_text_of(path, "scene"), os.fspath(path))


def load_legs(path: str | os.PathLike[str]) -> tuple[Leg, ...]:
    """Read the legs of a route from a file: a list of them, or one under the key `legs`.

    Raises
    ------
    InputError
        Where the file cannot be read, is too large, or is not UTF-8 text.
    ConfigError
        Where the route is at fault; lists every fault in it.
    """
    return _parsed(_text_of(path, "legs"), os.fspath(path), _SceneReader.route)


def _text_of(path: str | os.PathLike[str], argument: str) -> str:
    """Return the text of a file that an argument names."""
    source = Path(path)
    try:
        with open_input(source) as stream:
            data = stream.read(MAX_SCENE_BYTES + 1)
    except FileNotFoundError:
        what = f"`{argument}` takes {_TAKES[argument]} in YAML"
        if argument == "scene" and any(preset.name == source.name for preset in SCENE_PRESETS):
            what += f"; `type_` {source.name} is one that there is"
        raise InputError(f"{source}: no such file; {what}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{source}: cannot be read as {_TAKES[argument]}: {reason}") from error
    if len(data) > MAX_SCENE_BYTES:
        raise InputError(
            f"{source}: more than {MAX_SCENE_BYTES} bytes, which is not {_TAKES[argument]}"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        found = f"byte 0x{data[error.start]:02x} at offset {error.start}"
        raise InputError(f"{source}: {found} is not UTF-8; save it as UTF-8 text") from error


def parse_scene(text: str, name: str) -> Scene:
    """Read a scene from a text; messages call the text `name`.

    Raises
    ------
    ConfigError
        Where the scene is at fault; lists every fault in it.
    """
    return _parsed(
        text, name, lambda reader, root, whole: reader.scene(root, whole, Path(name).stem)
    )


def _parsed(text: str, name: str, read: Callable[[_SceneReader, Node | None, Place], Read]) -> Read:
    """Return what is read from a text in YAML; raise ConfigError with every fault in it."""
    try:
        root, faults = read_yaml(text, name)
    except UnreadableYaml as error:
        raise ConfigError([str(error.fault)]) from error
    reader = _SceneReader(faults)
    found = read(reader, root, Place(name, 1, 1))
    if reader.faults:
        ordered = sorted(reader.faults, key=lambda fault: fault.place[1:])
        raise ConfigError([str(fault) for fault in ordered])
    return found


class _SceneReader:
    """Turns nodes into a scene and gathers every fault."""

    def __init__(self, faults: list[LocatedFault]) -> None:
        self.faults = faults

    def fault(self, place: Place, message: str) -> None:
        self.faults.append(LocatedFault(place, message))

    def scene(self, root: Node | None, whole: Place, name: str) -> Scene:
        scene = Scene(name)
        parts: dict[str, Node] = {}
        if isinstance(root, ListNode):
            parts["surfaces"] = root
        elif isinstance(root, MapNode):
            parts = {key.name: node for key, node in self.entries(root, "", _TOP_KEYS)}
        elif not isinstance(root, RefusedNode):
            found = describe(root) if root else "nothing"
            self.fault(whole, f"found {found}; expected a list of surfaces")
            return scene
        for item in self.items(parts.get("surfaces"), "surfaces"):
            scene = self.surface(scene, item)
        if not scene.surfaces and not self.faults:
            self.fault(whole, "surfaces: none is given; a scene has at least one")
        legs = self.items(parts.get("legs"), "legs")
        return scene.with_legs(*filter(None, [self.leg(item) for item in legs]))

    def route(self, root: Node | None, whole: Place) -> tuple[Leg, ...]:
        """Return the legs of a list, or of the list under the key `legs`."""
        found: Node | None = root
        if isinstance(root, MapNode):
            found = next((node for _, node in self.entries(root, "", ("legs",))), None)
        elif not isinstance(root, ListNode | RefusedNode):
            what = describe(root) if root else "nothing"
            self.fault(whole, f"found {what}; expected a list of legs")
            return ()
        legs = tuple(filter(None, [self.leg(item) for item in self.items(found, "legs")]))
        if not legs and not self.faults:
            self.fault(whole, "legs: none is given; a route has at least one")
        return legs

    def surface(self, scene: Scene, item: Node) -> Scene:
        """Add the surface of an item ``horizontal: {...}`` or ``vertical: {...}``."""
        if not isinstance(item, MapNode) or len(item.entries) != 1:
            if not isinstance(item, RefusedNode):
                right = "expected one of horizontal: {...} or vertical: {...} for each '-'"
                self.fault(item.place, f"surfaces: found {describe(item)}; {right}")
            return scene
        key, node = item.entries[0]
        if key.name not in _BLOCKS:
            hint = nearest(key.name, _BLOCKS)
            self.fault(key.place, f"surfaces.{shorten(key.name)}: unknown surface; {hint}")
            return scene
        given = self.values(key, node, _SURFACE_KEYS, ("position", "size"))
        if given is None:
            return scene
        if "scatter" in given:
            given["scatter"] = Scatter(*given["scatter"])
        for part in ("openings", "textureless"):
            given[part] = [Rectangle(*numbers) for numbers in given.get(part, ())]
            for a_low, a_high, b_low, b_high in given[part]:
                if not (a_low < a_high and b_low < b_high):
                    right = "expected each low below its high: [a_low, a_high, b_low, b_high]"
                    numbers = f"[{a_low:g}, {a_high:g}, {b_low:g}, {b_high:g}]"
                    self.fault(key.place, f"{key.name}.{part}: found {numbers}; {right}")
        try:
            return _BLOCKS[key.name](scene, **given)
        except ValueError as error:
            self.fault(key.place, f"{key.name}: {error}")
            return scene

    def leg(self, item: Node) -> Leg | None:
        given = self.values(Key(item.place, "legs"), item, _LEG_KEYS, ("start", "end"))
        return None if given is None else Leg(**given)

    def values(
        self, owner: Key, node: Node, kinds: dict[str, _Kind], needed: Iterable[str]
    ) -> dict[str, Any] | None:
        """Return the values by key; None where one is at fault, or a needed one is missing."""
        before = len(self.faults)
        if not isinstance(node, MapNode):
            if not isinstance(node, RefusedNode):
                right = f"expected {', '.join(kinds)}"
                self.fault(node.place, f"{owner.name}: found {describe(node)}; {right}")
            return None
        entries = list(self.entries(node, owner.name, kinds))
        given = {
            key.name: self.numbers(f"{owner.name}.{key.name}", value, kinds[key.name])
            for key, value in entries
        }
        for name in needed:
            if name not in given:
                right = f"expected {kinds[name].accepts}"
                self.fault(owner.place, f"{owner.name}.{name}: is missing; {right}")
        return given if len(self.faults) == before else None

    def numbers(self, path: str, node: Node, kind: _Kind) -> Any:
        """Return a number, a tuple of them, or a list of tuples; None for what is at fault."""
        if kind.many:
            single = kind._replace(many=False)
            return [self.numbers(path, item, single) for item in self.items(node, path)]
        items = node.items if kind.numbers > 1 and isinstance(node, ListNode) else [node]
        values = [item.value for item in items if isinstance(item, ScalarNode)]
        numbers = [
            float(value)
            for value in values
            if isinstance(value, int | float)
            and not isinstance(value, bool)
            and abs(value) < 1e300
            and kind.holds(float(value))
        ]
        if len(numbers) == len(items) == kind.numbers:
            return numbers[0] + 0.0 if kind.numbers == 1 else tuple(n + 0.0 for n in numbers)
        if not isinstance(node, RefusedNode):
            found = describe(node)
            if isinstance(node, ListNode):
                found = shorten(f"[{', '.join(map(describe, node.items))}]")
            self.fault(node.place, f"{path}: found {found}; expected {kind.accepts}")
        return None

    def items(self, node: Node | None, path: str) -> list[Node]:
        if isinstance(node, ListNode):
            return node.items
        if node is not None and not isinstance(node, RefusedNode):
            self.fault(node.place, f"{path}: found {describe(node)}; expected a list")
        return []

    def entries(self, node: MapNode, inside: str, valid: Iterable[str]) -> list[tuple[Key, Node]]:
        """Return the entries with a valid key, each key once."""
        names, taken = list(valid), dict[str, tuple[Key, Node]]()
        for key, value in node.entries:
            path = shorten(f"{inside}.{key.name}" if inside else key.name)
            if key.name not in names:
                self.fault(key.place, f"{path}: unknown key; {nearest(key.name, names)}")
            elif key.name in taken:
                line = taken[key.name][0].place.line
                self.fault(key.place, f"{path}: given twice, first in line {line}; keep one")
            else:
                taken[key.name] = (key, value)
        return list(taken.values())
