"""A model-predictive planner that solves the suite's tasks by simulating candidate plans.

    from limberjack.planner import Planner

    planner = Planner(env, seed=0)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(planner.act())

For your own task, pass `cost=`: a function of the physics, or an instance of a subclass of `Cost`.
See docs/planner.md.
"""

from limberjack.planner.cost import Cost, cost_for
from limberjack.planner.optimisers.icem import ICEM
from limberjack.planner.optimisers.mppi import MPPI
from limberjack.planner.planner import Planner
from limberjack.planner.settings import Settings

__all__ = ["ICEM", "MPPI", "Cost", "Planner", "Settings", "cost_for"]
