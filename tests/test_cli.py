"""The command line from outside: what it prints where, and its exit status.

Ways to pass without being right: to look at a status that the test itself made, so all runs are
processes of their own; to load late but at the wrong time, so the modules of a process are
counted; to handle signals but leave the unfinished file, so the folder is listed after them.
"""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from mlscli.version import __version__
from tests.helpers.program import heed_interrupts

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}
MLS = [sys.executable, "-m", "mlscli"]

# A run of the real entry point with one more command, whose function the test writes.
PROBE = """
import click, signal, sys, time
from pathlib import Path
from mlscli import cli
from mlscli.errors import *
from mlscli.io.writing.atomic import atomic_write

@click.command()
def command():
    {body}

sys.modules["probe"] = sys.modules["__main__"]
cli.COMMANDS["probe"] = ("probe", "Do what the test says.")
sys.argv = ["mls", *sys.argv[1:]]
cli.main()
"""


def mls(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*MLS, *arguments], capture_output=True, text=True, env=ENVIRONMENT, timeout=60
    )


def probe_arguments(body: str, *options: str) -> list[str]:
    return [sys.executable, "-c", PROBE.format(body=body), *options, "probe"]


def probe(body: str, *options: str) -> subprocess.CompletedProcess[str]:
    arguments = probe_arguments(body, *options)
    return subprocess.run(arguments, capture_output=True, text=True, env=ENVIRONMENT, timeout=60)


def imported_by(*arguments: str) -> set[str]:
    run = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "mlscli", *arguments],
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        check=True,
    )
    return {line.split("|")[-1].strip().split(".")[0] for line in run.stderr.splitlines()}


def dependencies() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    names = {re.split(r"[^\w-]", entry)[0] for entry in project["dependencies"]}
    return {"yaml" if name == "pyyaml" else name for name in names}


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_imports_click_and_no_other_dependency(option: str) -> None:
    assert imported_by(option) & dependencies() == {"click"}


def test_the_count_of_imports_sees_what_a_command_loads() -> None:
    assert {"click", "numpy", "yaml"} <= imported_by("config", "show")


def test_help_lists_every_command_with_what_it_does() -> None:
    run = mls("--help")
    assert (run.returncode, run.stderr) == (0, "")
    for name in ("build", "export", "info", "config"):
        assert re.search(rf"^  {name} +[A-Z].*\.$", run.stdout, re.MULTILINE)


def test_the_version_is_that_of_the_project() -> None:
    assert mls("--version").stdout == f"mls, version {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "mls: Missing command (see 'mls --help')"),
        (["cnofig"], "mls: no command 'cnofig'; did you mean config? (see 'mls --help')"),
        (["--loud"], "mls: No such option"),
        (["config"], "mls config: Missing command"),
        (["config", "show", "--overwrit"], "mls config show: No such option"),
        (["config", "check"], "mls config check: Missing argument 'FILE...'"),
        (["config", "show", "-c"], "mls: Option '-c' requires an argument"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(arguments: list[str], told: str) -> None:
    run = mls(*arguments)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith(told)
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("body", "status", "line"),
    [
        ("return None", 0, ""),
        ("return 3", 3, ""),
        ("raise InputError('a.bag: broken')", 1, "mls: a.bag: broken"),
        ("raise UsageError('no topic')", 2, "mls: no topic"),
        ("raise InputError('two\\nlines \\x1b[31m')", 1, r"mls: two\nlines \x1b[31m"),
        ("open('/no/such')", 1, "mls: /no/such: No such file or directory"),
        ("raise OSError(28, 'No space left')", 1, "mls: standard output: No space left"),
        ("raise MemoryError", 1, "mls: out of memory"),
        ("raise KeyError('k')", 1, "mls: internal error: KeyError: 'k'; run again as"),
        ("raise click.Abort", 130, "mls: interrupted"),
        ("raise KeyboardInterrupt", 130, "mls: interrupted"),
    ],
)
def test_what_a_command_ends_in_is_the_status_and_a_line(body: str, status: int, line: str) -> None:
    run = probe(body)
    assert run.returncode == status
    assert run.stdout == ""
    assert run.stderr.strip().startswith(line)
    assert len(run.stderr.strip().splitlines()) == (1 if line else 0)


def test_each_fault_of_a_configuration_is_a_line() -> None:
    run = probe("raise ConfigError(['a:1:2: x: odd', 'a:3:4: y: odder'])")
    assert run.returncode == 2
    assert run.stderr == "mls: a:1:2: x: odd\nmls: a:3:4: y: odder\n"


def test_debug_shows_where_an_error_arose() -> None:
    run = probe("raise InputError('a.bag: broken')", "--debug")
    assert run.returncode == 1
    assert "Traceback" in run.stderr
    assert run.stderr.endswith("mls: a.bag: broken\n")


@pytest.mark.parametrize(("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_leaves_no_unfinished_file_behind(
    number: signal.Signals, status: int, tmp_path: Path
) -> None:
    body = f"""
    with atomic_write({str(tmp_path / "map.npz")!r}) as stream:
        stream.write(b"half")
        click.echo("writing")
        time.sleep(60)
    """
    with subprocess.Popen(
        probe_arguments(body),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
        preexec_fn=heed_interrupts,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        assert len(list(tmp_path.iterdir())) == 1
        process.send_signal(number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == status
    assert errors == "mls: interrupted\n"
    assert list(tmp_path.iterdir()) == []


def test_what_a_signal_breaks_is_no_error_of_its_own() -> None:
    body = """
    try:
        signal.raise_signal(signal.SIGTERM)
    except BaseException as error:
        raise RuntimeError("broken off") from error
    """
    run = probe(body)
    assert (run.returncode, run.stderr) == (143, "mls: interrupted\n")


def test_an_ignored_interrupt_stays_ignored(tmp_path: Path) -> None:
    body = f"""
    click.echo("ready")
    while not Path({str(tmp_path / "go")!r}).exists():
        time.sleep(0.02)
    """
    with subprocess.Popen(
        probe_arguments(body),
        stdout=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        time.sleep(0.2)
        (tmp_path / "go").touch()
        process.communicate(timeout=30)
    assert process.returncode == 0


@pytest.mark.parametrize("arguments", [["--help"], ["config", "show"]])
def test_a_reader_that_goes_away_is_no_error_to_speak_of(arguments: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    run = subprocess.run(
        [*MLS, *arguments], stdout=writer, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    os.close(writer)
    assert run.stderr == ""
    assert run.returncode == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_one_line_and_no_success() -> None:
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [*MLS, "config", "show"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=ENVIRONMENT,
        )
    assert run.returncode == 1
    assert run.stderr == "mls: standard output: No space left on device\n"


@pytest.mark.parametrize("closing", ["2>&-", "2>/dev/full", "1>&- 2>&-"])
def test_the_work_is_done_also_where_nobody_can_hear_of_it(tmp_path: Path, closing: str) -> None:
    body = "options.say('heard'); options.tell('a result'); pathlib.Path('made').touch()"
    program = (
        f"from mlscli import cli; from mlscli.commands import options; import pathlib\n"
        f"def work(run): cli._say('notice'); {body}; return 0\n"
        "cli._status = work; cli.main()"
    )
    command = f"{shlex.quote(sys.executable)} -c {shlex.quote(program)} {closing}"
    assert subprocess.run(command, shell=True, cwd=tmp_path, check=False).returncode == 0
    assert (tmp_path / "made").exists()


def test_the_package_names_its_calls_and_loads_none_of_them_by_itself() -> None:
    code = "import mlscli, sys; print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=ENVIRONMENT, check=True
    )
    assert not dependencies() & set(run.stdout.split())
    code = "import mlscli; print(mlscli.load_parameters('plain') == mlscli.Parameters(pipeline=()))"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=ENVIRONMENT, check=True
    )
    assert run.stdout == "True\n"
