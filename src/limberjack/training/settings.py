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

from limberjack.utils.files import read_regular
from limberjack.utils.suggest import did_you_mean

__all__ = ["TABLE", "Settings", "read_settings", "settings_for"]


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
      updates: gradient steps per action of one row.
      batch_size: transitions of a gradient step.
      learning_rate: of all networks and of the entropy coefficient.
      discount: per action.
      actor: widths of the hidden layers of the policy.
      critic: widths of the hidden layers of each value function.
      critics: value functions, of which the lowest counts.
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


def _is_number(value: object) -> bool:
    return type(value) in (int, float) and math.isfinite(float(str(value)))


def _is_positive(value: object) -> bool:
    return _is_number(value) and float(str(value)) > 0


def _is_share(value: object) -> bool:
    return _is_positive(value) and float(str(value)) < 1


def _are_widths(value: object) -> bool:
    return isinstance(value, tuple) and bool(value) and all(map(_is_count, value))


_COUNT = (_is_count, "a whole number of at least 1")
_POSITIVE = (_is_positive, "a positive number")
_WIDTHS = (_are_widths, "widths of layers, such as [128, 128]")
_VALID: dict[str, tuple[Callable[[object], bool], str]] = {
    **dict.fromkeys(("steps", "action_repeat", "num_envs", "random_steps", "batch_size"), _COUNT),
    **dict.fromkeys(("critics", "memory"), _COUNT),
    "time_limit": (lambda value: value is None or _is_positive(value), "seconds"),
    **dict.fromkeys(("action_bound", "entropy", "updates", "learning_rate"), _POSITIVE),
    "noise": (lambda value: value == 0 or _is_share(value), "a number from 0 to 1"),
    "reward_offset": (_is_number, "a number"),
    "discount": (_is_share, "a number between 0 and 1"),
    **dict.fromkeys(("actor", "critic"), _WIDTHS),
}


# Rows of domains. The reason of each number that is not the default stands above it. A number that
# was not tried is said to be taken over; the table of docs/training.md has what was measured.
TABLE: Mapping[str, Settings] = MappingProxyType(
    {
        # Taken over from cheetah; a chaotic swing-up needs the steps more than their order.
        "acrobot": Settings(steps=1_000_000, updates=1.0, batch_size=256, critic=(256, 256)),
        # One reward, for a catch, within the first 200,000 steps; then it is soon repeated.
        "ball_in_cup": Settings(steps=200_000),
        # A control step is 10 ms, so that 4 make the same 40 ms as 2 elsewhere. Of swingup, batches
        # of 128 end at 810 and those of 256 at 800 to 860; fewer updates than actions end below
        # 700. An episode has 250 actions: a discount of 0.98 sees a fifth of it, as 0.99 does of
        # 500, and had 828 after 88,000 steps where 0.99 had 733. swingup_sparse finds no rewards
        # with them; with noise of 0.5 and an entropy of 0.01 it had 140 after 160,000 steps.
        "cartpole": Settings(
            steps=160_000, action_repeat=4, updates=1.0, batch_size=256, discount=0.98
        ),
        # Half an update for each action stayed at 450 after 400,000 steps; published runs have a
        # million steps, one update or two, and wider value functions.
        "cheetah": Settings(steps=1_000_000, updates=1.0, batch_size=256, critic=(256, 256)),
        # Taken over from humanoid.
        "dog": Settings(
            steps=1_000_000, updates=1.0, batch_size=256, actor=(256, 256), critic=(512, 512)
        ),
        # Half an update rose slowly, to 561 of spin after 300,000 steps.
        "finger": Settings(updates=1.0, batch_size=256),
        # Updates taken over from finger. In one run upright had 899 after 75,000 steps and 919
        # after 100,000, in another 844 at the end; the best published mean is 803.
        "fish": Settings(steps=150_000, updates=1.0, batch_size=256),
        # Half an update learned nothing in 400,000 steps of stand.
        "hopper": Settings(steps=1_000_000, updates=1.0, batch_size=256, critic=(256, 256)),
        # 67 observations and 21 actions: published runs have layers of 512 or more.
        "humanoid": Settings(
            steps=1_000_000, updates=1.0, batch_size=256, actor=(256, 256), critic=(512, 512)
        ),
        # Taken over from humanoid.
        "humanoid_CMU": Settings(
            steps=1_000_000, updates=1.0, batch_size=256, actor=(256, 256), critic=(512, 512)
        ),
        # On ten starts of lqr_2_1 the optimal policy's cost is multiplied by 1.51, 1.11 and 1.002
        # with bounds of 1, 2 and 4, by 1.54 and 1.04 with a discount of 0.99 and 0.998 for a
        # control step (this one is for 4), and by 1.004 if actions are repeated 4 times. Of two
        # value functions the lower one is too careful: 1.10, and 1.05 with one. A control step pays
        # 1 less its cost, so the offset leaves the cost.
        "lqr": Settings(
            steps=80_000,
            action_repeat=4,
            action_bound=4.0,
            time_limit=30.0,
            reward_offset=1.0,
            updates=1.0,
            batch_size=256,
            discount=0.998,
            critics=1,
        ),
        # Taken over from hopper.
        "manipulator": Settings(steps=1_000_000, updates=1.0, batch_size=256, critic=(256, 256)),
        # Rewards are at the top alone, where one start in 20 is: episodes of 3 s have more starts
        # than those of 20 s. It learns to hold the pole there, and not yet to swing it up.
        "pendulum": Settings(
            steps=200_000, time_limit=3.0, noise=0.5, entropy=0.01, updates=1.0, batch_size=256
        ),
        # As pendulum: few states.
        "point_mass": Settings(steps=200_000, batch_size=256),
        # Taken over from cheetah, with a policy wide enough for 78 observations.
        "quadruped": Settings(
            steps=1_000_000, updates=1.0, batch_size=256, actor=(256, 256), critic=(256, 256)
        ),
        # hard has 863 after 60,000 steps and 971 after 240,000.
        "reacher": Settings(steps=240_000),
        # Taken over from hopper.
        "stacker": Settings(steps=1_000_000, updates=1.0, batch_size=256, critic=(256, 256)),
        # Taken over from finger.
        "swimmer": Settings(updates=1.0, batch_size=256),
        # walk has 938 after 300,000 steps and 949 after 400,000.
        "walker": Settings(steps=400_000),
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
