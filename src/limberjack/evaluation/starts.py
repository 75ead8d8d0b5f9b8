"""The kind of start that a seed gives; scores are reported for each kind.

    environment = suite.load("stacker", "stack_2")
    kind_of_start(environment, seed=3)      # 'level_1'

Tasks name their kinds of starts: see `start` and `STARTS` of `limberjack.suite.base.Task`.
"""

from limberjack import rollout
from limberjack.rl import control
from limberjack.rl.builds import Seeded

__all__ = ["kind_of_first_start", "kind_of_start"]


def kind_of_start(environment: control.Environment, seed: int) -> str | None:
    """The kind of start of the first episode with this seed; None if the task has no kinds.

    Args:
      environment: is reseeded and reset.
      seed: of the episode.
    """
    environment.reseed(seed)
    environment.reset()
    return rollout.kind_of_start(environment)


def kind_of_first_start(seeded: Seeded, seed: int) -> str | None:
    """The same, of an environment of any class.

    Args:
      seeded: is made to begin the seed's first episode.
      seed: of the episode.
    """
    seeded.begin(seed)
    seeded.environment.reset()
    return rollout.kind_of_start(seeded.environment)
