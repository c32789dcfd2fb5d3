"""Speed, topic by topic: ``python -m benchmarks.run`` (five minutes; ``--topic`` chooses).

Each topic is a table: the program beside what a user would pick instead, measured in turns in the
same run; figures are medians. The machine's own limits come first. A level is what the figure, or
its ratio to that of the other, has to reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

import click

from benchmarks.table import HEAD, SHORT_HEAD, Row, Timer, lines

TOPICS = {
    "machine": "The machine's own limits",
    "median": "Median filter",
    "patches": "Points into patches",
    "batch": "A batch into a growing map",
    "stages": "Map stages",
    "pipeline": "The whole pipeline",
    "queries": "Queries of maps",
    "meshes": "Meshes and their files",
    "exports": "What planners read",
    "reading": "Bags to points",
    "clouds": "Files of points to keyframes",
    "plausibility": "What plausibility costs of reading",
    "sizes": "Sizes of cells",
    "commands": "Whole commands",
    "memory": "Memory of builds",
    "replays": "Replays",
    "pages": "Pages",
}
SLOW = ("memory", "replays", "pages")
"""Topics that take a minute or more each: only where they are chosen, or with ``--slow``."""


def rows(topic: str, timer: Timer) -> Iterator[Row]:
    """Yield the rows of a topic, one of `TOPICS`, as they are measured."""
    found: Iterator[Row] = import_module(f"benchmarks.topics.{topic}").rows(timer)
    return found


@click.command()
@click.option(
    "--topic", "topics", multiple=True, type=click.Choice(list(TOPICS)), help="Measure this only."
)
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True)
@click.option("--cpu", is_flag=True, help="Measure CPU time, of all threads, not wall time.")
@click.option("--slow", is_flag=True, help="Measure what takes minutes, too.")
@click.option("--short", is_flag=True, help="Print one table of the rows that the README shows.")
def main(topics: tuple[str, ...], repeats: int, cpu: bool, slow: bool, short: bool) -> None:
    """Print the tables."""
    timer = Timer(repeats, cpu, slow)
    topics = topics or tuple(topic for topic in TOPICS if slow or topic not in SLOW)
    if short:
        chosen = (
            row.short_cells(f"python -m benchmarks.run --topic {topic}")
            for topic in topics
            for row in rows(topic, timer)
            if row.short
        )
        for line in lines(SHORT_HEAD, chosen):
            click.echo(line)
        return
    for topic in ("machine", *(topic for topic in topics if topic != "machine")):
        click.echo(f"\n### {TOPICS[topic]}\n")
        for line in lines(HEAD, (row.cells() for row in rows(topic, timer))):
            click.echo(line)


if __name__ == "__main__":
    main()
