"""`mls synth`: synthetic flights over scenes, and their exact truth."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from mlscli.commands import report
from mlscli.commands.options import as_json, overwrite
from mlscli.commands.reading import Numbers
from mlscli.errors import UsageError, with_options

if TYPE_CHECKING:
    from mlscli.scenes.flight import Flight
    from mlscli.scenes.scan_flight import ScanFlight
    from mlscli.scenes.surfaces import Scene

Kind = Literal["text", "ros1", "ros2", "mcap"]

ENDINGS: dict[str, Kind] = {
    ".txt": "text", ".csv": "text", ".xyz": "text", ".bag": "ros1", ".mcap": "mcap", "": "ros2",
}  # fmt: skip


@click.command()
@click.option("--type", "type_", metavar="TYPE", help="Scene by name or number; see --list.")
@click.option("--scene", "file", metavar="FILE", help="Scene in YAML: a list of surfaces.")
@click.option(
    "--cloud", metavar="SCAN", help="A real dense cloud, flown over as a scene: any recording."
)
@click.option(
    "--up",
    default="z",
    metavar="AXIS",
    help="With --cloud: axis of the scan that points up: z (default), -z, y, -y, x or -x; auto "
    "finds it.",
)
@click.option(
    "--features",
    type=int,
    metavar="N",
    help="With --cloud: how many features a keyframe finds at most; 1000 by default.",
)
@click.option(
    "--legs",
    "legs_file",
    metavar="FILE",
    help="With --cloud: the whole route, in YAML: a list of legs.",
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
    "--grid", type=float, default=0.1, show_default=True, metavar="S", help="Spacing of the points."
)
@click.option(
    "--sigma",
    type=Numbers("H,V"),
    default="0.05,0.05",
    show_default=True,
    help="Standard deviations of the points, horizontal and vertical.",
)
@click.option(
    "--noise",
    type=click.Choice(("thesis", "slam")),
    default="thesis",
    show_default=True,
    help="Salt and pepper in z, or depth errors that grow with the square of the distance.",
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
    "--route-height",
    type=float,
    metavar="H",
    help="Of the survey above the scene's top; by default 1.5, over a scan a tenth of its width.",
)
@click.option(
    "--field-of-view",
    type=float,
    default=120.0,
    show_default=True,
    metavar="DEG",
    help="Whole angle that the camera sees.",
)
@click.option(
    "--range",
    "reach",
    type=float,
    metavar="R",
    help="How far the camera sees; by default twice as far as from the survey to the bottom.",
)
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
    "folder; by default the scene's name with .txt. The truth is written beside it.",
)
@click.option("--sensor-frame", is_flag=True, help="In bags: clouds in the camera's frame.")
@overwrite
@as_json
def command(
    type_: str | None,
    file: str | None,
    cloud: str | None,
    up: str,
    features: int | None,
    legs_file: str | None,
    listing: bool,
    output: str | None,
    sensor_frame: bool,
    overwrite: bool,
    as_json: bool,
    cell_size: float,
    gap_size: float,
    thickness: float | None,
    **flying: Any,
) -> None:
    """Make a synthetic flight over a scene, and its exact truth.

    The truth is a map of the surfaces themselves, OUT.truth.npz; mls compare scores a map by it.
    """
    if listing:
        click.echo(_scenes(as_json))
        return
    context = click.get_current_context()
    given = {
        name: parameter.opts[-1]
        for parameter in context.command.params
        if (name := parameter.name)
        and context.get_parameter_source(name) is ParameterSource.COMMANDLINE
    }
    if cloud is not None:
        for name in _OF_SCENES:
            if name in given:
                raise UsageError(
                    f"{given[name]}: belongs to a scene; --cloud takes a scan as it is"
                )
        account = _over_scan(
            cloud, up, features, legs_file, output, sensor_frame, overwrite, flying
        )
        click.echo(json.dumps(account, indent=2) if as_json else _scan_text(account))
        return
    for name in ("up", "features", "legs_file"):
        if name in given:
            raise UsageError(f"{given[name]}: goes with --cloud")
    scene = _scene(type_, file, flying.pop("add_param"), flying.pop("size"))
    target = Path(output if output is not None else f"{scene.name}.txt")
    kind = _kind(target)
    if sensor_frame and kind == "text":
        raise UsageError(f"--sensor-frame: {target} is text, which has no frames; name a bag")
    stem = target.name if kind == "ros2" else target.stem
    beside = target.with_name(f"{stem}.truth.npz")
    _refuse_existing(target, kind, beside, overwrite)

    from mlscli.io.writing.npz import write_map
    from mlscli.scenes.truth import truth

    begin = time.perf_counter()
    true = truth(scene, cell_size, gap_size, cell_size if thickness is None else thickness)
    flight = _fly(scene, **flying)
    _write(target, kind, flight, sensor_frame, overwrite)
    write_map(beside, true, overwrite=overwrite)
    account = {
        "recording": str(target),
        "truth": str(beside),
        "scene": scene.name,
        "points": flight.points,
        "keyframes": len(flight.keyframes),
        "surfaces": len(scene.surfaces),
        "truth_patches": true.size,
        "seconds": time.perf_counter() - begin,
    }
    click.echo(json.dumps(account, indent=2) if as_json else _text(account))


# Options that say what a scene, its grid or its truth are.
_OF_SCENES = (
    *("type_", "file", "add_param", "size", "grid", "holes"),
    *("cell_size", "gap_size", "thickness"),
)


def _over_scan(
    cloud: str,
    up: str,
    features: int | None,
    legs_file: str | None,
    output: str | None,
    sensor_frame: bool,
    overwrite: bool,
    flying: dict[str, Any],
) -> dict[str, Any]:
    """Fly over a scan, write what was recorded, and return the account.

    Parameters
    ----------
    cloud : str
        Path of the scan.
    up : str
        Which axis of it points up.
    features : int or None
        How many features a keyframe finds at most; None: `FEATURES`.
    legs_file : str or None
        The route, if given by hand.
    output : str or None
        What is written.
    sensor_frame, overwrite : bool
        As in `write_bag`.
    flying : dict
        The options of the flight.
    """
    from mlscli.io.reading.recording import open_recording
    from mlscli.keyframes.batches import gather
    from mlscli.scenes.flight import Craft
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.scan_flight import FEATURES, fly_scan, survey_height
    from mlscli.scenes.scans import Scan
    from mlscli.scenes.sceneio import load_legs
    from mlscli.scenes.surfaces import Scatter

    target = Path(output if output is not None else f"{Path(cloud).stem}.flight.txt")
    kind = _kind(target)
    begin = time.perf_counter()
    recording = open_recording(cloud, up=up)
    scan = Scan.of(cloud, gather(recording.keyframes()).points.xyz)
    if legs_file is not None:
        scan = scan.with_legs(*load_legs(legs_file))
    height = flying["route_height"]
    flight = fly_scan(
        scan,
        FEATURES if features is None else features,
        Noise(
            flying["noise"], Scatter(*flying["sigma"]), flying["salt_pepper"], flying["outliers"]
        ),
        Craft(
            survey_height(scan) if height is None else height,
            flying["field_of_view"],
            flying["reach"],
        ),
        seed=flying["seed"],
        visibility=not flying["all_points"],
    )
    _write(target, kind, flight, sensor_frame, overwrite)
    return {
        "recording": str(target),
        "truth": cloud,
        "points": flight.points,
        "keyframes": len(flight.keyframes),
        "scan_points": len(scan.xyz),
        "seconds": time.perf_counter() - begin,
    }


def _scan_text(account: dict[str, Any]) -> str:
    return (
        f"{account['recording']}: {account['points']:,} points in {account['keyframes']:,} "
        f"keyframes over {account['scan_points']:,} points of a scan; the truth is "
        f"{account['truth']}"
    )


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
        raise UsageError(f"found {found} of --type and --scene, expected one; see --list")
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


def _refuse_existing(target: Path, kind: Kind, beside: Path, overwrite: bool) -> None:
    from mlscli.io.writing.atomic import refuse_existing

    if kind == "text":
        refuse_existing(target, overwrite=overwrite)
    else:
        from mlscli.io.writing.flight_bag import refuse_existing_bag

        refuse_existing_bag(target, kind, overwrite=overwrite)
    refuse_existing(beside, overwrite=overwrite)


def _fly(
    scene: Scene,
    *,
    grid: float,
    sigma: tuple[float, float],
    noise: Literal["thesis", "slam"],
    salt_pepper: float,
    outliers: float,
    holes: tuple[float, float],
    seed: int,
    all_points: bool,
    route_height: float | None,
    field_of_view: float,
    reach: float | None,
) -> Flight:
    """Fly over a scene with the options of the command.

    Parameters
    ----------
    scene : Scene
    grid : float
        Spacing of the points, in the unit of the scene.
    sigma : tuple of float
        Horizontal and vertical standard deviation of the points.
    noise : {"thesis", "slam"}
        Kind of the noise.
    salt_pepper, outliers : float
        Probabilities, as in `Noise`.
    holes : tuple of float
        How many places without texture, a whole number, and their diameter.
    seed : int
        Seed of all random numbers.
    all_points : bool
        Whether points that no keyframe sees are recorded, too.
    route_height : float or None
        Height of the survey above the scene's top; None: as in `Craft`.
    field_of_view : float
        The whole angle that the camera sees, in degrees.
    reach : float or None
        How far the camera sees; None: as in `Craft`.

    Raises
    ------
    UsageError
        As `fly`, and where the number of holes is not whole.
    """
    from mlscli.scenes.flight import Craft, fly
    from mlscli.scenes.noise import Noise
    from mlscli.scenes.surfaces import Scatter

    count, diameter = holes
    if not count.is_integer():
        raise UsageError(f"--holes {count:g},{diameter:g}: expected a whole number of holes")
    return fly(
        scene,
        grid,
        Noise(noise, Scatter(*sigma), salt_pepper, outliers),
        Craft(Craft.height if route_height is None else route_height, field_of_view, reach),
        holes=(int(count), diameter),
        seed=seed,
        visibility=not all_points,
    )


def _write(
    target: Path, kind: Kind, flight: Flight | ScanFlight, sensor_frame: bool, overwrite: bool
) -> None:
    if kind == "text":
        from mlscli.io.writing.flight_text import write_text

        write_text(target, flight.keyframes, overwrite=overwrite)
    else:
        from mlscli.io.writing.flight_bag import write_bag

        write_bag(
            target,
            flight.keyframes,
            flight.attitudes,
            kind,
            sensor_frame=sensor_frame,
            overwrite=overwrite,
        )


def _text(account: dict[str, Any]) -> str:
    return (
        f"{account['recording']}: {account['points']:,} points in {account['keyframes']:,} "
        f"keyframes over {account['surfaces']:,} surfaces; {account['truth']}: "
        f"{account['truth_patches']:,} true patches"
    )
