"""From a deserialized message of any type that is read to clouds or poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mlscli.io.messages.poses import POSE_TYPES, TRANSFORM_TYPES, PoseRow, stamped
from mlscli.io.messages.registry import CLOUD_TYPES
from mlscli.io.source import StampedPoses


def _alone(decode: Callable[[Any], list[PoseRow]]) -> Callable[[Any], list[StampedPoses]]:
    return lambda message: stamped([decode(message)])[0]


POSES = {type_: _alone(decode) for type_, decode in {**POSE_TYPES, **TRANSFORM_TYPES}.items()}
DECODERS: dict[str, Callable[[Any], list[Any]]] = {**CLOUD_TYPES, **POSES}
