"""`Settings`: the numbers with which a task is trained, from a table with a row per domain.

    settings = settings_for("walker", "walk")   # the row of the task, or of its domain
    settings = settings_for("swing")            # of a domain of your own: the defaults
    settings = read_settings(Path("mine.toml")) # a file in the place of the row

The table is table.toml beside this file. A task that needs other settings than the rest of its
domain has a row of its own, "domain:task", with what differs from the domain's. The table and files
of your own are TOML with some of the names below, such as `learning_rate = 3e-4`; names that are
left out have the defaults. Each number was chosen by what is written beside it. Figures are means
of deterministic episodes of this package on one processor core.
"""

import dataclasses
import math
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from limberjack.policies.mlp import MOST_REPEAT
from limberjack.utils.files import read_regular
from limberjack.utils.suggest import did_you_mean

__all__ = ["MOST_ROWS", "TABLE", "Settings", "read_settings", "settings_for"]

MOST_ROWS = 1000  # of a run, whose seeds are a block
_LARGEST = sys.float_info.max
_WIDEST = 1e9  # of bounds of actions; larger ones mean 'unlimited'


@dataclasses.dataclass(frozen=True)
class Settings:
    """Numbers of a run; the defaults are for tasks that the table lacks.

    Attributes:
      steps: control steps of the run, over all rows.
      action_repeat: control steps per action.
      action_bound: largest absolute action, where the task has no bounds of its own.
      time_limit: seconds of an episode in training; None for the task's own. Evaluations have the
        task's own, or 1,000 control steps where it has none.
      num_envs: rows that are stepped together.
      random_steps: actions, over all rows, that are drawn at random before learning begins.
      noise: standard deviation of what is added to actions between -1 and 1 when a run begins; it
        falls to 0 until the middle of the run. It changes over some ten actions, so that it moves
        bodies where the noise of the policy cancels out.
      reward_offset: taken from the reward of each control step in learning, so that large sums of
        equal rewards do not hide small differences. Only for tasks that end by their limit alone.
      entropy: first weight of the policy's entropy beside rewards; later ones are learned.
      updates: gradient steps per action of one row; `num_envs` times as many are a whole number.
      batch_size: transitions of a gradient step.
      learning_rate: of all networks and of the entropy coefficient.
      discount: per action.
      actor: widths of the hidden layers of the policy; it is linear without any.
      critic: widths of the hidden layers of each value function.
      critics: value functions, of which the lowest counts.
      n_steps: actions whose rewards are added up before the value of the state after them counts.
      memory: transitions that are kept for learning; older ones are overwritten.
    """

    steps: int = 500_000
    # Halves the processor time of a run; most published scores of the suite use it too.
    action_repeat: int = 2
    # As random actions are drawn, of which there is no other guess.
    action_bound: float = 1.0
    time_limit: float | None = None
    # Enough to spread the cost of a call; more rows make the data older without saving time.
    num_envs: int = 8
    # A few episodes' worth: batch normalisation needs some spread from the start.
    random_steps: int = 1000
    # Most tasks are learned without.
    noise: float = 0.0
    # Rewards of the suite are between 0 and 1; those of lqr are below.
    reward_offset: float = 0.0
    # Where rewards are rare, 1 hides them: policies of pendulum stayed uniform for 90,000 actions.
    entropy: float = 1.0
    # The learner takes 95 % of the time: more updates cost more than they gain on easy tasks.
    updates: float = 0.5
    # 256 costs nearly twice as much and did not learn faster per second.
    batch_size: int = 128
    # Small networks with normalised layers learn at this rate without diverging.
    learning_rate: float = 5e-4
    # Sees 100 actions, 4 s of walker: the part of an episode over which its rewards are decided.
    discount: float = 0.99
    # A policy of 70 to 300 kB, and updates of 2.3 ms where 256 take 10.8 ms.
    actor: tuple[int, ...] = (128, 128)
    critic: tuple[int, ...] = (128, 128)
    # The lower one of two does not overestimate, as the algorithm's authors chose.
    critics: int = 2
    # Rewards of later actions depend on the policy that took them, which is not the present one.
    n_steps: int = 1
    # A million transitions are all of a run of the suite: nothing is forgotten.
    memory: int = 1_000_000

    def __post_init__(self) -> None:
        """Takes lists and NumPy's numbers, too; raises ValueError for one that cannot be."""
        for field in dataclasses.fields(self):
            value = _plain(getattr(self, field.name))
            object.__setattr__(self, field.name, value)
            is_valid, expected = _VALID.get(field.name) or _BY_TYPE[field.type]
            if not is_valid(value):
                raise ValueError(f"{field.name} is {value!r}; expected {expected}")
        updates = self.num_envs * self.updates
        whole = max(1, round(min(updates, _LARGEST)))  # an infinite number cannot be rounded
        if not math.isclose(updates, whole, rel_tol=0.01):
            raise ValueError(
                f"updates is {self.updates:g}, {updates:g} in all for the {self.num_envs} rows; "
                f"expected a whole number in all, as with updates = {1 / self.num_envs:g}"
            )

    @classmethod
    def of_toml(cls, row: Mapping[str, Any]) -> "Settings":  # Any: checked as they are taken
        """The settings with the entries of a table of TOML, and the defaults of all others.

        Raises:
          ValueError: a name is unknown, or a number cannot be.
        """
        names = [field.name for field in dataclasses.fields(cls)]
        for name, value in row.items():
            if isinstance(value, Mapping):
                raise ValueError(f"[{name}] begins a table; expected its lines without this one")
            if name not in names:
                raise ValueError(f"there is no setting {name!r}.{did_you_mean(name, names)}")
        return cls(**row)


def _plain(value: object) -> object:
    """A number of Python for one of NumPy, and a tuple for a list."""
    if isinstance(value, np.generic):
        return value.item()
    return tuple(map(_plain, value)) if isinstance(value, list | tuple) else value


def _is_count(value: object, most: float = _LARGEST) -> bool:
    return type(value) is int and 1 <= value <= most


def _is_within(value: object, above: float = -_LARGEST, below: float = _LARGEST) -> bool:
    """Whether a value is a number between two others."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return above < value < below


def _are_widths(value: object) -> bool:
    return isinstance(value, tuple) and all(map(_is_count, value))


_Check = tuple[Callable[[object], bool], str]  # and the values that it accepts
_BY_TYPE: Mapping[object, _Check] = {
    int: (_is_count, "a whole number of at least 1"),
    float: (lambda value: _is_within(value, above=0), "a positive number"),
    tuple[int, ...]: (_are_widths, "widths of layers, such as [128, 128]"),
}
# Of the settings that their types do not describe.
_VALID: Mapping[str, _Check] = {
    "num_envs": (lambda value: _is_count(value, MOST_ROWS), f"a whole number up to {MOST_ROWS}"),
    "action_repeat": (
        lambda value: _is_count(value, MOST_REPEAT),
        f"a whole number up to {MOST_REPEAT}",
    ),
    "action_bound": (
        lambda value: _is_within(value, 0, _WIDEST),
        f"a positive number below {_WIDEST:g}",
    ),
    "time_limit": (lambda value: value is None or _is_within(value, above=0), "seconds"),
    "noise": (lambda value: value in (0, 1) or _is_within(value, 0, 1), "a number from 0 to 1"),
    "reward_offset": (_is_within, "a number"),
    "discount": (lambda value: _is_within(value, 0, 1), "a number between 0 and 1"),
}

_ROWS = tomllib.loads(Path(__file__).with_name("table.toml").read_text(encoding="utf-8"))
TABLE: Mapping[str, Settings] = MappingProxyType(
    {name: Settings.of_toml(_ROWS[name.partition(":")[0]] | row) for name, row in _ROWS.items()}
)


def settings_for(domain: str, task: str | None = None) -> Settings:
    """The table's row of a task or of its domain, or the defaults where it has neither."""
    return TABLE.get(f"{domain}:{task}") or TABLE.get(domain, Settings())


def read_settings(path: Path) -> Settings:
    """The settings in a file of TOML; names that it lacks have the defaults.

    Raises:
      ValueError: it is not TOML, a name is unknown, or a number cannot be.
      OSError: it cannot be read.
    """
    try:
        return Settings.of_toml(tomllib.loads(read_regular(path).decode("utf-8")))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
