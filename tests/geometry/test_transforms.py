"""The tree of frames.

How these tests could be cheated: by looking up the way down from the root only, by trees that are
chains, or by transforms told in the order of the tree. So trees are drawn at random and told
shuffled; what they say is worked out as products of 4 by 4 matrices.
"""

from __future__ import annotations

import random
import re
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.geometry.poses import PoseTrack
from mlscli.geometry.transforms import TransformTree
from mlscli.runtime.arrays import Float64
from tests.geometry.test_poses import IDENTITY, as_matrices, random_poses

STAMPS = np.array([0.0, 1.0, 2.0])


def still(x: float) -> tuple[Float64, Float64, Float64]:
    """Return stamps, translations by x, and no rotations."""
    return STAMPS, np.tile([x, 0.0, 0.0], (3, 1)), np.tile(IDENTITY, (3, 1))


def x_of(tree: TransformTree, target: str, source: str, stamp: float = 1.0) -> float:
    return float(tree.lookup(target, source, np.array([stamp])).translation[0, 0])


@st.composite
def trees(draw: st.DrawFn) -> tuple[dict[str, str], int]:
    """Draw the parent of each frame, and a seed for where they stand."""
    count = draw(st.integers(2, 7))
    parents = {f"f{i}": f"f{draw(st.integers(0, i - 1))}" for i in range(1, count)}
    return parents, draw(st.integers(0, 2**32 - 1))


@given(drawn=trees())
@settings(deadline=None, max_examples=35)
def test_a_lookup_is_the_product_of_the_transforms_on_the_way(
    drawn: tuple[dict[str, str], int],
) -> None:
    parents, seed = drawn
    rng = np.random.default_rng(seed)
    dice = random.Random(seed)
    wanted = rng.uniform(0, 10, 4)
    # T_f0_frame at the wanted times, from the root on.
    root = {"f0": np.tile(np.eye(4), (4, 1, 1))}
    tellings = []
    for child, parent in parents.items():
        if dice.random() < 0.3:
            pose = random_poses(rng, 1)
            here = np.tile(as_matrices(pose), (4, 1, 1))
            tellings.append((parent, child, np.zeros(0), *pose[:2]))
        else:
            stamps = np.concatenate(([0.0, 10.0], rng.uniform(0, 10, 5)))
            poses = random_poses(rng, 7)
            here = as_matrices(PoseTrack(stamps, *poses[:2]).at(wanted))
            tellings.extend(
                (parent, child, stamps[rows], poses.translation[rows], poses.rotation[rows])
                for rows in np.split(rng.permutation(7), [2, 3])
            )
        root[child] = root[parent] @ here
    orders = [dice.sample(tellings, len(tellings)) for _ in range(2)]
    made = []
    for order in orders:
        tree = TransformTree()
        for parent, child, stamps, translations, rotations in order:
            name = dice.choice(["", "/", "//"]) + child
            if len(stamps):
                tree.add(parent, name, stamps, translations, rotations)
            else:
                tree.add_static(parent, name, translations[0], rotations[0])
        made.append(tree)

    for target in root:
        for source in root:
            found, again = (tree.lookup(target, source, wanted) for tree in made)
            assert found.known.all()
            expected = np.linalg.inv(root[target]) @ root[source]
            np.testing.assert_allclose(as_matrices(found), expected, atol=1e-10)
            # The order in which it was told changes nothing, not even a bit.
            assert all(map(np.array_equal, found, again))
    assert made[0].frames == sorted(root)


def test_a_frame_in_itself_is_the_identity_even_if_never_told_of() -> None:
    poses = TransformTree().lookup("map", "/map", np.array([1.0, np.nan]))

    np.testing.assert_array_equal(as_matrices(poses), np.tile(np.eye(4), (2, 1, 1)))
    assert poses.known.all()


def test_what_is_not_known_on_the_way_is_not_known_at_its_end() -> None:
    tree = TransformTree()
    tree.add("map", "odom", *still(1))
    tree.add("odom", "base", STAMPS + 1, *still(10)[1:])
    tree.add_static("base", "lidar", np.array([100.0, 0, 0]), IDENTITY)

    for ends in (("map", "lidar"), ("lidar", "map")):
        poses = tree.lookup(*ends, np.array([0.4, 0.5, 2.0, 2.5, 2.6, np.nan]))
        assert poses.known.tolist() == [False, True, True, True, False, False]
        assert np.isnan(poses.translation[~poses.known]).all()
        assert np.isnan(poses.rotation[~poses.known]).all()
    assert x_of(tree, "map", "lidar") == 111
    assert x_of(tree, "lidar", "map") == -111


def test_static_transforms_hold_at_all_times() -> None:
    tree = TransformTree()
    tree.add_static("base", "mast", np.array([1.0, 0, 0]), IDENTITY)
    tree.add_static("mast", "lidar", np.array([2.0, 0, 0]), -5 * IDENTITY)

    poses = tree.lookup("base", "lidar", np.array([-1e18, 0.0, 1e18, np.nan, np.inf]))

    assert poses.known.all()
    assert poses.translation[:, 0].tolist() == [3] * 5
    assert tree.lookup("base", "lidar", np.empty(0)).translation.shape == (0, 3)


def test_the_last_static_transform_told_counts_and_none_beside_moving_ones() -> None:
    tree = TransformTree()
    tree.add_static("a", "b", np.array([1.0, 0, 0]), IDENTITY)
    tree.add_static("a", "b", np.array([2.0, 0, 0]), IDENTITY)
    assert x_of(tree, "a", "b", 99) == 2
    tree.add("a", "b", *still(3))
    assert x_of(tree, "a", "b") == 3
    assert not tree.lookup("a", "b", np.array([99.0])).known.any()


def test_what_is_told_after_a_lookup_counts_too() -> None:
    tree = TransformTree()
    tree.add("map", "base", *still(1))
    assert x_of(tree, "map", "base") == 1
    tree.add("map", "base", *still(2))
    assert x_of(tree, "map", "base") == 2
    tree.add_static("base", "lidar", np.array([5.0, 0, 0]), IDENTITY)
    assert x_of(tree, "map", "lidar") == 7
    tree.add_static("lidar", "window", np.array([1.0, 0, 0]), IDENTITY)
    assert x_of(tree, "map", "window") == 8
    tree.add("base", "window", *still(20))
    assert x_of(tree, "map", "window") == 22


def test_what_tells_nothing_is_left_out() -> None:
    tree = TransformTree()
    stamps, translations, rotations = still(1)
    for parent, child in (("a", "/a"), ("", "b"), ("a", "/ ")):
        tree.add(parent, child, stamps, translations, rotations)
    tree.add_static("a", "c", np.array([0, np.inf, 0]), IDENTITY)
    tree.add_static("c", "c", np.zeros(3), IDENTITY)
    assert tree.frames == []
    tree.add("a", "b", np.array([0.0, np.nan, 2.0]), translations, rotations)
    tree.add("a", "d", stamps, translations, rotations * [[1], [0], [1]])
    assert tree.frames == ["a", "b", "d"]
    for child in ("b", "d"):
        poses = tree.lookup("a", child, np.array([1.0]))
        assert poses.known.all()
        assert np.isfinite(poses.rotation).all()


# Parents that change


def reparented() -> TransformTree:
    """Return a box that the truck carries until 2, and the ship from 3 on."""
    tree = TransformTree()
    tree.add("ship", "box", STAMPS + 3, np.tile([5.0, 0, 0], (3, 1)), np.tile(IDENTITY, (3, 1)))
    tree.add("truck", "box", *still(1))
    tree.add_static("harbour", "truck", np.array([10.0, 0, 0]), IDENTITY)
    tree.add_static("harbour", "ship", np.array([100.0, 0, 0]), IDENTITY)
    return tree


def test_a_frame_hangs_below_the_parent_of_the_last_transform_before() -> None:
    tree = reparented()
    poses = tree.lookup("harbour", "box", np.array([5.2, 0.0, 2.0, 2.99, 3.0, 5.6]))

    assert poses.translation[:5, 0].tolist() == [105, 11, 11, 11, 105]
    assert poses.known.tolist() == [True] * 5 + [False]
    assert tree.ancestors("box") == ["box", "ship", "harbour"]
    tree.add("train", "box", STAMPS + 6, *still(1)[1:])
    assert tree.ancestors("box") == ["box", "train"]


def test_where_frames_part_at_times_they_are_known_at_the_others() -> None:
    tree = TransformTree()
    tree.add("truck", "box", *still(1))
    tree.add("ship", "box", STAMPS + 3, *still(5)[1:])

    assert tree.lookup("truck", "box", np.array([1.0, 4.0])).known.tolist() == [True, False]
    assert x_of(tree, "ship", "box", 4) == 5
    with pytest.raises(InputError, match="'truck'"):
        tree.lookup("truck", "box", np.array([4.0, 5.0]))


def test_frames_have_a_way_if_they_are_connected_at_any_time() -> None:
    tree = reparented()
    tree.add("map", "ship", *still(0))
    # The box hangs below the ship in the end, and this below the map.
    for target in ("truck", "harbour", "ship", "map", "box"):
        tree.check_way(target, "box")
    tree.add("elsewhere", "radar", *still(1))
    with pytest.raises(InputError, match="'radar' is connected with 'elsewhere'"):
        tree.check_way("truck", "radar")
    tree = TransformTree()
    tree.add("odom", "base", *still(1))
    tree.check_way("base", "/odom")
    with pytest.raises(InputError, match="'map' is connected with nothing"):
        tree.check_way("map", "base")


# What cannot be answered


def test_frames_that_nothing_connects_are_named_with_those_that_are() -> None:
    tree = TransformTree()
    tree.add("odom", "base", *still(1))
    tree.add("base", "camera", *still(1))
    tree.add("world", "laser", *still(1))

    with pytest.raises(InputError) as error:
        tree.lookup("odom", "laser", STAMPS)
    message = str(error.value)
    assert "'odom' is connected with 'base', 'camera'" in message
    assert "'laser' is connected with 'world'" in message
    assert "\n" not in message
    with pytest.raises(InputError, match="'radar' is connected with nothing"):
        tree.lookup("odom", "radar", STAMPS)


def test_a_circle_of_frames_is_named() -> None:
    tree = TransformTree()
    tree.add("a", "b", *still(1))
    tree.add("b", "c", *still(1))
    tree.add("c", "a", *still(1))
    tree.add("c", "lidar", *still(1))

    circle = re.escape("'c' below 'b' below 'a' below 'c'")
    with pytest.raises(InputError, match=circle):
        tree.lookup("lidar", "a", STAMPS)
    with pytest.raises(InputError, match=circle):
        tree.ancestors("lidar")


def test_links_name_each_frame_with_all_its_parents_and_whether_it_moves() -> None:
    assert {tuple(link) for link in reparented().links} == {
        ("ship", "box", True),
        ("truck", "box", True),
        ("harbour", "truck", False),
        ("harbour", "ship", False),
    }


def test_the_ancestors_lead_to_the_root() -> None:
    tree = TransformTree()
    tree.add("/map", "odom", *still(1))
    tree.add_static("odom", "/base", np.zeros(3), IDENTITY)

    assert tree.ancestors("/base") == ["base", "odom", "map"]
    assert tree.ancestors("map") == ["map"]
    assert tree.ancestors("elsewhere") == ["elsewhere"]


def test_the_rotation_and_the_translation_are_of_the_way_asked() -> None:
    # A lidar 1 m ahead of a craft that stands at y = 5 and looks along y.
    quarter = Rotation.from_euler("z", 90, degrees=True).as_quat()
    tree = TransformTree()
    tree.add("map", "base", STAMPS, np.tile([0.0, 5, 0], (3, 1)), np.tile(quarter, (3, 1)))
    tree.add_static("base", "lidar", np.array([1.0, 0, 0]), IDENTITY)

    T_map_lidar = tree.lookup("map", "lidar", STAMPS)  # noqa: N806

    np.testing.assert_allclose(T_map_lidar.translation, np.tile([0, 6, 0], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(T_map_lidar.rotation, np.tile(quarter, (3, 1)), atol=1e-12)


def test_leaves_are_above_no_frame_and_cost_no_square() -> None:
    # By name, the frames of the chain come from its root to its end.
    tree = TransformTree()
    for n in range(5000):
        tree.add_static(f"f{n:05}", f"f{n + 1:05}", np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    tree.add_static("f00007", "beside", np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    begin = time.process_time()
    assert tree.leaves() == ["beside", "f05000"]
    assert len(tree.ancestors("f05000")) == 5001
    assert time.process_time() - begin < 1


def test_frames_in_a_circle_have_no_leaves() -> None:
    tree = TransformTree()
    for parent, child in (("b", "c"), ("c", "d"), ("d", "b"), ("d", "e")):
        tree.add_static(parent, child, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="hang in a circle"):
        tree.leaves()
