"""The cup and the slot."""

from typing import Any

import numpy as np
import pytest

from limberjack.planner.arm.hand import PLANE
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.receptacles import Receptacle

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
both = pytest.mark.parametrize("name", ["ball", "peg"])


def _with_object_up(name: str, up: float, beside: float = 0.0) -> tuple[Receptacle, Any]:
    """A receptacle, and the physics of an object so far above its place and beside the axis."""
    receptacle = Receptacle.for_object(name)
    cost, physics = scene(f"insert_{name}", 1003, _ARM, [0.0, 0.3, 0.0])
    data = physics.named.data
    axis, across = receptacle.axes(data)
    quat = physics.named.model.body_quat[receptacle.target]
    place = data.xpos[receptacle.target][PLANE] + up * axis + beside * across
    data.qpos[cost.task.object_joints] = [*place, 2 * np.arctan2(quat[2], quat[0])]
    physics.forward()
    return receptacle, physics


@both
def test_offsets_are_measured_in_the_frame_of_the_target(name: str) -> None:
    receptacle, physics = _with_object_up(name, 0.1, 0.02)
    for offset in receptacle.offsets(physics.named.data):
        np.testing.assert_allclose(offset, [0.1, 0.02], atol=1e-9)  # sines and cosines round


@both
def test_the_distance_that_remains_falls_to_zero_along_the_axis(name: str) -> None:
    lengths = []
    for up in (0.3, 0.2, 0.1, 0.05, 0.0):
        receptacle, physics = _with_object_up(name, up)
        lengths.append(float(receptacle.distance(receptacle.offsets(physics.named.data))))
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] == pytest.approx(0.0, abs=1e-9)  # sines and cosines round
    receptacle, physics = _with_object_up(name, 0.0, 0.05)  # behind the wall
    assert receptacle.distance(receptacle.offsets(physics.named.data)) > 0.15


@both
def test_an_object_is_held_in_its_place_and_not_beside_it(name: str) -> None:
    receptacle = Receptacle.for_object(name)
    assert receptacle.holds((np.array(0.0), np.array(0.0))) == 1.0
    assert receptacle.holds((np.array(0.0), np.array(0.1))) < 0.01
    assert receptacle.holds((np.array(-0.2), np.array(0.0))) < 0.01


@both
def test_before_the_mouth_nothing_is_left_to_it(name: str) -> None:
    receptacle, physics = _with_object_up(name, Receptacle.for_object(name).before)
    assert receptacle.from_mouth(physics.named.data) == pytest.approx(0.0, abs=1e-9)  # rounds
    receptacle, physics = _with_object_up(name, 0.2, 0.2)
    assert receptacle.from_mouth(physics.named.data) > 0.15


@both
def test_poses_bring_a_held_object_before_the_mouth(name: str) -> None:
    receptacle, physics = _with_object_up(name, 0.0)
    data = physics.named.data
    data.qpos[f"{name}_y"] = np.pi - sum(_ARM)
    data.qpos[[f"{name}_x", f"{name}_z"]] = hand_places(np.array(_ARM), GRASP)
    physics.forward()
    random = np.random.default_rng(0)
    axis = receptacle.axes(data)[0]
    end = data.xpos[receptacle.target][PLANE] + receptacle.before * axis
    poses = receptacle.poses(data, random, receptacle.before, 0.0, 8)
    assert len(poses)
    # Inverse kinematics and back, by sines and cosines: they round.
    expected = np.repeat([end], len(poses), axis=0)
    np.testing.assert_allclose(hand_places(poses, GRASP), expected, atol=1e-9)


@both
def test_walls_are_beside_the_axis(name: str) -> None:
    receptacle, physics = _with_object_up(name, 0.0)
    data, walls = physics.named.data, receptacle.walls(physics)
    assert len(walls.radii) == len(walls.ends) > 0
    offsets = walls.ends.reshape(-1, 2) - data.site_xpos[receptacle.target][PLANE]
    up, _ = (offsets @ receptacle.axes(data).T).T
    assert up.max() < receptacle.before + 0.01
