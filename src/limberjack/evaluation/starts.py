"""The kind of start that a seed gives; scores are reported for each kind.

    environment = suite.load("stacker", "stack_2")
    kind_of_start(environment, seed=3)      # 'level_1'

Tasks name their kinds of starts: see `start` and `STARTS` of `limberjack.suite.base.Task`.
"""

from limberjack.rl import control

__all__ = ["kind_of_start"]


def kind_of_start(environment: control.Environment, seed: int) -> str | None:
    """The kind of start of the first episode with this seed; None if the task has no kinds.

    Args:
      environment: is reseeded and reset.
      seed: of the episode.
    """
    environment.reseed(seed)
    environment.reset()
    start = getattr(environment.task, "start", None)
    return None if start is None else start(environment.physics)
