"""The tasks that the planner plays, which are all: those with stages, and those without."""

from limberjack import suite

__all__ = ["ONE_OF_EACH_COST", "PLANNED", "SINGLE_STAGE"]

_WITH_STAGES = ("humanoid", "manipulator", "stacker")
PLANNED = [task for task in suite.ALL_TASKS if task[0] in _WITH_STAGES]

SINGLE_STAGE = [task for task in suite.ALL_TASKS if task[0] not in _WITH_STAGES]

ONE_OF_EACH_COST = [
    *(("acrobot", "swingup"), ("ball_in_cup", "catch"), ("cartpole", "three_poles")),
    *(("cheetah", "run"), ("dog", "walk"), ("dog", "fetch"), ("finger", "spin")),
    *(("finger", "turn_hard"), ("fish", "upright"), ("fish", "swim"), ("hopper", "hop")),
    *(("humanoid_CMU", "run"), ("lqr", "lqr_6_2"), ("pendulum", "swingup")),
    *(("point_mass", "hard"), ("quadruped", "run"), ("quadruped", "escape")),
    *(("quadruped", "fetch"), ("reacher", "hard"), ("swimmer", "swimmer6"), ("walker", "run")),
]
