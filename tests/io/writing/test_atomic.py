"""What must not be replaced.

Ways to pass without being right: a source is known by its name alone, not where it lies; a folder
that holds it is replaced, or is said to be what it is not.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mlscli.errors import OutputError
from mlscli.io.writing.atomic import refuse_existing, refuse_sources


def test_neither_a_source_nor_a_folder_with_one_is_replaced(tmp_path: Path) -> None:
    source = tmp_path / "flight" / "deep" / "a.txt"
    source.parent.mkdir(parents=True)
    source.write_text("1 2 3")
    link = tmp_path / "link"
    link.symlink_to(source)
    for target in (source, source.parent / ".." / "deep" / "a.txt", link):
        with pytest.raises(OutputError, match=r": is the source itself; choose another name"):
            refuse_existing(target, overwrite=True, sources=[source])
    for target in (tmp_path / "flight", source.parent):
        with pytest.raises(OutputError) as caught:
            refuse_sources(target, [link])
        assert str(caught.value) == f"{target}: holds the source {link}; choose another name"
    beside = source.with_name("b.txt")
    refuse_existing(beside, overwrite=False, sources=[source, tmp_path / "missing"])
    refuse_sources(tmp_path / "new", [source])
