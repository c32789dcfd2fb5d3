"""``mls warmup``: compile the kernels before they are needed."""

from __future__ import annotations

import click

from mlscli.commands.options import say
from mlscli.commands.progress import ProgressBar
from mlscli.errors import OutputError


@click.command()
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Compile in N processes; by default one for each processor.",
)
def command(jobs: int | None) -> None:
    """Compile what is otherwise compiled when it is first needed, as for a container's image.

    What is there already is not compiled again. It is compiled for any processor of the platform,
    so that the image can run elsewhere.
    """
    from mlscli.runtime.threads import processors
    from mlscli.runtime.warming import warm_up

    with ProgressBar() as progress:
        warmed = warm_up(jobs or processors(), lambda *done: progress("compiling", *done))
    if warmed.failed:
        raise OutputError(f"{len(warmed.failed)} kernels cannot be compiled: {warmed.failed[0]}")
    say(f"{warmed.folder}: {warmed.compiled} kernels compiled, {warmed.present} were there")
