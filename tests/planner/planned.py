"""The tasks that the planner plays; `test_cost.py` checks that no other task names a cost."""

from limberjack import suite

__all__ = ["ONE_OF_EACH_COST", "PLANNED", "SINGLE_STAGE"]

_WITH_STAGES = ("humanoid", "manipulator", "stacker")
PLANNED = [task for task in suite.ALL_TASKS if task[0] in _WITH_STAGES]

_ONE_STAGE = {
    "acrobot": ("swingup", "swingup_sparse"),
    "ball_in_cup": ("catch",),
    "cartpole": (
        *("balance", "balance_sparse", "swingup", "swingup_sparse"),
        *("two_poles", "three_poles"),
    ),
    "cheetah": ("run",),
    "finger": ("turn_easy", "turn_hard"),
    "fish": ("swim",),
    "hopper": ("stand", "hop"),
    "pendulum": ("swingup",),
    "quadruped": ("walk", "run"),
    "reacher": ("easy", "hard"),
    "walker": ("stand", "walk", "run"),
}
SINGLE_STAGE = [(domain, task) for domain, tasks in _ONE_STAGE.items() for task in tasks]
ONE_OF_EACH_COST = [(domain, tasks[-1]) for domain, tasks in _ONE_STAGE.items()]
