"""``mls completion``: what a shell needs to complete the words of a command line.

What a word can be completed to follows from what the help calls it, so that commands need not say
it again. The shell then calls the program with `VARIABLE` set, and click answers it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import redirect_stderr, suppress
from io import StringIO
from itertools import chain
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem, get_completion_class

VARIABLE = "_MLS_COMPLETE"
"""The variable of the environment in which a shell asks for completions."""

Items = list[CompletionItem]

# What click's scripts lack: a value follows NAME=, and no space.
_NO_SPACE = {
    "bash": (
        "COMPREPLY+=($value)",
        "COMPREPLY+=($value)\n            [[ $value == *= ]] && compopt -o nospace",
    ),
    "zsh": (
        "completions_with_descriptions -U\n",
        'completions_with_descriptions -U ${${key:#*[^=]}:+-S} ${${key:#*[^=]}:+""}\n',
    ),
}


@click.command()
@click.argument("shell", type=click.Choice(("bash", "zsh", "fish")))
def command(shell: str) -> None:
    """Print what a shell needs to complete commands, options, files, topics and parameters.

    bash: put eval "$(mls completion bash)" into ~/.bashrc, and zsh alike into ~/.zshrc;
    fish: mls completion fish > ~/.config/fish/completions/mls.fish
    """
    commands = click.get_current_context().find_root().command
    kind = get_completion_class(shell)
    assert kind is not None
    script = kind(commands, {}, "mls", VARIABLE).source()
    click.echo(script.replace(*_NO_SPACE.get(shell, ("", ""))))


def completed(given: click.Command) -> click.Command:
    """Have the words of a command completed that click knows nothing of; returns the command."""
    if isinstance(given, click.Group):
        for each in given.commands.values():
            completed(each)
    known = {**_BY_WORD, **_BY_OPTION}
    for parameter in given.params:
        word = (parameter.metavar or "").strip("[].").partition(" ")[0]
        names = [word, *parameter.opts]
        finders = [known[name] for name in names if name in known]
        if finders:
            parameter.type = _Completed(parameter.type, finders[-1])
    return given


class _Completed(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # generic since click 8.3
    """A type of values, with what they can be completed to."""

    def __init__(self, kind: Any, find: Callable[[click.Context, str], Items]) -> None:
        self.name = kind.name
        self._kind, self._find = kind, find

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the value as its type has it."""
        return self._kind.convert(value, param, ctx)

    def shell_complete(
        self,
        ctx: click.Context,
        param: click.Parameter,  # noqa: ARG002
        incomplete: str,
    ) -> Items:
        """Return what the word can be completed to; nothing where that cannot be told."""
        # What is wrong with a file is told when the command runs, not while it is typed.
        with suppress(Exception), redirect_stderr(StringIO()):
            return self._find(ctx, incomplete)
        return []


def _files(ctx: click.Context, incomplete: str) -> Items:  # noqa: ARG001
    return [CompletionItem(incomplete, type="file")]


def _folders(ctx: click.Context, incomplete: str) -> Items:  # noqa: ARG001
    return [CompletionItem(incomplete, type="dir")]


def _beginning(words: Iterable[tuple[str, str]], incomplete: str) -> Items:
    return [CompletionItem(word, help=what) for word, what in words if word.startswith(incomplete)]


def _presets(ctx: click.Context, incomplete: str) -> Items:  # noqa: ARG001
    from mlscli.config import PRESETS

    return _beginning(((name, "a preset") for name in PRESETS), incomplete)


def _configurations(ctx: click.Context, incomplete: str) -> Items:
    return _presets(ctx, incomplete) or _files(ctx, incomplete)


def _scenes(ctx: click.Context, incomplete: str) -> Items:  # noqa: ARG001
    from mlscli.scenes.presets import SCENE_PRESETS

    return _beginning(((scene.name, scene.summary) for scene in SCENE_PRESETS), incomplete)


def _settings(ctx: click.Context, incomplete: str) -> Items:  # noqa: ARG001
    """Complete names of parameters, and behind the equals sign the words that they can have."""
    from mlscli.parameters.fields import fields_of
    from mlscli.pipeline.parameters import SECTIONS, Parameters, dotted
    from mlscli.pipeline.stages.registry import STAGES

    words = []
    for part, owner in {"": Parameters, **SECTIONS, **STAGES}.items():
        for name, item in fields_of(owner).items():
            path = dotted(part, name)
            words.append((f"{path}=", item.help))
            values = (*item.words, *(("true", "false") if bool in item.kinds else ()))
            words += [(f"{path}={value}", item.help) for value in values if "=" in incomplete]
    return _beginning(words, incomplete)


def _topics(ctx: click.Context, incomplete: str) -> Items:
    from mlscli.io.messages.registry import CLOUD_TYPES

    return _beginning(
        ((topic.name, topic.type) for topic in _all_topics(ctx) if topic.type in CLOUD_TYPES),
        incomplete,
    )


def _pose_topics(ctx: click.Context, incomplete: str) -> Items:
    return _beginning(
        ((topic.name, topic.type) for topic in _all_topics(ctx) if topic.poses), incomplete
    )


def _all_topics(ctx: click.Context) -> Iterator[Any]:
    """Yield the topics of the recordings that stand on the line already."""
    from mlscli.io.messages.topic import TopicSource
    from mlscli.io.reading.formats import open_source
    from mlscli.io.source import Reading

    given = [value if isinstance(value, tuple) else (value,) for value in ctx.params.values()]
    # Before an option without its value, arguments stand unread.
    for path in chain(ctx.args, *given):
        if isinstance(path, str) and Path(path).exists():
            source = open_source(Path(path), Reading())
            if isinstance(source, TopicSource):
                yield from source.topics()


# By what the help calls a value, ...
_BY_WORD = {
    **dict.fromkeys(
        ("FILE", "MAP", "SOURCE", "SCAN", "OUT", "A", "B", "OTHER", "OLD.json"), _files
    ),
    "DIR": _folders,
    "TYPE": _scenes,
    "NAME=VALUE": _settings,
}
# ... or by the option where that says too little.
_BY_OPTION = {
    "--config": _configurations,
    "--truth": _files,
    "--preset": _presets,
    "--topic": _topics,
    "--pose-topic": _pose_topics,
}
