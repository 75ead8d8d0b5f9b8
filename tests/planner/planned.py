"""The tasks that the planner plays; `test_library.py` checks that no other task names a cost."""

from limberjack import suite

__all__ = ["PLANNED"]

_DOMAINS = ("humanoid", "manipulator", "stacker")
PLANNED = [task for task in suite.ALL_TASKS if task[0] in _DOMAINS]
