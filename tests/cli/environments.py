"""Environments of a user, which tests name as `--env tests.cli.environments:FUNCTION`."""

import re
from typing import Any

import numpy as np

from limberjack import mujoco, suite
from limberjack.rl import control
from tests import plain_domain
from tests.rl import odd_environments as odd

__all__ = [
    "arm",
    "bare",
    "delayed",
    "different",
    "diverging",
    "divided",
    "endless",
    "failing",
    "nested",
    "not_a_function",
    "nothing",
    "plain",
    "remembering",
    "repeating",
]

plain = plain_domain.make
endless = plain_domain.endless
nested = odd.nested  # a wrapper around a wrapper around a subclass
not_a_function = 3


def remembering(seed: int) -> control.Environment:
    """A task that remembers its last action without declaring it, so it is not vectorised."""
    return odd.of_task(odd.LastAction, seed)


def delayed(seed: int) -> control.Environment:
    """A subclass that delays observations by two steps."""
    return odd.of_class(odd.Delaying, seed)


def bare(seed: int) -> control.Environment:
    """An environment whose model has no camera and little room for pictures."""
    xml = plain_domain._MODEL.replace('offwidth="640" offheight="480"', 'offwidth="16"')
    physics = mujoco.Physics.from_xml_string(re.sub("<camera.*/>", "", xml))
    return control.Environment(
        physics, plain_domain.Push(seed), time_limit=0.1, control_timestep=0.02
    )


def repeating(seed: int) -> control.Environment:
    """An environment that repeats each action three times by itself."""
    return plain_domain.push(random=seed, environment_kwargs={"action_repeat": 3})


def different(seed: int) -> control.Environment:
    """An environment that ignores its seed."""
    return plain_domain.push()


def arm(seed: int) -> control.Environment:
    """A task of the suite under another name."""
    return suite.load("manipulator", "bring_ball", {"random": seed, "time_limit": 0.05})


def nothing(seed: int) -> None:
    """Forgets to return its environment."""


def failing(seed: int) -> control.Environment:
    """A mistake of the user's own."""
    raise ZeroDivisionError(1 // 0)


class _Divided(control.Environment):
    """Takes its actions in parts, by name."""

    def action_spec(self) -> Any:
        return {"push": super().action_spec()}


def divided(seed: int) -> control.Environment:
    """An environment with a dictionary of actions, which no policy here returns."""
    push = plain_domain.push(random=seed)
    return _Divided(push.physics, push.task, time_limit=0.1, control_timestep=0.02)


class _Diverging(plain_domain.Push):
    """A cart with an impossible velocity."""

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        physics.data.qvel[:] = 1e12


def diverging(seed: int) -> control.Environment:
    """An environment whose simulation diverges in its first step."""
    environment = plain_domain.push(random=seed)
    task = _Diverging(seed)
    return control.Environment(
        environment.physics, task, time_limit=0.5, control_timestep=np.float64(0.02)
    )
