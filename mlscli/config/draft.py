"""A configuration while it is being read: what was given, where, and all faults.

A draft checks names, kinds and ranges. `mlscli.config` adds the values of parameters that are left
out, and then checks whether parameters contradict each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

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
from mlscli.errors import meant, nearest, shorten
from mlscli.parameters.fields import UNKNOWN, fields_of


class Given(NamedTuple):
    """A value and where it was given.

    Attributes
    ----------
    place : Place
    value : object
        The value, converted as its field says; `UNKNOWN` where it is at fault.
    """

    place: Place
    value: Any


@dataclass
class DraftPart:
    """A section or a stage as it was given.

    Attributes
    ----------
    name : str
        What the configuration calls it; empty for the top level.
    owner : type
        The dataclass whose fields its parameters are.
    place : Place or None
        Where it begins; None where it was left out.
    given : dict of str to Given
        The parameters given, by name.
    chosen : mapping
        Defaults of parameters, by name, that take precedence over those of the dataclass.
    """

    name: str
    owner: type
    place: Place | None = None
    given: dict[str, Given] = field(default_factory=dict)
    chosen: Mapping[str, Any] = field(default_factory=dict)

    def path(self, parameter: str) -> str:
        """Return the full name of one of its parameters."""
        return f"{self.name}.{parameter}" if self.name else parameter


class Draft:
    """Reads a document and settings on top of it, and gathers every fault.

    Parameters
    ----------
    sections : mapping of str to type
        The dataclass of each section by name; the empty name is the top level.
    stages : mapping of str to type
        The dataclass of each stage by name.
    pipeline : mapping of str to mapping
        The stages where the document gives no pipeline: names, and defaults of their parameters
        as in `DraftPart`.
    """

    def __init__(
        self,
        sections: Mapping[str, type],
        stages: Mapping[str, type],
        pipeline: Mapping[str, Mapping[str, Any]],
    ) -> None:
        self.sections = {name: DraftPart(name, owner) for name, owner in sections.items()}
        self.stages = stages
        self.pipeline = [
            DraftPart(name, stages[name], chosen=chosen) for name, chosen in pipeline.items()
        ]
        self.faults: list[LocatedFault] = []
        self._pipeline_known = True

    def fault(self, place: Place, message: str) -> None:
        """Note a fault."""
        self.faults.append(LocatedFault(place, message))

    def read(self, text: str, name: str) -> None:
        """Read a document; messages call it `name`.

        Raises
        ------
        UnreadableYaml
            Where it is not valid YAML.
        """
        root, refused = read_yaml(text, name)
        self.faults += refused
        if root is None or isinstance(root, RefusedNode) or _is_null(root):
            return
        if not isinstance(root, MapNode):
            valid = ", ".join(self._top_names())
            self.fault(root.place, f"found {describe(root)}; expected sections: {valid}")
            return
        top = self.sections[""]
        for key, node in self._entries(root, "", self._top_names()):
            if key.name == "pipeline":
                self._read_pipeline(node)
            elif key.name in self.sections:
                self._read_part(self.sections[key.name], node, key.place)
            else:
                self._give(top, key, node)

    def set(self, setting: str) -> None:
        """Take a setting ``stage.param=value``, which takes precedence over the document."""
        place = Place(f"`sets` {shorten(setting, 80)}")
        path, _, text = setting.partition("=")
        path = path.strip()
        if not path:
            self.fault(place, "no name is given; write NAME=VALUE, such as plaster.max_gap=0.4")
            return
        part_name, _, parameter = path.rpartition(".")
        parts = self._parts_named(place, part_name, parameter)
        if parts and not text.strip():
            self.fault(place, f"{path}: no value is given; write {path}=VALUE")
            return
        try:
            node, refused = read_yaml(text, "", place)
        except UnreadableYaml as error:
            self.faults.append(error.fault)
            return
        if parts:
            self.faults += refused
        for number, part in enumerate(parts):
            # Several stages of one name share the setting: report its fault once.
            self._give(part, Key(place, parameter), node or ScalarNode(place, None), number == 0)

    def _parts_named(self, place: Place, part_name: str, parameter: str) -> list[DraftPart]:
        """Return the parts that a setting applies to; none where its name is at fault."""
        owners = {name: part.owner for name, part in self.sections.items()} | dict(self.stages)
        path = f"{part_name}.{parameter}" if part_name else parameter
        if not part_name and parameter in owners:
            example = next(iter(fields_of(owners[parameter])))
            self.fault(place, f"{path}: name one parameter of it, such as {path}.{example}")
            return []
        holders = [f"{name}.{parameter}" for name in owners if parameter in fields_of(owners[name])]
        if not part_name and holders and holders != [f".{parameter}"]:
            self.fault(place, f"{path}: name whose it is: {' or '.join(holders)}")
            return []
        if part_name not in owners or (not part_name and parameter not in fields_of(owners[""])):
            named = (
                owners.keys() - {""} if part_name else {*owners} - {""} | {*fields_of(owners[""])}
            )
            self.fault(place, f"{path}: unknown name; {nearest(part_name or path, sorted(named))}")
            return []
        if parameter not in fields_of(owners[part_name]):
            hint = nearest(parameter, fields_of(owners[part_name]))
            self.fault(place, f"{path}: unknown key; {hint}")
            return []
        if part_name in self.sections:
            return [self.sections[part_name]]
        parts = [part for part in self.pipeline if part.name == part_name]
        if not parts and self._pipeline_known:
            there = ", ".join(dict.fromkeys(part.name for part in self.pipeline)) or "none"
            self.fault(place, f"{path}: {part_name} is not in the pipeline; its stages: {there}")
        # A stage that is not in the pipeline gets a part as well, so that the value is checked.
        return parts or [DraftPart(part_name, owners[part_name])]

    def _top_names(self) -> list[str]:
        top = [*fields_of(self.sections[""].owner)]
        return [*top, *filter(None, self.sections), "pipeline"]

    def _entries(
        self, node: MapNode, inside: str, valid: Iterable[str]
    ) -> Iterator[tuple[Key, Node]]:
        """Yield the entries with a valid key, each key once."""
        names = list(valid)
        first: dict[str, Place] = {}
        for key, value in node.entries:
            path = shorten(f"{inside}.{key.name}" if inside else key.name)
            if key.name not in names:
                self.fault(key.place, f"{path}: unknown key; {nearest(key.name, names)}")
            elif key.name in first:
                line = first[key.name].line
                self.fault(key.place, f"{path}: given twice, first in line {line}; keep one")
            else:
                first[key.name] = key.place
                yield key, value

    def _read_part(self, part: DraftPart, node: Node, place: Place) -> None:
        """Read the parameters of a section or a stage; it may have none."""
        part.place = place
        if isinstance(node, MapNode):
            names = fields_of(part.owner)
            for key, value in self._entries(node, part.name, names):
                self._give(part, key, value)
            for key, _ in node.entries:
                # Its value may be this one: nothing can be said against it.
                name = None if key.name in names else meant(key.name, names)
                if name is not None:
                    part.given.setdefault(name, Given(key.place, UNKNOWN))
        elif not isinstance(node, RefusedNode) and not _is_null(node):
            example = next(iter(fields_of(part.owner)))
            message = f"found {describe(node)}; expected parameters, such as {example}"
            self.fault(node.place, f"{part.name}: {message}")

    def _read_pipeline(self, node: Node) -> None:
        self.pipeline = []
        if isinstance(node, ListNode):
            for item in node.items:
                self._read_stage(item)
            return
        self._pipeline_known = False
        if not isinstance(node, RefusedNode):
            found = describe(node)
            self.fault(
                node.place, f"pipeline: found {found}; expected a list of stages, [] for none"
            )

    def _read_stage(self, item: Node) -> None:
        key, node = Key(item.place, ""), item
        if isinstance(item, ScalarNode) and isinstance(item.value, str):
            key, node = Key(item.place, item.value), ScalarNode(item.place, None)
        elif isinstance(item, MapNode) and len(item.entries) == 1:
            key, node = item.entries[0]
        elif not isinstance(item, RefusedNode):
            found = describe(item)
            if isinstance(item, MapNode) and item.entries:
                found = shorten(f"the keys {', '.join(key.name for key, _ in item.entries)}")
            right = "expected one stage for each '-', its parameters indented deeper or in { }"
            self.fault(item.place, f"pipeline: found {found}; {right}")
        if key.name in self.stages:
            part = DraftPart(key.name, self.stages[key.name])
            self.pipeline.append(part)
            self._read_part(part, node, key.place)
            return
        self._pipeline_known = False
        if key.name:
            path = shorten(f"pipeline.{key.name}")
            self.fault(key.place, f"{path}: unknown stage; {nearest(key.name, self.stages)}")

    def _give(self, part: DraftPart, key: Key, node: Node, report: bool = True) -> None:
        """Give a parameter its value, or `UNKNOWN` and, if `report`, a fault."""
        value = UNKNOWN
        if isinstance(node, ScalarNode):
            try:
                value = fields_of(part.owner)[key.name].convert(node.value)
            except ValueError as error:
                if report:
                    self.fault(node.place, f"{part.path(key.name)}: {error}")
        elif report and not isinstance(node, RefusedNode):
            accepts = fields_of(part.owner)[key.name].accepts
            message = f"found {describe(node)}; expected {accepts}"
            self.fault(node.place, f"{part.path(key.name)}: {message}")
        part.given[key.name] = Given(node.place, value)


def _is_null(node: Node) -> bool:
    return isinstance(node, ScalarNode) and node.value is None
