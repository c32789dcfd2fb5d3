"""What the tests look at in the keyframes of a recording."""

from __future__ import annotations

from mlscli.io.reading.recording import Recording


def xs(recording: Recording) -> list[float]:
    return [x for keyframe in recording.keyframes() for x in keyframe.points[:, 0].tolist()]
