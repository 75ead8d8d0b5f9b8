"""`Faults`: the faults of the real world, as settings.

    Faults.of("easy")                                   # a combined challenge
    Faults.of({"delay": {"observations": 3}, "noise": {"actions": 0.1}})
    Faults.of({"preset": "hard", "dummies": 0})         # a preset with changes

The challenges are those of the Real World RL suite (Dulac-Arnold et al., 2020,
https://arxiv.org/abs/2003.11881). Their figures are those of `get_combined_challenge` in
realworldrl_suite/environments/realworld_env.py of
https://github.com/google-research/realworldrl_suite, commit be7a51c.
"""

import dataclasses
import math
import numbers
import typing
from collections.abc import Mapping

from limberjack.utils.suggest import check_names, did_you_mean

__all__ = [
    "CHALLENGES",
    "PRESETS",
    "SCHEDULES",
    "Delay",
    "Fault",
    "Faults",
    "Losses",
    "Noise",
    "Perturbation",
]

# Combined challenges, from the least to the most.
CHALLENGES = ("easy", "medium", "hard")

# Of the value of a perturbed parameter from episode to episode; see `perturbing`.
SCHEDULES = (
    "constant",
    "random_walk",
    "drift_pos",
    "drift_neg",
    "cyclic_pos",
    "cyclic_neg",
    "uniform",
    "saw_wave",
)


def _number(default: float, lowest: float, highest: float = math.inf) -> typing.Any:  # as `field`
    return dataclasses.field(default=default, metadata={"range": (lowest, highest)})


@dataclasses.dataclass(frozen=True)
class Delay:
    """Control steps by which each is late."""

    actions: int = _number(0, 0)
    observations: int = _number(0, 0)
    rewards: int = _number(0, 0)


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviations of Gaussian noise, in the units of what it is added to."""

    actions: float = _number(0.0, 0.0)
    observations: float = _number(0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Fault:
    """A fault that begins at random, and lasts."""

    probability: float = _number(0.0, 0.0, 1.0)  # to begin in a control step without one
    steps: int = _number(1, 1, 10**9)  # that it lasts


@dataclasses.dataclass(frozen=True)
class Losses:
    """Faults of each number of actions and observations by itself."""

    actions: Fault = Fault()
    observations: Fault = Fault()


@dataclasses.dataclass(frozen=True)
class Perturbation:
    """A parameter of the model that differs from episode to episode."""

    parameter: str = ""  # one of the task's; empty for the one of its combined challenges
    schedule: str = "uniform"
    period: int = _number(1, 1)  # episodes with one value
    # Of the parameter; None for those that the suite publishes.
    lowest: float | None = None
    highest: float | None = None
    start: float | None = None
    std: float | None = None  # of a random change
    preset: str = ""  # the combined challenge whose range it has

    def __post_init__(self) -> None:
        if self.preset not in ("", *CHALLENGES):
            raise ValueError(
                f"the preset of a perturbation is {self.preset!r}; expected one of "
                f"{', '.join(CHALLENGES)}.{did_you_mean(self.preset, CHALLENGES)}"
            )
        if self.schedule not in SCHEDULES:
            raise ValueError(
                f"the schedule of a perturbation is {self.schedule!r}; expected one of "
                f"{', '.join(SCHEDULES)}.{did_you_mean(self.schedule, SCHEDULES)}"
            )


@dataclasses.dataclass(frozen=True)
class Faults:
    """See the module's docstring; by default there are none.

    Attributes:
      delay: of actions, observations and rewards.
      noise: of actions and observations.
      dropped: numbers that are 0 for some steps.
      stuck: numbers that keep their last value for some steps.
      repetition: steps that repeat an action: with `steps` 1, none.
      dummies: number of observations of pure noise.
      perturbation: of the model; None for none.
      clear_at_reset: whether an episode begins without the delayed, dropped, stuck and repeated
        values of the one before. The original suite keeps them.
    """

    delay: Delay = Delay()
    noise: Noise = Noise()
    dropped: Losses = Losses()
    stuck: Losses = Losses()
    repetition: Fault = Fault()
    dummies: int = _number(0, 0)
    perturbation: Perturbation | None = None
    clear_at_reset: bool = True

    @classmethod
    def of(cls, given: "str | Mapping[str, object] | Faults") -> "Faults":
        """The settings of a preset, or of a mapping, which may begin with a preset.

        Raises:
          ValueError: there is no such preset, or a value is out of range.
          TypeError: it is none of these, there is no such fault, or a value has another type.
        """
        if isinstance(given, Faults):
            cls.of(given.as_json())  # nobody has checked its values
            return given
        if isinstance(given, str):
            return _preset(given)
        if not isinstance(given, Mapping):
            raise TypeError(
                f"faults is {given!r}; expected one of {', '.join(PRESETS)}, or a mapping such as "
                "{'delay': {'actions': 3}}"
            )
        changes = dict(given)
        name = changes.pop("preset", None)
        base = cls() if name is None else _preset(name)
        return _changed(base, changes, "faults")

    def as_json(self) -> dict[str, object]:
        """The settings as values of JSON, from which `of` makes equal ones."""
        return dataclasses.asdict(self)


def _preset(name: object) -> Faults:
    if not isinstance(name, str) or name not in PRESETS:
        raise ValueError(
            f"there are no faults {name!r}; expected one of {', '.join(PRESETS)}, or a mapping "
            f"such as {{'delay': {{'actions': 3}}}}.{did_you_mean(name, PRESETS)}"
        )
    return PRESETS[name]


_T = typing.TypeVar("_T", Delay, Noise, Fault, Losses, Perturbation, Faults)


def _changed(base: _T, changes: object, where: str) -> _T:
    """The settings with some changed, each checked.

    Raises:
      ValueError, TypeError: see `Faults.of`.
    """
    fields = {field.name: field for field in dataclasses.fields(base)}
    if not isinstance(changes, Mapping):
        raise TypeError(f"{where} is {changes!r}; expected a mapping of {', '.join(fields)}")
    kinds = typing.get_type_hints(type(base))
    values = {}
    check_names(f"{where} has no", changes, fields)
    for name, value in changes.items():
        path = f"{where}[{name!r}]"
        values[name] = _value(getattr(base, name), value, kinds[name], path, fields[name].metadata)
    return dataclasses.replace(base, **values)


def _value(
    base: object, given: object, kind: object, path: str, limits: Mapping[str, object]
) -> object:
    """A value of a setting, checked."""
    options = typing.get_args(kind) or (kind,)
    if given is None and type(None) in options:
        return None
    if Perturbation in options and base is None:
        base = Perturbation()
    if dataclasses.is_dataclass(base) and not isinstance(base, type):
        return _changed(typing.cast(Faults, base), given, path)
    if bool in options or str in options:
        wanted = bool if bool in options else str
        if not isinstance(given, wanted):
            raise TypeError(f"{path} is {given!r}; expected a {wanted.__name__}")
        return given
    return _checked_number(given, int in options, path, limits)


def _checked_number(
    given: object, is_whole: bool, path: str, limits: Mapping[str, object]
) -> float:
    kind = "whole number" if is_whole else "number"
    of_kind = numbers.Integral if is_whole else numbers.Real
    if not isinstance(given, of_kind) or isinstance(given, bool):
        raise TypeError(f"{path} is {given!r}; expected a {kind}")
    # Any: of a type of NumPy, or of Python.
    number: typing.Any = given
    lowest, highest = typing.cast(tuple[float, float], limits.get("range", (-math.inf, math.inf)))
    if not (lowest <= number <= highest and math.isfinite(number)):
        bounds = f"{lowest} or more" if highest == math.inf else f"{lowest} to {highest}"
        raise ValueError(f"{path} is {given!r}; expected a {kind}, {bounds}")
    return int(number) if is_whole else float(number)


def _combined(
    name: str,
    late: int,
    late_rewards: int,
    noise: float,
    loss: Fault,
    repeated: int,
    dummies: int,
) -> Faults:
    """A combined challenge of the Real World RL suite; it repeats every action."""
    losses = Losses(observations=loss)
    return Faults(
        Delay(late, late, late_rewards),
        Noise(noise, noise),
        losses,
        losses,
        Fault(1.0, repeated),
        dummies,
        Perturbation(preset=name),
    )


PRESETS: Mapping[str, Faults] = {
    "easy": _combined("easy", 3, 10, 0.1, Fault(0.01, 1), 1, 10),
    "medium": _combined("medium", 6, 20, 0.3, Fault(0.05, 5), 2, 20),
    "hard": _combined("hard", 9, 40, 1.0, Fault(0.1, 10), 3, 50),
}
