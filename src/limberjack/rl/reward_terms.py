"""The reward of a step and the terms that it is made of, computed once.

reward, terms = reward_and_terms(task, physics)
"""

from typing import Any

__all__ = ["reward_and_terms"]


def reward_and_terms(task: Any, physics: Any) -> tuple[Any, dict[str, Any]]:
    """The reward and its terms by name, (...) each; no terms if the reward is not made of them."""
    # As the suite's tasks have it; `True` itself, as a mock of a task has any attribute.
    if getattr(task.get_reward, "from_terms", False) is not True:
        return task.get_reward(physics), {}
    terms = task.reward_terms(physics)
    return task.reward_of(terms), terms
