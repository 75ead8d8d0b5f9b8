"""What kind of start a seed gives, so that scores can be told apart by it.

    environment = suite.load("stacker", "stack_2")
    kind_of_start(environment, seed=3)      # 'level_1'

The arm's tasks know their kinds: where the prop is, how high the target. A humanoid always starts
in a random pose above the ground. Its kind is what becomes of that without control: it is let fall
for one second of zero actions. If then its head is at least 0.7 m above the ground it is 'up';
otherwise it has fallen, and lies 'face_up', 'face_down' or 'on_side', by whether the torso's front
is within 60 degrees of the vertical.
"""

from typing import Any

import numpy as np

from limberjack.suite import humanoid

__all__ = ["kind_of_start"]

_FALL_TIME = 1.0  # seconds; without control every humanoid lies on the ground by then
_UP_HEIGHT = 0.7  # metres; half the height of the head at which standing is fully rewarded
_FACING = 0.5  # cosine of 60 degrees


def kind_of_start(environment: Any, seed: int) -> str | None:
    """The kind of start of the first episode with this seed; None if the task has no kinds.

    Args:
      environment: a `control.Environment` that nobody else uses, with episodes of a second or more.
      seed: it is reseeded with.
    """
    environment.reseed(seed)
    environment.reset()
    physics = environment.physics
    if isinstance(physics, humanoid.Physics):
        return _after_the_fall(environment)
    start = getattr(environment.task, "start", None)
    return None if start is None else start(physics)


def _after_the_fall(environment: Any) -> str:
    """How a humanoid lies after a second without control."""
    nothing = np.zeros(environment.action_spec().shape)
    for _ in range(round(_FALL_TIME / environment.control_timestep())):
        environment.step(nothing)
    physics = environment.physics
    if physics.head_height() >= _UP_HEIGHT:
        return "up"
    front = physics.named.data.xmat["torso", "zx"]  # the front's vertical component
    if abs(front) < _FACING:
        return "on_side"
    return "face_up" if front > 0 else "face_down"
