"""Texts for the tests to read, and the clouds in them."""

from __future__ import annotations

from pathlib import Path

from mlscli.io.clouds.text import TextCloud
from mlscli.io.source import Cloud


def text(folder: Path, content: str | bytes, name: str = "cloud.txt") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(folder: Path, content: str | bytes, columns: str | None = None) -> list[Cloud]:
    return list(TextCloud(text(folder, content), columns).clouds())


def clouds_of(folder: Path, content: str | bytes, columns: str | None = None) -> list[object]:
    return [cloud.points.tolist() for cloud in read(folder, content, columns)]


def one_cloud(folder: Path, content: str | bytes, columns: str | None = None) -> object:
    clouds = clouds_of(folder, content, columns)
    assert len(clouds) == 1
    return clouds[0]
