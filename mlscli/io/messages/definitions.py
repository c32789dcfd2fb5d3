"""Parse the recorded definition of a ROS message to the types of rosbags.

A definition is input that is not trusted: one that is damaged or hostile is refused before memory
is allocated for what it describes.
"""

from __future__ import annotations

import re
import struct

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc, Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mlscli.io.containers.container import Channel
from mlscli.io.containers.messagetypes import ros2_name
from mlscli.io.ros import usual_types

# The format characters of the module struct for all primitive types but strings.
PRIMITIVES = {
    "bool": "?", "byte": "b", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip

# ROS 2 gives this field to a type without any, as a structure in C needs one.
FILLER = "structure_needs_at_least_one_member"

# Lines of 80 equals signs separate the definitions of several files.
_SEPARATOR = "=" * 80 + "\n"

_INCLUDE = re.compile(r"^[ \t]*#[ \t]*include[^\n]*$", re.MULTILINE)

# IDL of ROS, and plain, as recorders of DDS write it.
_IDL = ("ros2idl", "omgidl")

# The module that DDS has for types of ROS. Names in it may end in an underscore, but what they
# describe is the type of ROS.
_DDS_MODULE = b"dds_"

# Bounds of a definition, far beyond those of any message in use: characters, lines or fields, and
# in IDL how deep brackets stand within each other. The parsers of rosbags take the square of the
# lines, and for each level of brackets several times as long.
_LONGEST = 1 << 19
_MOST_LINES = 2000
_DEEPEST = {"<": 4, "(": 0, "{": 8, "[": 1}
_CLOSING = {">": "<", ")": "(", "}": "{", "]": "["}

# What IDL says beside types: comments, and annotations, which take longer to parse than all else.
_COMMENT = r"//[^\n]*|/\*.*?\*/"
_TEXT = r'"(?:[^"\\\n]|\\.)*"'
_ANNOTATION = re.compile(rf"({_TEXT}|{_COMMENT})|@\w+\s*\((?:[^()\"]|{_TEXT})*\)", re.DOTALL)
_NO_TYPES = re.compile(rf"{_TEXT}|{_COMMENT}", re.DOTALL)

# In bytes; the largest fixed part of a message that holds points or poses has some 700.
_LARGEST_FIXED_PART = 2**16


def typestore_of(channel: Channel) -> Typestore:
    """Return the types of a channel's schema, or those of a ROS distribution where it has none.

    A schema that is no more than the name of its type, as converters write it, is none, and so is
    one that names types as DDS does.

    Raises
    ------
    Exception
        Of any kind, as the parsers of rosbags raise many: the definition cannot be read, lacks a
        type, or describes an impossible message.
    """
    text = channel.schema.decode(errors="replace").strip()
    is_of_dds = channel.schema_encoding == "omgidl" and _DDS_MODULE in channel.schema
    if text and ros2_name(text) != channel.type and not is_of_dds:
        store = get_typestore(Stores.EMPTY)
        store.register(_parsed(channel))
    else:
        store = usual_types(is_ros1=channel.encoding == "ros1")
    smallest_size(channel.type, store.fielddefs)
    return store


def smallest_size(type_: str, definitions: Typesdict) -> int:
    """Return the least size of a message of this type in bytes, gaps for alignment not counted.

    Raises
    ------
    ValueError
        A type is not defined or not known, contains itself, or takes more than 64 KiB at least;
        or the elements of a sequence may take no bytes, so that nothing bounds their number.
    """
    # The size of a type is None while its fields are added up.
    sizes: dict[str, int | None] = {}

    def of_type(name: str) -> int:
        if name not in sizes:
            if name not in definitions:
                raise ValueError(f"it lacks the definition of {name[:100]}")
            sizes[name] = None
            fields = definitions[name][1]
            sizes[name] = sum(of_field(desc) for field, desc in fields if field != FILLER)
        size = sizes[name]
        if size is None:
            raise ValueError(f"{name[:100]} contains itself")
        if size > _LARGEST_FIXED_PART:
            raise ValueError(f"{name[:100]} takes {size} bytes or more, which no message does")
        return size

    def of_field(desc: FieldDesc) -> int:
        if desc[0] == Nodetype.NAME:
            return of_type(desc[1])
        if desc[0] == Nodetype.BASE:
            name = desc[1][0]
            if name != "string" and name not in PRIMITIVES:
                raise ValueError(f"it has a field of type {name}, which cannot be read")
            # A string takes at least the four bytes of its length.
            return 4 if name == "string" else struct.calcsize(PRIMITIVES[name])
        element, count = desc[1]
        size = of_field(element)
        if size == 0:
            raise ValueError("it has a sequence of elements that take no bytes")
        return count * size if desc[0] == Nodetype.ARRAY else 4

    return of_type(type_)


def _parsed(channel: Channel) -> Typesdict:
    text = channel.schema.decode(errors="replace").replace("\r\n", "\n")
    is_idl = channel.schema_encoding in _IDL
    if is_idl and len(text) <= _LONGEST:
        text = _ANNOTATION.sub(lambda found: found[1] or " ", text)
    _refuse_endless(text, is_idl=is_idl)
    if channel.schema_encoding in ("ros1msg", "ros2msg"):
        return get_types_from_msg(text, channel.type)
    if not is_idl:
        raise ValueError(
            f"it is written in {channel.schema_encoding[:50]!r}, expected ros1msg, ros2msg, "
            "ros2idl or omgidl"
        )
    types: Typesdict = {}
    # Definitions that a file includes follow in the recording.
    text = _INCLUDE.sub("", text)
    for part in text.split(_SEPARATOR):
        # Where there are several, each begins with a line that names it.
        idl = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if idl.strip():
            types |= get_types_from_idl(idl)
    return types


def _refuse_endless(text: str, *, is_idl: bool) -> None:
    """Refuse a definition that would take a parser more than some seconds.

    Raises
    ------
    ValueError
        Saying what is beyond its bound.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"it has {len(text):,} characters, expected at most {_LONGEST:,}")
    lines = max(text.count("\n"), text.count(";") if is_idl else 0)
    if lines > _MOST_LINES:
        raise ValueError(f"it has {lines:,} lines or fields, expected at most {_MOST_LINES:,}")
    if not is_idl:
        return
    bare = _NO_TYPES.sub("", text)
    depths = dict.fromkeys(_DEEPEST, 0)
    for bracket in re.findall(r"[<>(){}\[\]]", bare):
        opening = _CLOSING.get(bracket, bracket)
        depths[opening] += 1 if bracket in depths else -1
        if depths[opening] > _DEEPEST[opening]:
            most = _DEEPEST[opening] or "none"
            raise ValueError(
                f"it has {depths[opening]} open {bracket} at a time, expected at most {most}"
            )
