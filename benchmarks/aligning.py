"""Maps of two flights in different frames, aligned: ``python -m benchmarks.aligning`` (minutes).

Each scene is flown twice, with other points, noise and height. The second recording is turned by
any yaw, moved, and scaled by 0.3 to 3; both are mapped on the cells that suit them. How far off a
patch of the second map comes to lie, at most, is told in cells of the first. With ``--data DIR``,
real clouds are cut into two halves that share no point and overlap by 40 %.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.table import lines
from mlscli.aligning.evidence import samples_of
from mlscli.aligning.fit import align_maps
from mlscli.building.build import build_map, settled
from mlscli.errors import InputError
from mlscli.geometry.similarity import Similarity
from mlscli.io.reading.recording import open_recording
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import Craft, Flight, fly
from mlscli.scenes.presets import make
from mlscli.trials.quality import GRID, SCENES
from mlscli.trials.staged import mapped

# More than so many cells off, a fit is wrong.
WRONG = 2.0
# Real clouds, and which axis points up.
CLOUDS = {
    "multilevel/building_floors_cgal.ply": "z",
    "multilevel/footbridge_yup_dddmr_map.pcd": "y",
    "multilevel/unitree_ISR_scan_02_registered.xyz": "z",
    "multilevel/drone_odm_defect_wall.laz": "z",
    "sparse/tello_kf_pointData.csv": "-y",
    "sparse/euroc_orb3_ref_pointcloud.txt": "auto",
}
HEAD = ("place", "pairs", "told", "of these wrong", "yaw, degrees", "scale, %", "patches, cells")


def two(scene_name: str, seed: int, moved: Similarity) -> tuple[SurfaceMap, SurfaceMap]:
    """Return the maps of two flights over a scene, the second in another frame."""
    scene = make(scene_name)
    first = fly(scene, GRID, seed=seed)
    higher = Craft(height=1.3 * scene.usual_height)
    second = fly(scene, GRID, craft=higher, seed=seed + 100, anew=True)
    keyframes = [
        Keyframe(moved.points(each.points), each.stamp, _moved(each.position, moved))
        for each in second.keyframes
    ]
    flights = first, Flight(scene, keyframes, second.attitudes)
    one, other = (
        mapped(flight, settled(Parameters(), flight.keyframes, Report())) for flight in flights
    )
    return one, other


def _moved(position: tuple[float, float, float], moved: Similarity) -> tuple[float, float, float]:
    x, y, z = moved.points(np.array([position]))[0].tolist()
    return x, y, z


def halves(path: Path, up: str, seed: int, moved: Similarity) -> tuple[SurfaceMap, SurfaceMap]:
    """Return the maps of two halves of a cloud, the second in another frame."""
    points = np.concatenate([each.points for each in open_recording(path, up=up).keyframes()])
    chance = np.random.default_rng(seed).random(len(points)) < 0.5
    axis = int(np.argmax(np.ptp(np.quantile(points[:, :2], (0.02, 0.98), axis=0), axis=0)))
    low, high = np.quantile(points[:, axis], (0.3, 0.7))
    one = points[chance & (points[:, axis] <= high)]
    other = points[~chance & (points[:, axis] >= low)]
    return build_map(one), build_map(moved.points(other))


def any_similarity(rng: np.random.Generator) -> Similarity:
    """Return one of any yaw, with a scale from 0.3 to 3 and a shift of up to 50."""
    x, y, z = rng.uniform(-50, 50, 3).tolist()
    scale = math.exp(rng.uniform(math.log(0.3), math.log(3)))
    return Similarity(rng.uniform(-math.pi, math.pi), scale, (x, y, z))


def _row(
    place: str, pairs: Sequence[tuple[SurfaceMap, SurfaceMap, Similarity]], known: bool
) -> tuple[str, ...]:
    told, off = [], []
    for one, other, moved in pairs:
        true = moved.inverse
        try:
            fit = align_maps(one, other, true.scale if known else None).fit
        except InputError as error:
            click.echo(f"{place}: {error}", err=True)
            continue
        samples = samples_of(other)
        away: Float64 = fit.points(samples) - true.points(samples)
        off.append(float(np.linalg.norm(away, axis=1).max()) / one.cell_size)
        yaw = math.degrees(abs(math.remainder(fit.yaw - true.yaw, 2 * math.pi)))
        told.append((yaw, 100 * abs(fit.scale / true.scale - 1)))
    wrong = sum(each > WRONG for each in off)
    worst = [f"{max(each):.2f}" for each in zip(*told, strict=True)] if told else ["", ""]
    patches = f"{max(off):.2f}" if off else ""
    return place, str(len(pairs)), str(len(told)), str(wrong), *worst, patches


def rows(
    scenes: Sequence[str], seeds: Sequence[int], data: Path | None, known: bool
) -> Iterator[tuple[str, ...]]:
    """Yield a row for each scene, and for each cloud; errors are the largest of those told."""
    for number, scene in enumerate(scenes):
        movements = [any_similarity(np.random.default_rng((seed, number))) for seed in seeds]
        pairs = [(*two(scene, s, moved), moved) for s, moved in zip(seeds, movements, strict=True)]
        yield _row(scene, pairs, known)
    for number, (name, up) in enumerate(CLOUDS.items() if data is not None else ()):
        assert data is not None
        movements = [any_similarity(np.random.default_rng((seed, 100 + number))) for seed in seeds]
        pairs = [
            (*halves(data / name, up, s, moved), moved)
            for s, moved in zip(seeds, movements, strict=True)
        ]
        yield _row(Path(name).name, pairs, known)


@click.command()
@click.option("--scenes", default=",".join(SCENES), help="Names of scenes, with commas between.")
@click.option("--seeds", default="5,6,7", help="Of the flights, with commas between.")
@click.option("--data", type=click.Path(path_type=Path), help="The folder of the real recordings.")
@click.option("--known", is_flag=True, help="Tell the scale, as --scale does.")
def main(scenes: str, seeds: str, data: Path | None, known: bool) -> None:
    """Print the table; why a pair was refused goes to standard error."""
    chosen = [each for each in scenes.split(",") if each]
    for line in lines(HEAD, rows(chosen, [int(seed) for seed in seeds.split(",")], data, known)):
        click.echo(line)


if __name__ == "__main__":
    main()
