"""Deserialize ROS messages, with one array in place of an object for each of many points.

rosbags makes an object of every ``geometry_msgs/Point``, at 1 µs each; a SLAM system that
publishes its whole map as a marker sends tens of thousands in every message. Here a sequence of
structures of one fixed layout becomes a structured array, a view of the bytes. No code is generated
to read a type, which takes rosbags as long as reading fifty large clouds.

References
----------
ROS 1: values follow each other without a gap. CDR (OMG, Common Object Request Broker
Architecture, part 2, section 9.3): a value of n bytes begins at a multiple of n, counted from
the beginning of the message.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from types import SimpleNamespace
from typing import Any, Literal, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict

from mlscli.io.messages.definitions import FILLER, PRIMITIVES
from mlscli.runtime.arrays import Array
from mlscli.words import some

_Order: TypeAlias = Literal["<", ">"]
# Reads the value at an offset in the data, and returns it with the offset after it.
_Read: TypeAlias = Callable[[memoryview, int], tuple[Any, int]]


class FlatReader:
    """Reads messages of one type.

    Parameters
    ----------
    type_ : str
        Name of the message type.
    definitions : dict
        That type and all that it is made of, as rosbags parses them; none may contain itself.
    is_cdr : bool
        Whether messages are serialized in CDR; otherwise as in ROS 1.
    """

    def __init__(self, type_: str, definitions: Typesdict, *, is_cdr: bool) -> None:
        self._type = type_
        self._is_cdr = is_cdr
        self._definitions = definitions
        self._layouts: dict[str, np.dtype[Any] | None] = {}
        self._structures: dict[tuple[str, _Order], _Read] = {}

    def read(self, data: bytes | memoryview) -> Any:
        """Read a message as an object whose attributes are its fields.

        Sequences of numbers are arrays (N,), sequences of structures of one fixed layout
        structured arrays (N,), all other sequences lists.

        Raises
        ------
        ValueError, struct.error
            The data is not a message of this type.
        """
        body = memoryview(data)
        order: _Order = "<"
        if self._is_cdr:
            if data[:2] not in (b"\0\0", b"\0\1"):
                raise ValueError("it is not marked as plain CDR")
            body, order = body[4:], "<" if data[1] else ">"
        message, end = self._structure(self._type, order)(body, 0)
        # A middleware may pad a message to a multiple of four bytes.
        if not 0 <= len(body) - end <= (3 if self._is_cdr else 0):
            raise ValueError(f"it has {some(len(body), 'byte')}, expected {end:,}")
        return message

    def _fields(self, type_: str) -> list[tuple[str, FieldDesc]]:
        fields = self._definitions[type_][1]
        return fields if self._is_cdr else [field for field in fields if field[0] != FILLER]

    def _layout(self, desc: FieldDesc) -> np.dtype[Any] | None:
        """Return the little-endian dtype of a value; None where its layout is not fixed."""
        content: Any = desc[1]
        if desc[0] == Nodetype.BASE:
            return None if content[0] == "string" else np.dtype("<" + PRIMITIVES[content[0]])
        if desc[0] != Nodetype.NAME:
            return None
        if content not in self._layouts:
            parts = [(name, self._layout(field)) for name, field in self._fields(content)]
            whole = None if any(part is None for _, part in parts) else np.dtype(parts)
            # In CDR there are surely no gaps if all numbers are of one size.
            if whole is not None and self._is_cdr and len(_sizes(whole)) != 1:
                whole = None
            self._layouts[content] = whole
        return self._layouts[content]

    # --- a reader for each kind of value ---

    def _reader(self, desc: FieldDesc, order: _Order) -> _Read:
        content: Any = desc[1]
        if desc[0] == Nodetype.NAME:
            return self._structure(content, order)
        if desc[0] == Nodetype.BASE:
            return self._string(order) if content[0] == "string" else self._number(content, order)
        element, count = content
        layout = self._layout(element)
        array = (
            self._list(self._reader(element, order))
            if layout is None
            else self._array(layout.newbyteorder(order))
        )
        if desc[0] == Nodetype.ARRAY:
            return lambda data, at: array(data, at, count)
        length = self._number(("uint32", 0), order)

        def read(data: memoryview, at: int) -> tuple[Any, int]:
            count, at = length(data, at)
            return array(data, at, count)

        return read

    def _structure(self, type_: str, order: _Order) -> _Read:
        if (type_, order) not in self._structures:
            members = [(name, self._reader(desc, order)) for name, desc in self._fields(type_)]

            def read(data: memoryview, at: int) -> tuple[Any, int]:
                values = {}
                for name, reader in members:
                    values[name], at = reader(data, at)
                return SimpleNamespace(**values), at

            self._structures[type_, order] = read
        return self._structures[type_, order]

    def _number(self, content: tuple[str, int], order: _Order) -> _Read:
        form = Struct(order + PRIMITIVES[content[0]])
        unpack, size = form.unpack_from, form.size
        gap = size - 1 if self._is_cdr else 0

        def read(data: memoryview, at: int) -> tuple[Any, int]:
            at = (at + gap) & ~gap
            return unpack(data, at)[0], at + size

        return read

    def _string(self, order: _Order) -> _Read:
        length = self._number(("uint32", 0), order)
        # In CDR the length includes a zero byte at the end.
        zero = int(self._is_cdr)

        def read(data: memoryview, at: int) -> tuple[str, int]:
            count, at = length(data, at)
            end = at + count
            return str(data[at : end - zero], "utf-8"), end

        return read

    def _array(self, layout: np.dtype[Any]) -> Callable[[memoryview, int, int], tuple[Array, int]]:
        gap = max(_sizes(layout)) - 1 if self._is_cdr else 0

        def read(data: memoryview, at: int, count: int) -> tuple[Array, int]:
            # An empty sequence has no gap after its length.
            at = (at + gap) & ~gap if count else at
            return np.frombuffer(data, layout, count, at), at + count * layout.itemsize

        return read

    def _list(self, element: _Read) -> Callable[[memoryview, int, int], tuple[list[Any], int]]:
        def read(data: memoryview, at: int, count: int) -> tuple[list[Any], int]:
            values = []
            # Each element takes some bytes, so that a hostile count fails where the data ends.
            for _ in range(count):
                value, at = element(data, at)
                values.append(value)
            return values, at

        return read


def _sizes(layout: np.dtype[Any]) -> set[int]:
    """Return the sizes of the numbers that a layout consists of."""
    if layout.fields is None:
        return {layout.itemsize}
    return {size for part, *_ in layout.fields.values() for size in _sizes(part)}
