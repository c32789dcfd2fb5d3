"""`mls synth`: synthetic flights over scenes, with their exact truth, and over scans."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import click

from mlscli.commands import report
from mlscli.commands.flying import features, noisy, seeing
from mlscli.commands.maps import TRUTH
from mlscli.commands.options import (
    PARTLY_READ,
    as_json,
    overwrite,
    refuse_given,
    say,
    tell,
)
from mlscli.commands.piped import piped
from mlscli.commands.reading import FormatsInHelp, Numbers, files_named, read_points, reading
from mlscli.errors import UsageError, with_options

if TYPE_CHECKING:
    from mlscli.scenes.flight import Flight
    from mlscli.scenes.route import CameraPoses
    from mlscli.scenes.scan_flight import ScanFlight
    from mlscli.scenes.surfaces import Scene

Kind = Literal["text", "ros1", "ros2", "mcap"]

ENDINGS: dict[str, Kind] = {
    ".txt": "text", ".csv": "text", ".xyz": "text", ".bag": "ros1", ".mcap": "mcap", "": "ros2",
}  # fmt: skip

# What makes a scene and its truth; and what goes with a scan, beside how it is read.
_OF_SCENES = (
    *("type_", "file", "add_param", "size", "grid", "cell_size", "gap_size", "thickness"),
    "anew",
)
_OF_SCANS = "features", "legs", "survey"


@click.command(cls=FormatsInHelp)
@click.option("--type", "type_", metavar="TYPE", help="Scene by name or number; see --list.")
@click.option("--scene", "file", metavar="FILE", help="Scene in YAML: a list of surfaces.")
@click.option(
    "--cloud",
    "clouds",
    multiple=True,
    metavar="SCAN",
    callback=piped,
    help="A dense scan of a real place, to be flown over as a scene. Several are taken as one.",
)
@click.option("--list", "listing", is_flag=True, help="List the scenes there are.")
@click.option(
    "--add-param",
    type=float,
    metavar="A",
    help="The scene's crucial dimension: height of a bridge, diameter of holes, offset of planes.",
)
@click.option("--size", type=int, metavar="N", help="Houses along each side of the village.")
@click.option(
    "--grid",
    type=float,
    default=0.1,
    show_default=True,
    metavar="S",
    help="Spacing of the points on a scene.",
)
@features
@noisy
@click.option(
    "--reference",
    type=float,
    metavar="D",
    help="Distance at which --noise slam has the sigma; by default 2, over a scan the median "
    "distance of what is seen.",
)
@click.option(
    "--salt-pepper",
    type=float,
    default=0.1,
    show_default=True,
    metavar="P",
    help="Chance of 5 times the sigma in z; with slam, of a wrong correspondence.",
)
@click.option(
    "--outliers",
    type=float,
    default=0.0,
    show_default=True,
    metavar="P",
    help="Share of points at any height of the scene.",
)
@click.option(
    "--holes",
    type=Numbers("N,D"),
    default="0,0",
    help="So many round places without texture, of this diameter.",
)
@click.option(
    "--seed", type=int, default=0, show_default=True, metavar="N", help="Of all that is chance."
)
@click.option("--all-points", is_flag=True, help="Record every point, seen or not.")
@click.option(
    "--anew",
    is_flag=True,
    help="The survey and each leg find their points anew; by default a point is found once.",
)
@click.option(
    "--route-height",
    type=float,
    metavar="H",
    help="Of the survey above the scene's top; by default 1.5, over a scan a tenth of its width.",
)
@click.option(
    "--survey/--no-survey",
    default=None,
    help="With --cloud: fly lanes above the scan, or only within it; by default as suits it.",
)
@click.option(
    "--legs",
    metavar="FILE",
    callback=piped,
    help="With --cloud: the route in YAML, a list of legs; by default one is found.",
)
@seeing
@click.option(
    "--cell-size", type=float, default=0.15, show_default=True, metavar="C", help="Of the truth."
)
@click.option(
    "--gap-size", type=float, default=0.5, show_default=True, metavar="G", help="Of the truth."
)
@click.option(
    "--thickness", type=float, metavar="T", help="Of the truth; by default the cell size."
)
@click.option(
    "-o",
    "--output",
    metavar="OUT",
    help="Text (.txt, .csv, .xyz), ROS 1 bag (.bag), MCAP (.mcap) or, without an ending, a ROS 2 "
    "folder; by default the scene's name with .txt, the scan's with .flight.txt.",
)
@click.option("--sensor-frame", is_flag=True, help="In bags: clouds in the camera's frame.")
@overwrite
@as_json
@reading
def command(
    type_: str | None,
    file: str | None,
    clouds: tuple[str, ...],
    listing: bool,
    add_param: float | None,
    size: int | None,
    grid: float,
    features: int | None,
    sigma: tuple[float, float],
    noise: Literal["thesis", "slam"],
    reference: float | None,
    salt_pepper: float,
    outliers: float,
    holes: tuple[float, float],
    seed: int,
    all_points: bool,
    anew: bool,
    route_height: float | None,
    survey: bool | None,
    legs: str | None,
    field_of_view: float,
    reach: float | None,
    cell_size: float,
    gap_size: float,
    thickness: float | None,
    output: str | None,
    sensor_frame: bool,
    overwrite: bool,
    as_json: bool,
    **selection: Any,
) -> int:
    """Make a synthetic flight over a scene or a scan.

    Over a scene, its exact truth is written, too: a map of the surfaces themselves, OUT.truth.npz;
    mls compare --truth scores a map by it. With --route, the craft flies its poses, those of mls
    explore for example: the camera looks along -z of the craft, without attitudes straight down.

    Over a scan (--cloud SCAN), the truth is the scan: mls compare --cloud SCAN. It is read as mls
    build would, with the same options: FORMATS.
    """
    if listing:
        tell(_scenes(as_json))
        return 0
    if clouds:
        refuse_given("belongs to a scene, and --cloud is a scan", *_OF_SCENES)
    else:
        # Over a scene, the route is what is flown.
        of_scans = (*_OF_SCANS, *(name for name in selection if name != "route"))
        refuse_given("goes with --cloud SCAN", *of_scans)
    from mlscli.scenes.flight import Craft
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.surfaces import Scatter

    begin = time.perf_counter()
    count, diameter = holes
    if not count.is_integer():
        raise UsageError(f"--holes {count:g},{diameter:g}: expected a whole number of holes")
    flown: dict[str, Any] = {
        "noise": Noise(noise, Scatter(*sigma), salt_pepper, outliers, reference),
        "craft": Craft(route_height, field_of_view, reach),
        "holes": (int(count), diameter),
        "seed": seed,
        "visibility": not all_points,
    }
    inputs = (*clouds, *files_named(selection), *filter(None, (file, legs)))
    written = _Output(output, sensor_frame, overwrite, inputs)
    if clouds:
        if all_points and features is not None:
            raise UsageError(f"--features {features}: --all-points records every point; drop one")
        thinned = {} if features is None else {"features": features}
        account = _over_scan(clouds, selection, legs, written, survey=survey, **thinned, **flown)
    else:
        scene = _scene(type_, file, add_param, size)
        grids = (cell_size, gap_size, cell_size if thickness is None else thickness)
        flown |= {"grid": grid, "anew": anew, "route": _poses(selection["route"])}
        account = _over_scene(scene, grids, written, **flown)
    account["seconds"] = time.perf_counter() - begin
    click.echo(json.dumps(account, indent=2)) if as_json else tell(_text(account))
    return PARTLY_READ if account.get("lost") else 0


def _scenes(as_json: bool) -> str:
    from mlscli.scenes.presets import SCENE_PRESETS

    if as_json:
        rows = [
            {
                "number": preset.number,
                "name": preset.name,
                "summary": preset.summary,
                "add_param": preset.dimension._asdict() if preset.dimension else None,
            }
            for preset in SCENE_PRESETS
        ]
        return json.dumps(rows, indent=2)
    lines = []
    for preset in SCENE_PRESETS:
        dimension = preset.dimension
        what = f" (--add-param {dimension.default:g}: {dimension.what})" if dimension else ""
        lines.append(
            (f"{preset.number or '':>1} {preset.name}", with_options(preset.summary) + what)
        )
    return report.lines(lines)


def _scene(type_: str | None, file: str | None, add_param: float | None, size: int | None) -> Scene:
    from mlscli.scenes.presets import make
    from mlscli.scenes.sceneio import load_scene

    if (type_ is None) == (file is None):
        found = "both" if file else "neither"
        raise UsageError(
            f"found {found} of --type and --scene, expected one, or --cloud; see --list"
        )
    if type_ is not None:
        return make(type_, add_param, size)
    for option, value in (("--add-param", add_param), ("--size", size)):
        if value is not None:
            raise UsageError(f"{option} {value:g}: belongs to a --type; a --scene says it itself")
    assert file is not None
    return load_scene(file)


def _kind(target: Path) -> Kind:
    """Return the format that an output's name asks for."""
    if target.is_dir():
        return "ros2"
    ending = target.suffix.lower()
    if ending not in ENDINGS:
        known = ", ".join(filter(None, ENDINGS))
        raise UsageError(f"{target}: does not end in {known}, nor has no ending (ROS 2 folder)")
    return ENDINGS[ending]


class _Output(NamedTuple):
    """What is to be written.

    Attributes
    ----------
    name : str or None
        The file or folder; None: by the name of what is flown over.
    sensor_frame, overwrite : bool
        As in `write_bag`.
    inputs : sequence of str
        What is read, and never replaced.
    """

    name: str | None
    sensor_frame: bool
    overwrite: bool
    inputs: Sequence[str]

    def target(self, usual: str) -> tuple[Path, Kind]:
        """Return what is written and its format; refuse what must not be, before any work."""
        from mlscli.io.writing.atomic import refuse_existing, refuse_sources
        from mlscli.io.writing.flight_bag import refuse_existing_bag

        target = Path(usual if self.name is None else self.name)
        kind = _kind(target)
        if self.sensor_frame and kind == "text":
            raise UsageError(f"--sensor-frame: {target} is text, which has no frames; name a bag")
        refuse_sources(target, self.inputs)
        if kind == "text":
            refuse_existing(target, overwrite=self.overwrite)
        else:
            refuse_existing_bag(target, kind, overwrite=self.overwrite)
        return target, kind

    def write(self, target: Path, kind: Kind, flight: Flight | ScanFlight) -> None:
        """Write a flight."""
        if kind == "text":
            from mlscli.io.writing.flight_text import write_text

            write_text(target, flight.keyframes, overwrite=self.overwrite)
        else:
            from mlscli.io.writing.flight_bag import write_bag

            write_bag(
                target,
                flight.keyframes,
                flight.attitudes,
                kind,
                sensor_frame=self.sensor_frame,
                overwrite=self.overwrite,
            )


def _poses(file: str | None) -> CameraPoses | None:
    """Return the poses of a trajectory."""
    if file is None:
        return None
    from mlscli.io.clouds.trajectory import read_trajectory
    from mlscli.scenes.route import poses_of

    read = read_trajectory(Path(file))
    for note in (*read.notes, *read.losses):
        say(f"mls: {note}")
    return poses_of(read.positions, read.attitudes)


def _over_scene(
    scene: Scene,
    grids: tuple[float, float, float],
    written: _Output,
    **flown: Any,
) -> dict[str, Any]:
    """Fly over a scene, write the recording and the truth, and return the account."""
    from mlscli.io.writing.atomic import refuse_existing
    from mlscli.io.writing.npz import write_map
    from mlscli.scenes.flight import fly
    from mlscli.scenes.truth import truth

    target, kind = written.target(f"{scene.name}.txt")
    stem = target.name if kind == "ros2" else target.stem
    beside = target.with_name(f"{stem}{TRUTH}")
    refuse_existing(beside, overwrite=written.overwrite, sources=written.inputs)
    true = truth(scene, *grids)
    flight = fly(scene, **flown)
    written.write(target, kind, flight)
    write_map(beside, true, overwrite=written.overwrite)
    return {
        "recording": str(target),
        "truth": str(beside),
        "scene": scene.name,
        "points": flight.points,
        "keyframes": len(flight.keyframes),
        "surfaces": len(scene.surfaces),
        "truth_patches": true.size,
    }


def _over_scan(
    clouds: Sequence[str],
    selection: dict[str, Any],
    legs: str | None,
    written: _Output,
    **flown: Any,
) -> dict[str, Any]:
    """Fly over a scan, write the recording, and return the account.

    Parameters
    ----------
    clouds : sequence of str
        The files of the scan.
    selection : dict
        The options with which they are read, as for `mlscli.open_recording`.
    legs : str or None
        The file with the route, if it is given by hand.
    written : _Output
    flown
        As for `fly_scan`.
    """
    from mlscli.io.reading.recording import open_recording
    from mlscli.scenes.scan_flight import fly_scan
    from mlscli.scenes.scans import Scan
    from mlscli.scenes.sceneio import load_legs

    first = Path(clouds[0]).resolve()
    target, kind = written.target(f"{first.name if first.is_dir() else first.stem}.flight.txt")
    by_hand = () if legs is None else load_legs(legs)
    recording = open_recording(*clouds, **selection)
    scan = Scan.of(", ".join(clouds), read_points(recording)).with_legs(*by_hand)
    flight = fly_scan(scan, **flown)
    written.write(target, kind, flight)
    return {
        "recording": str(target),
        "cloud": list(clouds),
        "points": flight.points,
        "keyframes": len(flight.keyframes),
        "scan_points": len(scan.xyz),
        "scan_seen": flight.seen,
        "median_range": flight.range,
        "lost": recording.losses,
    }


def _text(account: dict[str, Any]) -> str:
    what = (
        f"{account['recording']}: {account['points']:,} points in {account['keyframes']:,} "
        "keyframes over "
    )
    if "cloud" in account:
        return (
            f"{what}a scan of {account['scan_points']:,}, {100 * account['scan_seen']:.1f} % of it "
            f"seen, from {account['median_range']:.3g} away in the median; the truth is the scan, "
            f"{', '.join(account['cloud'])}"
        )
    return (
        f"{what}{account['surfaces']:,} surfaces; {account['truth']}: "
        f"{account['truth_patches']:,} true patches"
    )
