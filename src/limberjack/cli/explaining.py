"""`explained`: the planner as a policy that reports the stages and the terms of its plans' cost."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    import numpy as np

    from limberjack.policies import Act, EnvironmentPolicy
    from limberjack.rl.control import Environment

__all__ = ["explained"]


def explained(
    threads: int | None, on_plan: Callable[[str, Mapping[str, float]], None]
) -> "EnvironmentPolicy":
    """The planner, which prints its plan's cost each simulated second and in each new stage.

    Args:
      threads: of the planner; by default all cores.
      on_plan: called with the stage and the cost's terms before each step.
    """
    from limberjack.planner import Planner
    from limberjack.policies import EnvironmentPolicy

    def begin_in(environment: "Environment", seed: int) -> "Act":
        planner = Planner(environment, threads, seed)
        last: list[tuple[int, str]] = [(-1, "")]

        def act(observation: object) -> "np.ndarray":
            action = planner.act()
            stage, terms = planner.explain()
            on_plan(stage, terms)
            time = environment.physics.time()
            if (int(time), stage) != last[0]:
                last[0] = int(time), stage
                listed = ", ".join(f"{name} {value:.3g}" for name, value in terms.items())
                typer.echo(f"{time:6.2f} s  {stage or 'plan'}: {listed}")
            return action

        return act

    return EnvironmentPolicy(begin_in)
