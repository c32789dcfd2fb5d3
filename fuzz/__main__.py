"""Try the program with hostile input.

    python -m fuzz --seconds 600                        # every target, ten minutes
    python -m fuzz --targets mcap,map-info --inputs 500 --seed 3

Prints a table, and exits with 1 where something was found. Each finding's input is kept, with the
command that tries it again in again.txt.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from fuzz.campaign import Campaign, made, table, take_turns
from fuzz.child import Limits
from fuzz.targets import TARGETS, Seed
from mlscli.runtime.kernel_types import read
from mlscli.runtime.warming import KERNELS
from tests.helpers.program import warm


def main() -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m fuzz", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--targets", default=",".join(TARGETS), help="by default all")
    parser.add_argument("--seconds", type=float, help="how long; by default 60")
    parser.add_argument("--inputs", type=int, help="how many of each target, in place of a time")
    parser.add_argument("--seed", type=int, default=1, help="of the dice")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-found"), help="where findings go")
    given = parser.parse_args()
    names = given.targets.split(",")
    if unknown := [name for name in names if name not in TARGETS]:
        parser.error(f"no target {unknown[0]!r}; there are {', '.join(TARGETS)}")
    if given.seconds is None and given.inputs is None:
        given.seconds = 60.0

    # For a few inputs it would take longer than it saves.
    (_load_all if given.inputs is None or given.inputs > 30 else warm)()
    seeds = made(partial(_seeds_of, names))
    campaigns = [
        Campaign(name, TARGETS[name], seeds[name], given.seed, Limits(), given.keep)
        for name in names
    ]
    has_found = False
    for campaign, finding in take_turns(campaigns, given.seconds, given.inputs):
        has_found = True
        sys.stderr.write(f"{campaign.name}: {finding.kind}: {finding.words[:300]!r}\n")
    sys.stdout.write(table({campaign.name: campaign.tally for campaign in campaigns}))
    return int(has_found)


def _load_all() -> None:
    """Load all modules and kernels, so that no fork need do so."""
    import mlscli

    warm()
    for module in walk_packages(mlscli.__path__, "mlscli."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    for name in ("laspy", "lazrs", "mcap.reader", "rosbags.typesys", "lz4.frame", "zstandard"):
        import_module(name)
    for line in KERNELS.read_text(encoding="utf-8").splitlines():
        kernel, types = read(line)
        kernel.compile(types)


def _seeds_of(names: list[str], folder: Path) -> dict[str, list[Seed]]:
    # It imports what starts threads.
    from fuzz.seeds import seeds_of

    return {name: seeds_of(name, folder / name) for name in names}


if __name__ == "__main__":
    sys.exit(main())
