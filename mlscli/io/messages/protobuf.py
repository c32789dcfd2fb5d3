"""Read messages in protobuf with the descriptors that an MCAP file holds beside them.

References
----------
MCAP's registry of schema encodings: the schema is a FileDescriptorSet with the definition and
all that it imports.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from mlscli.io.containers.container import Channel


def reader(channel: Channel) -> Callable[[bytes], Any]:
    """Return the function that reads the messages of a channel.

    Raises
    ------
    Exception
        Of any kind, as protobuf raises many: the schema is missing, no set of descriptors, or
        does not define the type.
    """
    if channel.schema_encoding != "protobuf":
        raise ValueError(f"it is written in {channel.schema_encoding[:50]!r}, expected protobuf")
    described = descriptor_pb2.FileDescriptorSet.FromString(channel.schema)
    files = {file.name: file for file in described.file}
    pool = descriptor_pool.DescriptorPool()

    def add(name: str) -> None:
        """Add a file after those that it imports; a set may hold them in any order."""
        file = files.pop(name, None)
        if file is not None:
            for imported in file.dependency:
                add(imported)
            pool.Add(file)

    for name in list(files):
        add(name)
    type_ = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel.type))
    return type_.FromString
