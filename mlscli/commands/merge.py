"""``mls merge``: maps of one grid as one."""

from __future__ import annotations

from pathlib import Path

import click

from mlscli.commands import report
from mlscli.commands.options import as_json, overwrite, tell
from mlscli.errors import InputError, UsageError


@click.command()
@click.argument("sources", metavar="MAP MAP...", nargs=-1, required=True)
@click.option("-o", "--output", metavar="FILE", required=True, help="The map (.npz) to write.")
@overwrite
@as_json
def command(sources: tuple[str, ...], output: str, overwrite: bool, as_json: bool) -> None:
    """Merge maps of one grid and one frame, as if their flights had followed one another.

    Measured patches within the gap size become one, as if the points of all flights had been read
    at once; inserted ones give way to what another map measured. No stage is run again: what was
    taken for an outlier, or for a gap, was judged by each flight alone.
    """
    if len(sources) < 2:
        raise UsageError("MAP MAP...: expected two maps or more")

    from mlscli.io.writing.atomic import refuse_existing

    target = Path(output)
    refuse_existing(target, overwrite=overwrite, sources=list(sources))

    from mlscli.io.writing.npz import read_map, write_map
    from mlscli.maps.merging import merge_all
    from mlscli.maps.summary import describe

    surfaces = [read_map(source) for source in sources]
    try:
        merged = merge_all(surfaces)
    except (InputError, UsageError) as error:
        raise type(error)(f"{', '.join(sources)}: {error}") from None
    write_map(target, merged, overwrite=overwrite)
    description = describe(merged)
    if as_json:
        import json

        click.echo(json.dumps({"file": output, "sources": list(sources), **description}, indent=2))
        return
    rows = [*report.map_rows(description), ("keyframes", f"{description['keyframes']:,}")]
    if merged.free is None and any(surface.free is not None for surface in surfaces):
        rows.append(("free space", "left out, as not all of the maps have it"))
    tell(f"{output}\n{report.lines(rows)}")
