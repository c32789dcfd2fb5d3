"""YAML as configurations use it: plain data, every value with the place where it was written.

Scalars follow YAML 1.2: ``1e-3`` is a number, ``on`` and ``no`` are words, only ``true`` and
``false`` are truth values, and nothing is read as octal, sexagesimal or a date. Anchors, aliases
and tags, which a configuration does not need and an attacker does, are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import yaml

from mlscli.errors import shorten
from mlscli.parameters.fields import describe_value

MAX_DEPTH = 20
_INTEGER = re.compile(r"[-+]?[0-9]+")
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS = {"": None, "~": None, "null": None, "Null": None, "NULL": None}
_TRUTH = {"true": True, "false": False}


class Place(NamedTuple):
    """Where something was written.

    Attributes
    ----------
    name : str
        The file, or what messages call the text.
    line, column : int
        Both from 1; line 0: the whole text.
    """

    name: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.name}:{self.line}:{self.column}" if self.line else self.name


class LocatedFault(NamedTuple):
    """A fault and its place.

    Attributes
    ----------
    place : Place
    message : str
        What is wrong, and what would be right.
    """

    place: Place
    message: str

    def __str__(self) -> str:
        return f"{self.place}: {self.message}"


class UnreadableYaml(Exception):  # noqa: N818
    """The text is not valid YAML, so that its values cannot be read."""

    def __init__(self, fault: LocatedFault) -> None:
        super().__init__(str(fault))
        self.fault = fault


@dataclass(frozen=True)
class ScalarNode:
    """A single value: None, bool, int, float or str."""

    place: Place
    value: bool | float | str | None


@dataclass(frozen=True)
class ListNode:
    """A list of values."""

    place: Place
    items: list[Node] = field(default_factory=list)


@dataclass(frozen=True)
class MapNode:
    """Keys with their values, in the order written, the same key perhaps more than once."""

    place: Place
    entries: list[tuple[Key, Node]] = field(default_factory=list)


@dataclass(frozen=True)
class RefusedNode:
    """A value that was refused; the reason is already reported."""

    place: Place


class Key(NamedTuple):
    """A key as it was written.

    Attributes
    ----------
    place : Place
    name : str
    """

    place: Place
    name: str


Node: TypeAlias = ScalarNode | ListNode | MapNode | RefusedNode


def describe(node: Node) -> str:
    """Return in a few words what a value is, for messages."""
    if isinstance(node, ListNode):
        return "a list"
    if isinstance(node, MapNode):
        return "keys with values"
    return describe_value(node.value) if isinstance(node, ScalarNode) else "a refused value"


def read_yaml(
    text: str, name: str, place: Place | None = None
) -> tuple[Node | None, list[LocatedFault]]:
    """Read one YAML document.

    Parameters
    ----------
    text : str
        The document.
    name : str
        The name of the file in places.
    place : Place, optional
        The place of all values; None: each has its own line and column.

    Returns
    -------
    root : Node or None
        The document's value; None where the document is empty.
    faults : list of LocatedFault
        What was refused in it.

    Raises
    ------
    UnreadableYaml
        Where the text is not valid YAML, or is nested too deeply.
    """

    def locate(mark: Any) -> Place:
        return place or Place(name, mark.line + 1, mark.column + 1)

    reader = _YamlReader(text, locate)
    try:
        return reader.document(), reader.faults
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        at = place or Place(name, before.count("\n") + 1, len(before) - before.rfind("\n"))
        message = f"the character U+{ord(text[error.position]):04X} is not allowed in YAML"
        raise UnreadableYaml(LocatedFault(at, message)) from error
    except yaml.MarkedYAMLError as error:
        at = locate(error.problem_mark or error.context_mark)
        parts = [part for part in (error.context, error.problem) if part]
        raise UnreadableYaml(LocatedFault(at, f"no valid YAML: {', '.join(parts)}")) from error
    except (ValueError, OverflowError) as error:
        # PyYAML's scanner raises these for escapes beyond Unicode.
        message = "no valid YAML: a number after a backslash stands for no character"
        raise UnreadableYaml(LocatedFault(reader.last, message)) from error


class _YamlReader:
    """Builds nodes from the parser's events."""

    def __init__(self, text: str, locate: Callable[[Any], Place]) -> None:
        self.events = yaml.parse(text, Loader=yaml.SafeLoader)
        self.locate = locate
        self.faults: list[LocatedFault] = []
        self.last = locate(yaml.Mark("", 0, 0, 0, None, 0))

    def next(self) -> Any:
        event = next(self.events)
        self.last = self.locate(event.start_mark)
        return event

    def refuse(self, place: Place, message: str) -> RefusedNode:
        self.faults.append(LocatedFault(place, message))
        return RefusedNode(place)

    def document(self) -> Node | None:
        self.next()
        if isinstance(self.next(), yaml.StreamEndEvent):
            return None
        root = self.node(self.next(), 0)
        self.next()
        if not isinstance(self.next(), yaml.StreamEndEvent):
            self.refuse(self.last, "a second document begins; a configuration is a single one")
        return root

    def node(self, event: Any, depth: int) -> Node:
        place = self.last
        if depth > MAX_DEPTH:
            message = f"nested more than {MAX_DEPTH} levels deep; a configuration needs four"
            raise UnreadableYaml(LocatedFault(place, message))
        if isinstance(event, yaml.AliasEvent):
            return self.refuse(
                place, f"*{shorten(str(event.anchor))}: aliases are not taken; write it out"
            )
        node: Node
        if isinstance(event, yaml.SequenceStartEvent):
            node = self.list(place, depth)
        elif isinstance(event, yaml.MappingStartEvent):
            node = self.map(place, depth)
        else:
            plain = event.implicit[0]
            node = ScalarNode(place, _scalar(event.value) if plain else event.value)
        if event.tag is not None:
            return self.refuse(place, f"{shorten(event.tag)}: tags are not taken; write the value")
        if event.anchor is not None:
            anchor = shorten(str(event.anchor))
            return self.refuse(place, f"&{anchor}: anchors are not taken; write the value out")
        return node

    def list(self, place: Place, depth: int) -> ListNode:
        node = ListNode(place)
        while not isinstance(event := self.next(), yaml.SequenceEndEvent):
            node.items.append(self.node(event, depth + 1))
        return node

    def map(self, place: Place, depth: int) -> MapNode:
        node = MapNode(place)
        while not isinstance(event := self.next(), yaml.MappingEndEvent):
            word = getattr(event, "value", None)
            key = self.node(event, depth + 1)
            value = self.node(self.next(), depth + 1)
            if isinstance(key, ScalarNode):
                node.entries.append((Key(key.place, str(word)), value))
            elif not isinstance(key, RefusedNode):
                self.refuse(key.place, f"found {describe(key)} as a key; a key is a word")
        return node


def _scalar(text: str) -> bool | float | str | None:
    if text in _WORDS:
        return None
    if text in _TRUTH:
        return _TRUTH[text]
    # int() refuses thousands of digits; as floats, such numbers are out of range.
    if _INTEGER.fullmatch(text) and len(text) <= 300:
        return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text
