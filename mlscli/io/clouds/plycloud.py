"""PLY files as clouds: the vertices, whatever their properties and whatever else is there.

The header lists the elements in the order of the file, with their counts and properties. A property
is a number, or a list that begins with its length. In ``ascii`` an element is a row, in
``binary_little_endian`` and ``binary_big_endian`` a record. (G. Turk, The PLY Polygon File
Format, 1994.) Numbers in a text are read in float64, also where a property is ``float``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from mlscli.errors import InputError
from mlscli.io.clouds.number_lines import ALL, Item, open_lines, put_together
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, counted, wanted_fields
from mlscli.io.clouds.structures import Member, bytes_of, read_structures
from mlscli.io.files import open_input
from mlscli.io.plausibility.halves import unveiled
from mlscli.io.plausibility.readings import likelier, sample
from mlscli.io.source import side_by_side
from mlscli.runtime.arrays import Array, Float64

# numpy's type for each name, that of 1994 and the later one.
_TYPES = {
    name: type_
    for type_, names in (
        ("i1", "char int8"),
        ("u1", "uchar uint8 bool"),
        ("i2", "short int16"),
        ("u2", "ushort uint16"),
        ("i4", "int int32"),
        ("u4", "uint uint32"),
        ("i8", "int64"),
        ("u8", "uint64"),
        ("f2", "half float16"),
        ("f4", "float float32"),
        ("f8", "double float64"),
    )
    for name in names.split()
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20


class PlyCloud(PointFile):
    """The vertices of a PLY file: one keyframe, unless a property tells keyframes apart."""

    kind = "PLY cloud"

    def _read(self) -> Content:
        header = self._header()
        vertex = next((e for e in header.elements if e.name.lower() == "vertex"), None)
        if vertex is None:
            names = ", ".join(element.name for element in header.elements)
            raise InputError(
                f"{self.path}: has no element vertex, found {names or 'no element at all'}"
            )
        wanted = self._wanted(vertex)
        read = self._records if header.order else self._rows
        columns, notes, losses = read(header, vertex, wanted)
        coordinates = unveiled(columns[:3])
        points = side_by_side(coordinates.accepted(InputError))
        if coordinates.note:
            notes.append(f"{self.path}: {coordinates.note}")
        elif header.order and _are_swapped(points, columns[:3]):
            columns = [_swapped(column) for column in columns]
            points = side_by_side(columns[:3])
            stated, found = ("big", "little") if header.order == ">" else ("little", "big")
            notes.append(
                f"{self.path}: its header says binary_{stated}_endian, but its numbers are "
                f"{found}-endian, and are read so"
            )
        clouds = by_keyframe(points, columns[3] if len(columns) > 3 else None)
        return Content(clouds, notes, losses)

    def _header(self) -> _Header:
        """Read the header.

        Raises
        ------
        InputError
            The header has no end, or a line of it is not understood.
        """
        with open_input(self.path) as file:
            head = file.read(_LONGEST_HEADER)
        # The first line shows how lines end: a binary body may begin with bytes like a line end.
        newline = re.match(rb"ply[ \t]*(\r\n|\r|\n)", head)
        ending = newline[1] if newline else b"\n"
        end = re.search(ending + rb"end_header[ \t]*" + ending, head)
        if end is None:
            raise InputError(f"{self.path}: found no end_header, which ends the header of a PLY")
        order, elements = "?", list[_Element]()
        texts = head[: end.start()].decode("utf-8", "replace").split(ending.decode())
        for number, text in enumerate(texts[1:], start=2):
            match text.split():
                case ["format", name, *_] if name in _ORDERS:
                    order = _ORDERS[name]
                case ["element", name, count] if re.fullmatch(r"[0-9]{1,40}", count):
                    elements.append(_Element(name, int(count), []))
                case ["property", "list", length, type_, name] if (
                    elements and _TYPES.get(length, "f")[0] != "f" and type_ in _TYPES
                ):
                    elements[-1].fields.append(Member(name, _TYPES[type_], _TYPES[length]))
                case ["property", type_, name] if elements and (
                    type_ in _TYPES or (not order and name.lower() not in "xyz")
                ):
                    # In a text a number has no size, and the type of what is not used may be any.
                    elements[-1].fields.append(Member(name, _TYPES.get(type_, "f8")))
                case ["comment" | "obj_info", *_] | []:
                    pass
                case _:
                    raise InputError(
                        f"{self.path}:{number}: found {text.strip()[:60]!r}, expected a format "
                        f"({', '.join(_ORDERS)}), an element with its count, or a property of a "
                        f"type such as float"
                    )
        return _Header(order.strip("?"), elements, end.end())

    def _wanted(self, vertex: _Element) -> list[int]:
        """Return the indices of the properties x, y, z and, where there is one, of the keyframe."""
        wanted = wanted_fields(
            self.path, ("" if field.length else field.name for field in vertex.fields)
        )
        if wanted is None:
            names = ", ".join(field.name for field in vertex.fields)
            raise InputError(
                f"{self.path}: the element vertex has the properties {names or 'none'}, expected "
                "a number x, y and z"
            )
        return wanted

    def _records(
        self, header: _Header, vertex: _Element, wanted: Sequence[int]
    ) -> tuple[list[Array], list[str], list[str]]:
        """Return the wanted columns of a binary file, notes and losses.

        Where nothing is declared to follow the vertices, all that follow are returned.
        """
        data = bytes_of(self.path)[header.size :]
        place = header.elements.index(vertex)
        for element in header.elements[:place]:
            data = read_structures(data, element.fields, element.count, order=header.order).rest
        is_last = not any(element.count for element in header.elements[place + 1 :])
        count = None if is_last else vertex.count
        read = read_structures(data, vertex.fields, count, wanted, header.order)
        return counted(self.path, read.columns, vertex.count)

    def _rows(
        self, header: _Header, vertex: _Element, wanted: Sequence[int]
    ) -> tuple[list[Array], list[str], list[str]]:
        """Return the wanted columns of a text, notes and losses."""
        place = header.elements.index(vertex)
        after = [each for each in header.elements[place + 1 :] if each.count and each.fields]
        pick = _Picker(vertex.fields, wanted)
        with open_lines(self.path, header.size) as rows:
            for element in header.elements[:place]:
                rows.skip(element.count, element.width if element.fields else 0)
            declared = rows.read(vertex.count, pick, vertex.width, last=not after)
            ends = partial(_is_none_of, vertex, after[0]) if after else None
            beyond = rows.read(ALL, pick, vertex.width, last=not after, ends=ends)
        return put_together(self.path, declared, beyond, vertex.count, len(wanted))


def _is_none_of(element: _Element, following: _Element, words: Sequence[str]) -> bool:
    """Return whether a row is no row of an element, or as well one of that which follows."""
    return element.width is None or len(words) != element.width or following.fits(words)


class _Header(NamedTuple):
    """The content of a header.

    Attributes
    ----------
    order : str
        The byte order of numbers, < or >; empty for a text.
    elements : list of _Element
        In the order of the file.
    size : int
        Size of the header, in bytes.
    """

    order: str
    elements: list[_Element]
    size: int


@dataclass(frozen=True)
class _Element:
    """An element as the header declares it.

    Attributes
    ----------
    name : str
    count : int
        How many of it there are.
    fields : list of Member
        Its properties.
    """

    name: str
    count: int
    fields: list[Member]

    @property
    def width(self) -> int | None:
        """How many numbers a row has; None where lists make rows differ."""
        return None if any(field.length for field in self.fields) else len(self.fields)

    def fits(self, words: Sequence[str]) -> bool:
        """Return whether a row can be one of this element."""
        at = 0
        try:
            for field in self.fields:
                at += 1 + (int(words[at]) if field.length else 0)
        except (IndexError, ValueError):
            return False
        return at == len(words)


def _are_swapped(points: Float64, columns: Sequence[Array]) -> bool:
    """Return whether the bytes of coordinates (N,) certainly stand in the other order.

    Parameters
    ----------
    points : float64 (N, 3)
        The coordinates as they were read.
    columns : sequence of three arrays (N,)
        The same.
    """
    some = sample(points)
    return likelier(points[some], [side_by_side([_swapped(axis[some]) for axis in columns])]) == 0


def _swapped(column: Array) -> Array:
    """Return numbers as their bytes read in the other order."""
    return column.view(column.dtype.newbyteorder())


class _Picker(NamedTuple):
    """Picks fields of a row, past the lists before them: a `Pick`.

    Attributes
    ----------
    fields : sequence of Member
        All fields of a row.
    places : sequence of int
        Indices of the fields to pick, none of them a list.
    """

    fields: Sequence[Member]
    places: Sequence[int]

    def __call__(self, row: Sequence[Item], /) -> list[Item]:
        if not any(field.length for field in self.fields):
            return [row[place] for place in self.places]
        starts, at = [], 0
        for field in self.fields:
            starts.append(at)
            items = int(str(row[at])) if field.length else 0
            if items < 0:
                raise ValueError
            at += 1 + items
        if at > len(row):
            raise IndexError
        return [row[starts[place]] for place in self.places]
