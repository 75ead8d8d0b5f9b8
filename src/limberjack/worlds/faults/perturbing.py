"""`Perturber`: the value of a perturbed parameter in each episode, and the model fields it sets.

    perturber = Perturber(Perturbation(preset="easy"), task, physics.recompiler())
    value, falls = perturber.next(value, falls, normal=0.3, uniform=0.7)
    perturber.fields_of(value)      # {"body_mass": array(...), ...}

A task lists its parameters in `PERTURBATIONS`. Each has a function that sets it in the task's MJCF,
and MuJoCo's compiler derives inertias, bounding volumes and all else, as from a changed file.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol
from xml.etree import ElementTree

import numpy as np

from limberjack.utils.suggest import did_you_mean
from limberjack.worlds.faults.settings import Perturbation

__all__ = ["Parameter", "Perturber", "Range", "Recompiles"]

_TRIED = 9  # values of a range, of which the fields that they set are found
_KEPT = 32  # values whose fields are kept


@dataclasses.dataclass(frozen=True)
class Range:
    """Values of a parameter, in its unit."""

    lowest: float
    highest: float
    std: float  # of a random change from episode to episode


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A parameter of a task's model.

    Attributes:
      edit: sets it in the task's MJCF; a function at the top level of a module.
      start: its value before the first change.
      range: the values that it may have alone.
      presets: its ranges in the combined challenges, by name, if these perturb it.
    """

    edit: Callable[[ElementTree.Element, float], None]
    start: float
    range: Range
    presets: Mapping[str, Range] = dataclasses.field(default_factory=dict)


_Edit = Callable[[ElementTree.Element], None]


class Recompiles(Protocol):
    """Compiles a model again with changes: `limberjack.mujoco.recompiling.Recompiler`."""

    def names(self, edits: Iterable[_Edit]) -> tuple[str, ...]:
        """The fields that changes set."""
        ...

    def fields(self, edit: _Edit, names: Sequence[str]) -> dict[str, np.ndarray]:
        """Their values with a change."""
        ...


class Perturber:
    """See the module's docstring.

    Attributes:
      perturbation: with the numbers of the task's parameter.
      fields: names of the model fields that it sets.
    """

    def __init__(
        self, perturbation: Perturbation, parameter: Parameter, recompiler: Recompiles
    ) -> None:
        """Takes what `resolved` returns, and what compiles the task's model.

        Raises:
          ValueError: a value of the range gives no valid model, or none changes the model.
        """
        self.perturbation = perturbation
        self._parameter, self._recompiler = parameter, recompiler
        lowest, highest = self._bounds
        tried = np.linspace(lowest, highest, _TRIED).tolist()
        what = f"{perturbation.parameter} from {lowest} to {highest}"
        try:
            self.fields = recompiler.names([self._edit(value) for value in tried])
        except ValueError as error:
            why = " ".join(str(error).split())
            raise ValueError(f"{what} gives no valid model: {why}; choose another range") from error
        if not self.fields:
            raise ValueError(f"{what} changes nothing in the model")
        self._known: dict[float, dict[str, np.ndarray]] = {}

    @functools.cached_property
    def nominal(self) -> dict[str, np.ndarray]:
        """The model fields as the task's own model has them, by name."""
        return self._recompiler.fields(lambda root: None, self.fields)

    @classmethod
    def of(
        cls,
        perturbation: Perturbation,
        parameters: Mapping[str, Parameter],
        task: str,
        recompiler: Callable[[], Recompiles],
    ) -> "Perturber | None":
        """The perturber of a task; None if the combined challenge perturbs none of its parameters.

        Args:
          perturbation: the settings, in which numbers may be missing.
          parameters: those of the task, by name.
          task: its name, for messages.
          recompiler: makes what compiles the task's model.

        Raises:
          ValueError: the task has no such parameter, or numbers are not in order.
        """
        preset, name = perturbation.preset, perturbation.parameter
        if preset and not name:
            named = [one for one, parameter in parameters.items() if preset in parameter.presets]
            if not named:
                return None
            name = named[0]
        if name not in parameters:
            known = f"; it has {', '.join(parameters)}" if parameters else ", and no other"
            raise ValueError(
                f"task {task} has no parameter {name!r} to perturb{known}."
                f"{did_you_mean(name, parameters)}"
            )
        parameter = parameters[name]
        complete = _resolved(perturbation, name, parameter)
        return cls(complete, parameter, recompiler())

    @property
    def _bounds(self) -> tuple[float, float]:
        lowest, highest = self.perturbation.lowest, self.perturbation.highest
        assert lowest is not None
        assert highest is not None
        return lowest, highest

    def next(
        self, value: float | None, falls: bool, normal: float, uniform: float
    ) -> tuple[float, bool]:
        """The value that follows another one, and whether a saw wave falls from there.

        Args:
          value: the value before; None at first.
          falls: whether a saw wave falls.
          normal: a number drawn from the standard normal distribution.
          uniform: a number drawn from [0, 1).
        """
        settings, (lowest, highest) = self.perturbation, self._bounds
        start, std = settings.start, settings.std
        assert start is not None
        assert std is not None
        value = start if value is None else value
        change = std * normal
        match settings.schedule:
            case "random_walk":
                value += change
            case "drift_pos":
                value += abs(change)
            case "drift_neg":
                value -= abs(change)
            case "cyclic_pos":
                value += abs(change)
                value = start if value >= highest else value
            case "cyclic_neg":
                value -= abs(change)
                value = start if value <= lowest else value
            case "uniform":
                value = lowest + (highest - lowest) * uniform
            case "saw_wave":
                # The original sets the value to the change instead of adding it.
                value += -abs(change) if falls else abs(change)
                falls = value >= highest or (falls and value > lowest)
        return min(max(value, lowest), highest), falls

    def fields_of(self, value: float) -> dict[str, np.ndarray]:
        """The model fields of a value, by name."""
        if value not in self._known:
            if len(self._known) >= _KEPT:
                self._known.clear()
            self._known[value] = self._recompiler.fields(self._edit(value), self.fields)
        return self._known[value]

    def __deepcopy__(self, memo: dict[int, object]) -> "Perturber":
        """The same one: nothing of it changes but the values whose fields it keeps."""
        return self

    def _edit(self, value: float) -> _Edit:
        return lambda root: self._parameter.edit(root, value)


def _resolved(given: Perturbation, name: str, parameter: Parameter) -> Perturbation:
    """The perturbation with the published numbers in the place of missing ones.

    Raises:
      ValueError: the lowest value is above the highest, or the start is not between them.
    """
    known = parameter.presets.get(given.preset, parameter.range)
    lowest = known.lowest if given.lowest is None else given.lowest
    highest = known.highest if given.highest is None else given.highest
    start = min(max(parameter.start, lowest), highest) if given.start is None else given.start
    if not lowest <= start <= highest:
        raise ValueError(
            f"the perturbation of {name} has lowest {lowest}, start {start}, highest {highest}; "
            "expected them in this order"
        )
    std = known.std if given.std is None else given.std
    return dataclasses.replace(
        given, parameter=name, lowest=lowest, highest=highest, start=start, std=std
    )
