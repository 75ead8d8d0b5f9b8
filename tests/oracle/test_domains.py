"""The quantities that each domain's Physics measures are dm_control's."""

import inspect
import itertools
from typing import Any

import pytest

from . import twins
from .oracle import theirs
from .same import assert_same_pair

pytestmark = [pytest.mark.oracle, pytest.mark.usefixtures("compiled_once")]

# Arguments of the methods that need some.
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "bounded_joint_pos": (["arm_root", "finger"],),
    "joint_vel": (["arm_wrist", "thumb"],),
    "body_2d_pose": ("hand",),
    "site_distance": ("grasp", "pinch"),
}
_WITH_POSES = ["manipulator", "stacker"]


def _quantities(physics: Any) -> list[str]:
    """The public methods that dm_control's class adds to `Physics`, less those of other models."""
    methods = inspect.getmembers(type(physics), inspect.isfunction)
    names = [name for name, method in methods if method.__qualname__.startswith("Physics.")]
    inherited = dir(theirs("mujoco").Physics)
    own = [name for name in names if not name.startswith("_") and name not in inherited]
    # A task's model may lack what a measurement of another task needs, such as a ball.
    return [name for name in own if _is_measurable(physics, name)]


def _is_measurable(physics: Any, name: str) -> bool:
    try:
        getattr(physics, name)(*_ARGUMENTS.get(name, ()))
    except LookupError:  # a name, or for some of dm_control's an empty list of names
        return False
    return True


@pytest.mark.parametrize(("domain", "task"), twins.MODELS)
def test_the_quantities_of_a_domain_are_the_same(domain: str, task: str) -> None:
    env = twins.load(domain, task)
    env.reset()
    quantities = _quantities(env.theirs.physics)
    assert quantities
    for action in itertools.islice(env.actions("bang-bang", 5), 50):
        env.step(action)
        for method in quantities:
            arguments = _ARGUMENTS.get(method, ())
            values = [getattr(one.physics, method)(*arguments) for one in (env.ours, env.theirs)]
            assert_same_pair(values, f"{env.where} {method}")


@pytest.mark.parametrize("task", [task for task in twins.MODELS if task[0] in _WITH_POSES])
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
