"""A domain with two tasks of the suite, whose episodes are short."""

from typing import Any

from limberjack.rl import control
from limberjack.suite import cartpole, pendulum
from limberjack.utils.containers import TaggedTasks

__all__ = ["SUITE", "balance", "swingup"]

SUITE = TaggedTasks()


@SUITE.add()
def balance(
    time_limit: float = 0.5, random: Any = None, environment_kwargs: Any = None
) -> control.Environment:
    """Of cartpole, 50 control steps."""
    return cartpole.balance(time_limit, random, environment_kwargs)


@SUITE.add()
def swingup(
    time_limit: float = 1.0, random: Any = None, environment_kwargs: Any = None
) -> control.Environment:
    """Of pendulum, 50 control steps."""
    return pendulum.swingup(time_limit, random, environment_kwargs)
