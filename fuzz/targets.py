"""The targets: which file is changed, and the commands that are given it.

Commands run in a folder with the inputs in ``in/`` and an empty ``out/``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple


class Seed(NamedTuple):
    """The inputs of a command.

    Attributes
    ----------
    files : dict of bytes
        Contents by their paths below ``in/``.
    changed : tuple of str
        Which of them are changed.
    """

    files: Mapping[str, bytes]
    changed: tuple[str, ...]

    @classmethod
    def read(cls, path: Path, name: str, beside: Mapping[str, bytes]) -> Seed:
        """Return a file, or all files of a folder, under another name, and others beside it."""
        held = (
            [path] if path.is_file() else sorted(each for each in path.rglob("*") if each.is_file())
        )
        files = {
            name if each == path else f"{name}/{each.relative_to(path)}": each.read_bytes()
            for each in held
        }
        return cls({**files, **beside}, tuple(files))

    def write(self, folder: Path) -> None:
        """Write the files below a folder."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


class Target(NamedTuple):
    """What is tried.

    Attributes
    ----------
    damaged : str
        The name of the file or folder that is changed.
    commands : tuple of str
        The words behind ``mls``; each input is tried with one of them.
    has_others : bool
        Whether they are given a good cloud and a good map, too.
    answers : frozenset of int
        Exit statuses that are answers here, and no errors.
    main : callable, optional
        What runs; by default the program.
    """

    damaged: str
    commands: tuple[str, ...]
    has_others: bool = False
    answers: frozenset[int] = frozenset({0, 3})
    main: Callable[[], object] | None = None


_BUILDS = (
    "info in/recording",
    "info in/recording --json",
    "build in/recording -o out/map.npz",
    "build in/recording -o out/map.npz --free-space -c plain",
    "build in/recording -o out/map.npz --set map.cell_size=0.5 --memory 500M",
    "build in/recording -o out/map.npz --set map.cell_size=2 --growing --replay out/map.mcap",
    "build in/recording -o out/map.npz --dry-run --up -y",
)
_SOURCES = (
    *("ros1", "ros2", "sqlite", "mcap", "compressed", "text", "ply", "pcd", "pts", "ptx"),
    *("las", "colmap", "opensfm"),
)
_EXPORTS = {
    "ply": "ply", "obj": "obj", "glb": "glb", "mcap": "mcap", "nav2": "yaml", "octomap": "bt",
    "pcd": "pcd", "las": "las", "grid-map": "mcap", "npz": "npz", "netcdf": "nc", "geotiff": "tif",
    "sdf": "sdf",
}  # fmt: skip
_OF_MAPS = {
    "info": ("info in/map.npz", "info in/map.npz --json"),
    "query": ("query in/map.npz --at 1,2 --at 1,2,0.5", "query in/map.npz --at 1,2 --json"),
    "explore": (
        "explore in/map.npz --craft 0.6,0.4 --range 6 --views 2 -o out/views.csv",
        "explore in/map.npz --craft 0.6,0.4 --range 6 --views 2 -o out/a.plan --origin 47,8,400",
    ),
    "export": tuple(
        f"export in/map.npz --format {name} -o out/map.{ending}"
        for name, ending in _EXPORTS.items()
    ),
    "plot": (
        "plot in/map.npz -o out/map.png",
        "plot in/map.npz -o out/map.svg --section 0,0,3,3",
        "plot in/map.npz -o out/map.png --compare in/good.npz",
    ),
    "view": (
        "view in/map.npz --html out/map.html",
        "view in/map.npz --html out/map.html --points in/cloud.txt",
    ),
    "merge": ("merge in/map.npz in/good.npz -o out/both.npz",),
    "align": ("align in/map.npz in/good.npz -o out/onto.json -o out/moved.npz --no-scale",),
}

TARGETS: dict[str, Target] = {
    **{name: Target("recording", _BUILDS) for name in _SOURCES},
    **{f"map-{name}": Target("map.npz", words, True) for name, words in _OF_MAPS.items()},
    "map-clearance": Target(
        "map.npz",
        (
            "clearance in/map.npz --craft 0.6,0.4 --along route --html out/way.html",
            "clearance in/map.npz --craft 0.6,0.4 --line 0,2,1,3,2,1 --mcap out/way.mcap",
        ),
        True,
        frozenset({0, 1, 4}),
    ),
    "map-compare": Target(
        "map.npz",
        (
            "compare in/map.npz in/good.npz",
            "compare in/good.npz in/map.npz --changed --json",
            "compare in/map.npz --truth in/good.npz",
            "compare in/map.npz --cloud in/cloud.txt",
        ),
        True,
        frozenset({0, 1, 3}),
    ),
    "config": Target(
        "config.yaml",
        (
            "config check in/config.yaml",
            "config show -c in/config.yaml",
            "build in/cloud.txt -c in/config.yaml -o out/map.npz",
        ),
        True,
    ),
    "scene": Target("scene.yaml", ("synth --scene in/scene.yaml --grid 0.5 -o out/flight.txt",)),
    "legs": Target(
        "legs.yaml",
        ("synth --cloud in/cloud.txt --legs in/legs.yaml --features 30 -o out/flight.txt",),
        True,
    ),
    "route": Target(
        "route.txt",
        (
            "build in/cloud.txt --route in/route.txt -o out/map.npz",
            "synth --type bridge --grid 1 --route in/route.txt -o out/flight.txt",
        ),
        True,
    ),
    "path": Target(
        "path.txt",
        ("clearance in/good.npz --craft 0.6,0.4 --path in/path.txt --html out/way.html",),
        True,
        frozenset({0, 1, 3, 4}),
    ),
    "seen": Target(
        "seen.txt",
        (
            "view in/good.npz --html out/map.html --points in/seen.txt",
            "compare in/good.npz --cloud in/cloud.txt --flight in/seen.txt",
        ),
        True,
        frozenset({0, 1, 3}),
    ),
    "times": Target("times.json", ("bench --sizes 20 --compare in/times.json",)),
    "transform": Target(
        "onto.json", ("build in/cloud.txt --transform in/onto.json -o out/map.npz",), True
    ),
}
"""What is tried, by name; `fuzz.seeds.MAKERS` has the seeds of each."""
