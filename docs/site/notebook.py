"""Run a notebook, and write it as a page: its text, its code, and what each cell shows."""

from __future__ import annotations

import json
import os
from base64 import b64decode
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs/first-hour.ipynb"


class Cell(NamedTuple):
    """A cell, and what came of it.

    Attributes
    ----------
    kind : str
        ``markdown`` or ``code``.
    source : str
    printed : str
        What it printed.
    shown : dict of str to str or bytes
        What notebooks show of its value, by media type, as ``image/png``.
    """

    kind: str
    source: str
    printed: str = ""
    shown: dict[str, Any] = {}  # noqa: RUF012  # never changed


def run(path: Path, folder: Path) -> Iterator[Cell]:
    """Run a notebook in a folder, cell by cell, as Jupyter does.

    Raises
    ------
    RuntimeError
        A cell ended in an error.
    """
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output
    from traitlets.config import Config

    os.environ.setdefault("IPYTHONDIR", str(folder / ".ipython"))
    # Nothing of the notebook is kept in the user's history.
    without = Config({"HistoryManager": {"enabled": False}})
    shell: Any = InteractiveShell(config=without)  # type: ignore[no-untyped-call]
    with chdir(folder):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            source = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                yield Cell("markdown", source)
                continue
            with capture_output(display=False) as said:
                done = shell.run_cell(source)
            if not done.success:
                error = done.error_before_exec or done.error_in_exec
                raise RuntimeError(f"{path.name}: {source}\n{error!r}")
            # The value is printed, too; only a notebook shows it as a picture.
            printed = said.stdout.partition("Out[")[0]
            shown: dict[str, Any] = {}
            if done.result is not None:
                shown, _ = shell.display_formatter.format(done.result)
            yield Cell("code", source, printed, shown)


def page(path: Path, folder: Path) -> str:
    """Run a notebook and return it as Markdown; its pictures are written into the folder."""
    import tempfile

    parts = []
    with tempfile.TemporaryDirectory() as scratch:
        for number, cell in enumerate(run(path, Path(scratch))):
            if cell.kind == "markdown":
                parts.append(cell.source)
                continue
            parts.append(f"```python\n{cell.source}\n```")
            if cell.printed:
                parts.append(f"```text\n{cell.printed.rstrip()}\n```")
            if picture := cell.shown.get("image/png"):
                name = f"{path.stem}-{number}.png"
                content = picture if isinstance(picture, bytes) else b64decode(picture)
                (folder / name).write_bytes(content)
                parts.append(f"![What the cell shows]({name})")
            elif html := cell.shown.get("text/html"):
                parts.append(f"```{{raw}} html\n{html}\n```")
    return "\n\n".join(parts) + "\n"
