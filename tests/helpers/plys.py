"""PLY files, header and body."""

from __future__ import annotations


def ply(encoding: str, *header: str, body: bytes, ending: str = "\n") -> bytes:
    """Return a file of an encoding, with these lines between its format and the end of header."""
    lines = ["ply", f"format {encoding} 1.0", *header, "end_header", ""]
    return ending.join(lines).encode() + body
