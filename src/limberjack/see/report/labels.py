"""Names and units of what a policy sees and does: traced to the model, and declared by the domain.

    labels = labels_of(environment)
    labels.observations["joint_angles"][0]      # Label('abdomen_z', 'rad')
    labels.actions[0]                           # Label('abdomen_y', '40 N·m')

A domain declares no names. Every number of a copy of the simulation's state is replaced by a
distinct random one, and the task observes that copy: a number of the observation that is one of
them, or its sine, cosine or log1p, has its name and unit. A number that is computed from several is
named after the body, joint or sensor that it alone depends on, and what remains has its index. Both
have the unit that `OBSERVATIONS` of the task's module declares for all numbers of the observation.
"""

import contextlib
import copy
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from limberjack.mujoco import Physics
from limberjack.rl.control import Environment, flatten_observation
from limberjack.see.report.units import Label, controls, fields_of
from limberjack.suite.base import Observed

__all__ = ["Label", "Labels", "labels_of"]

_LEAST, _MOST = 0.1, 0.9  # of the random numbers: positive, so that logarithms and roots exist
_SAME = 1e-12  # relative; functions of arrays may round the last bit by position
_MOST_ROWS = 2000  # of all fields together; the task observes once for each, in about 0.1 ms
_AXES = "xyz"
_AND = "; "  # between the units of an observation whose numbers have several


class Labels(NamedTuple):
    """Labels of an environment's observations, by name, and of its actions; row-major order."""

    observations: Mapping[str, Sequence[Label]]
    actions: Sequence[Label]


def labels_of(environment: Environment) -> Labels:
    """The labels of an environment's flattened observations and actions.

    Observations without names and units are absent; there are no actions unless each is a control
    of an actuator. The environment is not changed, and its random stream continues as before.
    """
    physics = environment.physics
    if not isinstance(physics, Physics):
        return Labels({}, ())
    model = physics.model._model
    names = controls(model)
    spec = environment.action_spec()
    actions = names if getattr(spec, "shape", None) == (len(names),) else ()
    with _stream_kept(environment.task):
        try:
            observed = _Probe(environment, physics).observed()
        except Exception:  # of a task that computes with the state: charts then show indices
            return Labels({}, actions)
    return Labels(observed, actions)


@contextlib.contextmanager
def _stream_kept(task: object) -> Iterator[None]:
    """Leave the task's random stream as it was, if it has one."""
    stream = getattr(task, "random", None)
    if not isinstance(stream, np.random.RandomState):
        yield
        return
    state = stream.get_state()
    try:
        yield
    finally:
        stream.set_state(state)


class _Probe:
    """A copy of a simulation whose numbers are set at will, and the task that observes it."""

    def __init__(self, environment: Environment, physics: Physics) -> None:
        self._task = environment.task
        self._is_flat = environment._flat_observation
        self._physics = physics.copy(share_model=True)
        data = self._physics.data._data
        labels = fields_of(physics.model._model)
        self._labels = {name: of for name, of in labels.items() if of}
        self._arrays = {name: getattr(data, name) for name in self._labels}
        self._stream = np.random.RandomState(0)
        for array in self._arrays.values():
            array[...] = self._stream.uniform(_LEAST, _MOST, array.shape)
        self._base = {name: array.copy() for name, array in self._arrays.items()}

    def observed(self) -> dict[str, list[Label]]:
        """The labels of each observation that has any."""
        values, units = self._observe(), self._units()
        found = {name: self._matching(value) for name, value in values.items()}
        has_all = all(label is not None for labels in found.values() for label in labels)
        if not has_all and sum(map(len, self._arrays.values())) <= _MOST_ROWS:
            for name, derived in self._derived(values, units).items():
                pairs = zip(found[name], derived, strict=True)
                found[name] = [label or other for label, other in pairs]
        return {
            name: [label or _unnamed(name, units[name], i) for i, label in enumerate(labels)]
            for name, labels in found.items()
            if any(labels) or any(units[name])
        }

    def _observe(self) -> dict[str, np.ndarray]:
        with np.errstate(all="ignore"):
            observation = self._task.get_observation(self._physics)
            if self._is_flat:
                observation = flatten_observation(observation)
        return {name: np.array(value, float).ravel() for name, value in observation.items()}

    def _matching(self, values: np.ndarray) -> list[Label | None]:
        """The labels of numbers that are those of a field, or a function of one."""
        base = np.concatenate([array.ravel() for array in self._base.values()])
        labels = [label for name in self._base for label in self._labels[name]]
        found: list[Label | None] = [None] * len(values)
        for form, function in _FUNCTIONS.items():
            known = function(base)
            for i, value in enumerate(values):
                nearest = int(np.argmin(abs(known - value)))
                if found[i] is None and abs(known[nearest] - value) <= _SAME * abs(value):
                    found[i] = _in_form(labels[nearest], form)
        return found

    def _derived(
        self, values: dict[str, np.ndarray], units: dict[str, list[str]]
    ) -> dict[str, list[Label | None]]:
        """The labels of numbers by the one object that they alone depend on."""
        objects: dict[str, list[set[str]]] = {n: [set() for _ in v] for n, v in values.items()}
        for field, array in self._arrays.items():
            for row in range(len(array)):
                changed = self._changed(values, field, row)
                of_row = self._object(field, row)
                for name, is_changed in changed.items():
                    for i in np.flatnonzero(is_changed):
                        objects[name][i].add(of_row)
        return {name: _named(objects[name], units[name]) for name in values}

    def _object(self, field: str, row: int) -> str:
        """The name of the object of a field's row, without the axis."""
        labels = self._labels[field]
        array = self._arrays[field]
        name = labels[row * (array.size // len(array))].name
        return name if array.ndim == 1 else name.rsplit(" ", 1)[0]

    def _changed(
        self, values: dict[str, np.ndarray], field: str, row: int
    ) -> dict[str, np.ndarray]:
        """Masks of the observations' numbers that depend on a row of a field."""
        array = self._arrays[field]
        array[row] = self._stream.uniform(_LEAST, _MOST, array.shape[1:])
        seen = self._observe()
        self._restore()
        return {name: seen[name] != value for name, value in values.items()}

    def _units(self) -> dict[str, list[str]]:
        """The unit that is declared for each number of the observations; empty if none is."""
        declared = _declared_units(self._task)
        units = copy.copy(self._task.get_observation(self._physics))
        for name, value in units.items():
            units[name] = np.full(np.shape(value), declared.get(name, ""), object)
        if self._is_flat:
            units = flatten_observation(units)
        return {name: list(np.ravel(of)) for name, of in units.items()}

    def _restore(self) -> None:
        for name, array in self._arrays.items():
            array[...] = self._base[name]


_FUNCTIONS = {"{}": np.array, "sin {}": np.sin, "cos {}": np.cos, "log(1 + {})": np.log1p}


def _declared_units(task: object) -> dict[str, str]:
    """The units of observations whose numbers all have the same one, by name."""
    units: dict[str, str] = {}
    for kind in reversed(type(task).__mro__):
        declared = getattr(sys.modules.get(kind.__module__), "OBSERVATIONS", None)
        if isinstance(declared, Mapping):
            units |= {name: of.unit for name, of in declared.items() if isinstance(of, Observed)}
    return {name: unit for name, unit in units.items() if _AND not in unit}


def _unnamed(name: str, units: Sequence[str], index: int) -> Label:
    """The label of a number of an observation that depends on no single object."""
    return Label(name if len(units) == 1 else str(index), units[index])


def _in_form(label: Label, form: str) -> Label:
    if form == "{}":
        return label
    # A function of a number: its unit stands with that number.
    inner = label.name if "sin" in form or "cos" in form else str(label)
    return Label(form.format(inner))


def _named(objects: list[set[str]], units: list[str]) -> list[Label | None]:
    """Labels of one observation's numbers, from the objects that each depends on."""
    shared = set.intersection(*objects) if len(objects) > 1 else set()
    own = [sorted(of_number - shared) for of_number in objects]
    labels: list[Label | None] = []
    for i, names in enumerate(own):
        if len(names) != 1:
            labels.append(None)
            continue
        run = [j for j, others in enumerate(own) if others == names]
        is_vector = len(run) == len(_AXES) and run == list(range(run[0], run[0] + len(_AXES)))
        axis = f" {_AXES[i - run[0]]}" if is_vector else ""
        labels.append(Label(names[0] + axis, units[i]))
    return labels
