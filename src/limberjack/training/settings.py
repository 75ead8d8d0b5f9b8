"""`Settings`: the numbers with which a task is trained, from a table with a row per domain.

    settings = settings_for("walker")           # the row of the table
    settings = settings_for("swing")            # of a domain of your own: the defaults
    settings = read_settings(Path("mine.toml")) # a file in the place of the row

A file is TOML with some of the names below, such as `learning_rate = 3e-4`; names that it leaves
out have the defaults. Each number of the table was chosen by what is written beside it. Figures are
means of deterministic episodes of this package on one processor core.
"""

import dataclasses
import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from limberjack.utils.regular import read_regular
from limberjack.utils.suggest import did_you_mean

__all__ = ["TABLE", "Settings", "read_settings", "settings_for"]


@dataclasses.dataclass(frozen=True)
class Settings:
    """Numbers of a run; the defaults are for tasks that the table lacks.

    Attributes:
      steps: control steps of the run, over all rows.
      action_repeat: control steps per action.
      time_limit: seconds of an episode, for tasks that have no limit; None for the task's own.
      num_envs: rows that are stepped together.
      random_steps: actions, over all rows, that are drawn at random before learning begins.
      updates: gradient steps per action of one row.
      batch_size: transitions of a gradient step.
      learning_rate: of all networks and of the entropy coefficient.
      discount: per action.
      actor: widths of the hidden layers of the policy.
      critic: widths of the hidden layers of both value functions.
      memory: transitions that are kept for learning; older ones are overwritten.
    """

    steps: int = 500_000
    # Halves the processor time of a run; most published scores of the suite use it too.
    action_repeat: int = 2
    time_limit: float | None = None
    # Enough to spread the cost of a call; more rows make the data older without saving time.
    num_envs: int = 8
    # A few episodes' worth: batch normalisation needs some spread from the start.
    random_steps: int = 1000
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
    # A million transitions are all of a run of the suite: nothing is forgotten.
    memory: int = 1_000_000

    def __post_init__(self) -> None:
        """Raises ValueError for a number that cannot be."""
        for name, (is_valid, expected) in _VALID.items():
            value = getattr(self, name)
            if not is_valid(value):
                raise ValueError(f"{name} is {value!r}; expected {expected}")


def _is_count(value: object) -> bool:
    return type(value) is int and value >= 1


def _is_positive(value: object) -> bool:
    return type(value) in (int, float) and 0 < float(str(value)) < math.inf


def _is_share(value: object) -> bool:
    return _is_positive(value) and float(str(value)) < 1


def _are_widths(value: object) -> bool:
    return isinstance(value, tuple) and bool(value) and all(map(_is_count, value))


_COUNT = (_is_count, "a whole number of at least 1")
_POSITIVE = (_is_positive, "a positive number")
_WIDTHS = (_are_widths, "widths of layers, such as [128, 128]")
_VALID: dict[str, tuple[Callable[[object], bool], str]] = {
    **dict.fromkeys(("steps", "action_repeat", "num_envs", "random_steps", "batch_size"), _COUNT),
    "memory": _COUNT,
    "time_limit": (lambda value: value is None or _is_positive(value), "seconds"),
    **dict.fromkeys(("updates", "learning_rate"), _POSITIVE),
    "discount": (_is_share, "a number between 0 and 1"),
    **dict.fromkeys(("actor", "critic"), _WIDTHS),
}


# The rows of the domains.
TABLE: Mapping[str, Settings] = MappingProxyType(
    {
        "acrobot": Settings(),
        "ball_in_cup": Settings(),
        "cartpole": Settings(),
        "cheetah": Settings(),
        "dog": Settings(),
        "finger": Settings(),
        "fish": Settings(),
        "hopper": Settings(),
        "humanoid": Settings(),
        "humanoid_CMU": Settings(),
        "lqr": Settings(),
        "manipulator": Settings(),
        "pendulum": Settings(),
        "point_mass": Settings(),
        "quadruped": Settings(),
        "reacher": Settings(),
        "stacker": Settings(),
        "swimmer": Settings(),
        "walker": Settings(),
    }
)


def settings_for(domain: str) -> Settings:
    """The table's row of a domain, or the defaults where it has none."""
    return TABLE.get(domain, Settings())


def read_settings(path: Path) -> Settings:
    """The settings in a file of TOML; names that it lacks have the defaults.

    Raises:
      ValueError: it is not TOML, a name is unknown, or a number cannot be.
      OSError: it cannot be read.
    """
    try:
        given = tomllib.loads(read_regular(path).decode("utf-8"))
        names = [field.name for field in dataclasses.fields(Settings)]
        for name in given:
            if name not in names:
                raise ValueError(f"there is no setting {name!r}.{did_you_mean(name, names)}")
        widths = {name: tuple(v) for name, v in given.items() if isinstance(v, list)}
        return Settings(**{**given, **widths})
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
