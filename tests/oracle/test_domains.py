"""The quantities that each domain's Physics measures are dm_control's."""

import itertools

import pytest

from . import twins
from .same import assert_same_pair

pytestmark = pytest.mark.oracle

_DOMAIN_METHODS = {
    "humanoid": {
        "torso_upright": (),
        "head_height": (),
        "center_of_mass_position": (),
        "center_of_mass_velocity": (),
        "torso_vertical_orientation": (),
        "joint_angles": (),
        "extremities": (),
    },
    "manipulator": {
        "touch": (),
        "bounded_joint_pos": (["arm_root", "finger"],),
        "joint_vel": (["arm_wrist", "thumb"],),
        "body_2d_pose": ("hand",),
        "site_distance": ("grasp", "pinch"),
    },
}
_DOMAIN_METHODS["stacker"] = _DOMAIN_METHODS["manipulator"]


@pytest.mark.parametrize(("domain", "task"), twins.MODELS)
def test_the_quantities_of_a_domain_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    for action in itertools.islice(env.actions("bang-bang", 5), 50):
        env.step(action)
        for method, arguments in _DOMAIN_METHODS[domain].items():
            values = [getattr(one.physics, method)(*arguments) for one in (env.ours, env.theirs)]
            assert_same_pair(values, f"{env.where} {method}")


@pytest.mark.parametrize("task", [task for task in twins.MODELS if task[0] != "humanoid"])
def test_poses_of_several_bodies_are_the_same(task: tuple[str, str]) -> None:
    env = twins.load(*task)
    env.reset()
    for bodies in (["hand"], ["hand", "upper_arm"], "hand"):
        for orientation in (True, False):
            poses = [
                one.physics.body_2d_pose(bodies, orientation=orientation)
                for one in (env.ours, env.theirs)
            ]
            assert_same_pair(poses, f"{env.where} {bodies}")
