"""`LateChanges`: notices that a hook of a step changes what MuJoCo has computed from already.

    late = LateChanges(replicas, "Push", ("body_mass",))
    late.begin_step()                       # before `before_step`
    doubts = late.doubts(rows)              # before the rows are stepped
    diverged = replicas.step(rows, 5)
    late.check(doubts, 5, diverged)
    late.computed()                         # what follows is computed from the present state

A control step ends with the first half of the next time step, so that all quantities belong to the
new state. A single simulation goes on from there; a row computes that half again. The numbers are
equal unless a hook has set positions, velocities, mocap bodies or fields of the model in between.
A target that moves is harmless, a push is not, and an obstacle only where it is touched: so each
row that was changed is stepped in a single simulation too, and compared. After `physics.forward()`
both go on from the new values.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from limberjack.mujoco.replicas import Replicas
from limberjack.mujoco.simulation import STATE
from limberjack.rl.batch_errors import NotVectorised
from limberjack.utils.log import log

__all__ = ["Doubt", "LateChanges"]

_BITS = mujoco.mjtState
# Parts of the state that the first half of a time step depends on, by the names of their fields.
_PARTS = {
    "qpos": _BITS.mjSTATE_QPOS,
    "qvel": _BITS.mjSTATE_QVEL,
    "eq_active": _BITS.mjSTATE_EQ_ACTIVE,
    "mocap_pos": _BITS.mjSTATE_MOCAP_POS,
    "mocap_quat": _BITS.mjSTATE_MOCAP_QUAT,
}
_MANY = 8  # rows that are compared without a warning
_NO_ROWS = np.zeros(0, int)
_RUNGE_KUTTA = mujoco.mjtIntegrator.mjINT_RK4  # whose time steps are not split

_Values = dict[str, np.ndarray]  # by name, (num_envs, ...); without that axis of a row


class Doubt(NamedTuple):
    """A row that a hook has changed.

    Attributes:
      row: its number.
      names: of what was changed, such as 'data.qvel'.
      computed: the state that MuJoCo has computed from, and the row's model fields.
      changed: those from which the row is stepped.
    """

    row: int
    names: tuple[str, ...]
    computed: Mapping[str, np.ndarray]
    changed: Mapping[str, np.ndarray]


class LateChanges:
    """See the module's docstring."""

    # Any: of the domain's own physics.
    def __init__(
        self, replicas: Replicas[Any], task: str, fields: Sequence[str], is_idle: bool = False
    ) -> None:
        """Begins with rows whose quantities belong to their states.

        Args:
          replicas: the simulations.
          task: the task's name.
          fields: the model fields of which each row has its own.
          is_idle: whether the task is known to change nothing late, so that nothing is compared.
        """
        self._replicas, self._task, self._fields = replicas, task, tuple(fields)
        model = replicas.single.model._official
        sizes = {n: mujoco.mj_stateSize(model, bit.value) for n, bit in _PARTS.items()}
        self._slices = {
            name: slice(first, first + size)
            for name, size in sizes.items()
            # The parts are in the order of their bits.
            for first in [mujoco.mj_stateSize(model, STATE & (_PARTS[name].value - 1))]
            if size
        }
        is_split = replicas.physics.legacy_step and model.opt.integrator != _RUNGE_KUTTA
        self._is_watching = is_split and not is_idle
        self._has_warned = False
        self._is_pending = False  # whether hooks after the last step have changed something
        self.computed()

    def computed(self, rows: np.ndarray | None = None) -> None:
        """Notes that MuJoCo has computed from the present state of rows, None for all."""
        simulation = self._replicas.simulation
        self._calls = simulation.num_calls
        if not self._is_watching:
            return
        if rows is None:
            self._is_pending = False
            self._state = simulation.state.copy()
            own = simulation.own_fields
            self._own: _Values = {name: np.array(own[name][:]) for name in self._fields}
        else:
            self._state[rows] = simulation.state[rows]
            for name, values in self._own.items():
                values[rows] = simulation.own_fields[name][rows]

    def take_forward(self) -> None:
        """Notes a `physics.forward()` of a hook, from what it had set by then."""
        simulation = self._replicas.simulation
        if self._is_watching and simulation.num_calls != self._calls:
            self.computed()
            self._state = simulation.computed_from

    def begin_step(self) -> None:
        """Begins a step; what was changed between steps, but not by hooks, is left aside."""
        if not self._is_pending:
            self.computed()

    def after_hooks(self) -> None:
        """Notes whether the hooks after a step have changed something."""
        self._is_pending = len(self._changed()) > 0

    def forget(self) -> None:
        """Forgets what hooks have changed, as the state was set from outside."""
        self._is_pending = False

    def doubts(self, rows: np.ndarray | None) -> list[Doubt]:
        """Those of the rows, (n,) numbers or None for all, that a hook has changed."""
        changed = self._changed()
        if rows is not None:
            changed = np.intersect1d(changed, rows)
        if len(changed) > _MANY and not self._has_warned:
            self._has_warned = True
            log.warning(
                "task %s sets state or model in a step without physics.forward(): each row that it "
                "changes is compared with a single simulation, which takes time",
                self._task,
            )
        return [self._doubt(row) for row in changed.tolist()]

    def _doubt(self, row: int) -> Doubt:
        simulation = self._replicas.simulation
        now = {"state": simulation.state[row].copy()}
        now |= {name: np.array(simulation.own_fields[name][row]) for name in self._own}
        then = {"state": self._state[row].copy()}
        then |= {name: values[row].copy() for name, values in self._own.items()}
        parts = {f"data.{n}": (then["state"][i], now["state"][i]) for n, i in self._slices.items()}
        parts |= {f"model.{name}": (then[name], now[name]) for name in self._own}
        names = (name for name, (old, new) in parts.items() if old.tobytes() != new.tobytes())
        return Doubt(row, tuple(names), then, now)

    def check(self, doubts: Sequence[Doubt], n_sub_steps: int, diverged: np.ndarray) -> None:
        """Raises NotVectorised if a row in doubt, now stepped, differs from a single simulation.

        Args:
          doubts: of the step.
          n_sub_steps: its number of time steps.
          diverged: mask of rows that have diverged in it, which are not compared.
        """
        one = self._replicas.single.simulation
        for doubt in doubts:
            if diverged[doubt.row]:
                continue
            one.load({name: value[None] for name, value in doubt.computed.items()})
            fields = dict(doubt.changed)
            state = fields.pop("state")
            if fields:
                one.set_fields(fields)
            one.set_state(state, STATE)
            one.step(n_sub_steps)
            stepped = self._replicas.simulation.state[doubt.row]
            if one.get_state(STATE).tobytes() != stepped.tobytes():
                raise NotVectorised(
                    f"task {self._task} sets {', '.join(doubt.names)} in a step, from which MuJoCo "
                    "has computed already: a single environment still uses what followed from the "
                    f"old values, and row {doubt.row} of a vectorised batch does not, so that they "
                    "differ: call physics.forward() after setting it, or take vectorised=False"
                )

    def _changed(self) -> np.ndarray:
        """The rows in which something was changed since it was computed from, (n,)."""
        simulation = self._replicas.simulation
        if not self._is_watching:
            return _NO_ROWS
        self.take_forward()
        pairs = [(self._state[:, at], simulation.state[:, at]) for at in self._slices.values()]
        pairs += [(values, simulation.own_fields[n][:]) for n, values in self._own.items()]
        if all(old.tobytes() == new.tobytes() for old, new in pairs):
            return _NO_ROWS
        rows = range(len(self._state))
        return np.array(
            [r for r in rows if any(old[r].tobytes() != new[r].tobytes() for old, new in pairs)]
        )
