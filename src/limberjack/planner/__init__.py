"""A model-predictive planner that solves the suite's tasks by simulating candidate plans.

    from limberjack.planner import Planner

    planner = Planner(env, seed=0)
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(planner.act())

For your own task, pass `cost=`, an instance of a subclass of `Cost`. See docs/planner.md.
"""

from limberjack.planner.cost import Cost, cost_for
from limberjack.planner.mppi import Planner
from limberjack.planner.settings import Settings

__all__ = ["Cost", "Planner", "Settings", "cost_for"]
