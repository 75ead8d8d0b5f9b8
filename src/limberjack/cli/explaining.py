"""`explained`: the planner as a policy that prints the stages and the terms of its plans' cost."""

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    import numpy as np

    from limberjack.policies import Act, EnvironmentPolicy
    from limberjack.rl.control import Environment

__all__ = ["explained"]


def explained(threads: int | None) -> "EnvironmentPolicy":
    """The planner, which prints its plan's cost each simulated second and in each new stage."""
    from limberjack.planner import Planner
    from limberjack.policies import EnvironmentPolicy

    def begin_in(environment: "Environment", seed: int) -> "Act":
        planner = Planner(environment, threads, seed)
        last: list[tuple[int, str]] = [(-1, "")]

        def act(observation: object) -> "np.ndarray":
            action = planner.act()
            stage, terms = planner.explain()
            time = environment.physics.time()
            if (int(time), stage) != last[0]:
                last[0] = int(time), stage
                listed = ", ".join(f"{name} {value:.3g}" for name, value in terms.items())
                typer.echo(f"{time:6.2f} s  {stage or 'plan'}: {listed}")
            return action

        return act

    return EnvironmentPolicy(begin_in)
