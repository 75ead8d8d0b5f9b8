"""`DeviceBatch`: many episodes of one task, stepped in lockstep on a device.

    batch = DeviceBatch(environment, num_envs=4096, device="cuda:0", seed=0)
    observation = batch.reset()
    outcome = batch.step(actions)       # tensors on the device; nothing waits for it

A control step sets the controls, runs the physics steps, begins the episodes that are due, computes
the first half of the next step, and then the observation and the reward with the task's own code.
`step` makes one control step, or several if actions are repeated.

Row i's first episode is that of `RandomState(seed + i)`, as on the CPU. Later episodes take their
starts from a ring buffer of `num_envs` starts, the oldest first. Control steps replace the oldest
starts by new ones, whose seeds come from a separate random stream. By default there are as many new
starts as episodes that last until the time limit need.

It is one idea, and long: the counter, the ring of starts and the rows of numbers serve this class
alone.
"""

import copy
import dataclasses
import math
import os
from collections.abc import Sequence
from typing import Any, TypedDict

import mujoco
import numpy as np

from limberjack.gpu import model_fields
from limberjack.gpu.backend import torch
from limberjack.gpu.sizes import Sizes
from limberjack.gpu.starts import Part, Starts
from limberjack.gpu.tensors import device_array, plain
from limberjack.gpu.warp_simulation import WarpSimulation, bytes_per_row
from limberjack.mujoco.model_values import derived_fields
from limberjack.rl.contract import Task
from limberjack.rl.control import Environment
from limberjack.rl.reward_terms import reward_and_terms
from limberjack.suite import base
from limberjack.utils.arrays import Quantity, rows_of_a_batch
from limberjack.utils.seeds import checked_seed

__all__ = [
    "BatchState",
    "Counter",
    "DeviceBatch",
    "Ending",
    "Options",
    "Outcome",
    "usual_starts_per_step",
]

_FRESH_AT_ONCE = 8  # new starts that are drawn and copied together
_USUAL_EPISODE = 1_000  # steps; length assumed for episodes without a time limit
_LARGEST = mujoco.mjMAXVAL  # MuJoCo replaces a state with larger values
_SHARE = 0.9  # of the free memory: kernels and PyTorch take some too

# Tensors in this module are of (num_envs, ...).
_Observation = dict[str, torch.Tensor]


@dataclasses.dataclass(frozen=True)
class Options:
    """Settings of a batch on a device.

    Attributes:
      sizes: room for contacts and constraints.
      starts_per_step: new starts to draw in each control step, on average.
      uses_graphs: record sequences of kernels, and replay them.
      begins_next: begin a row's next episode in the step after its last one ended; otherwise the
        row waits for `begin`.
      action_repeat: control steps per action; see `control.Environment.step`.
    """

    sizes: Sizes
    starts_per_step: float
    uses_graphs: bool
    begins_next: bool
    action_repeat: int = 1


@dataclasses.dataclass(frozen=True)
class Ending:
    """Masks of the rows whose episode ends.

    Attributes:
      last: for any reason.
      terminated: because of the task or divergence.
      truncated: because of the time limit.
    """

    last: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The result of a step; later steps do not change its tensors.

    Attributes:
      observation: by name.
      reward: summed over the action's control steps; 0 where an episode begins, and for a control
        step in which a row diverges.
      ending: which episodes end, and how.
      terms: terms of the reward by name, summed too; empty if the task has none.
      success: whether the goal is reached in the last control step; None if the task has none.
      begun: rows that began an episode.
      diverged: rows whose state left MuJoCo's range, or whose action was not finite.
      overflow: rows whose contacts or constraints had no room.
    """

    observation: _Observation
    reward: torch.Tensor
    ending: Ending
    terms: dict[str, torch.Tensor]
    success: torch.Tensor | None
    begun: torch.Tensor
    diverged: torch.Tensor
    overflow: torch.Tensor


class _Stream(TypedDict):
    """The state of a `RandomState`, whose key `torch.load` reads as a tensor only."""

    key: torch.Tensor
    position: int
    gauss: tuple[int, float]


class BatchState(TypedDict):
    """The result of `DeviceBatch.state_dict`.

    Attributes:
      parts: see `DeviceBatch.parts`.
      rows: see `DeviceBatch.read_rows`.
      steps, terminated, truncated: see `Counter`.
      ring, head, tail: the ring of starts, the number of the next one to use, and of the next one
        to replace.
      owed: number of new starts that are due, perhaps fractional.
      random: state of the stream that later seeds are drawn from.
      seeds: of the rows.
    """

    parts: list[str]
    rows: torch.Tensor
    steps: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    ring: torch.Tensor
    head: torch.Tensor
    tail: int
    owed: float
    random: _Stream
    seeds: list[int]


class Counter:
    """The steps of each row's episode, and how its episode ends.

    The rules are those of `limberjack.rl.endings`, written without waiting for the device.

    Attributes:
      steps: control steps of each row's episode so far.
      terminated, truncated: masks of the rows whose last episode ended so; False again once a row
        begins another one.
    """

    def __init__(self, num_envs: int, step_limit: float, device: torch.device | str) -> None:
        self.step_limit = step_limit
        self.steps = torch.zeros(num_envs, dtype=torch.int64, device=device)
        self.terminated = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.truncated = self.terminated.clone()

    @property
    def ended(self) -> torch.Tensor:
        """Mask of the rows whose episode has ended and that have not begun another one."""
        return self.terminated | self.truncated

    def begin(self, rows: torch.Tensor) -> None:
        """Begins an episode in the rows of a mask."""
        self.steps.masked_fill_(rows, 0)
        self.terminated.logical_and_(~rows)
        self.truncated.logical_and_(~rows)

    def count(
        self,
        begun: torch.Tensor,
        diverged: torch.Tensor,
        reward: torch.Tensor,
        termination: torch.Tensor | None,
    ) -> tuple[torch.Tensor, Ending]:
        """Counts a step; returns the reward to report, and which episodes end.

        A row whose episode ended in an earlier step reports the same ending in every step until it
        begins another episode.

        Args:
          begun: rows that began an episode in this step.
          diverged: rows that diverged.
          reward: the task's reward.
          termination: the task's termination, NaN where an episode continues; None for no rows.
        """
        self.begin(begun)
        waits = self.ended
        runs = ~begun & ~waits
        self.steps.add_(runs)
        at_limit = (self.steps >= self.step_limit) & runs & ~diverged
        ends = diverged & runs
        if termination is not None:
            ends = ends | (~torch.isnan(termination) & runs & ~at_limit)
        self.truncated.logical_or_(at_limit)
        self.terminated.logical_or_(ends)
        silent = begun | waits | diverged
        reward = torch.where(silent, torch.zeros_like(reward), reward)
        return reward, Ending(self.ended, self.terminated.clone(), self.truncated.clone())


class DeviceBatch:
    """See the module's docstring."""

    def __init__(
        self,
        environment: Environment,
        num_envs: int,
        device: torch.device,
        seed: int | None,
        options: Options,
    ) -> None:
        """Creates a batch whose first call must be `reset`.

        Args:
          environment: a single environment of the task, which is not changed.
          num_envs: number of rows.
          device: a `torch.device`.
          seed: row i's first episode is that of `RandomState(seed + i)`; None for an arbitrary one.
          options: see `Options`.

        Raises:
          ValueError: the task is not batch-safe, or its model or fields are not for a device.
          TypeError: the task's code leaves NumPy's protocols.
          MemoryError: the rows do not fit into the device's memory.
        """
        self.num_envs, self.device, self.options = num_envs, device, options
        self.task: Any = copy.copy(environment.task)  # the domain's own class
        if getattr(self.task, "visualize_reward", False):
            self.task.visualize_reward = False  # the rows share the colours of materials
        self.environment = environment
        self.n_sub_steps = environment._n_sub_steps
        own, model = environment._saved_fields(), environment.physics.model
        model_fields.check(own)
        if environment.physics.simulation.sets_constants:  # add what mj_setConst recomputes
            own = tuple(dict.fromkeys((*own, *model_fields.batched(derived_fields(own)))))
        _check_memory(num_envs, bytes_per_row(model, own, options.sizes), device)
        self.simulation = WarpSimulation(
            model, num_envs, str(device), own, options.sizes, options.uses_graphs
        )
        self.physics = environment.physics.seen_through(self.simulation)
        with self.simulation.scope():
            self._try_task()
            self.starts = Starts(environment, tuple(self.simulation.late), own)
            self._rows = _Rows(self.simulation, self.starts.parts)
            self._default = torch.from_numpy(self.starts.default()).to(device)
            self.counter = Counter(num_envs, environment._step_limit, device)
            self._none = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self._ring: _Ring | None = None
        self._fresh_at_once = min(_FRESH_AT_ONCE, num_envs)
        self._owed = 0.0
        self.seed(seed)

    def seed(self, seed: int | None) -> None:
        """Makes the next `reset` of all rows begin episodes of `RandomState(seed + i)`."""
        first = np.random.RandomState().randint(2**31) if seed is None else checked_seed(seed)
        checked_seed(first + self.num_envs - 1)
        self.seeds = list(range(first, first + self.num_envs))
        # The seeds of later starts.
        self._random = np.random.RandomState([first, self.num_envs])
        self._ring = None
        self._owed = self._fresh_at_once - 1.0  # so that new starts come early rather than late

    def reset(
        self, mask: np.ndarray | None = None, seeds: Sequence[int | None] | None = None
    ) -> _Observation:
        """Begins an episode in all rows or in those of a mask; returns the observation of all.

        Args:
          mask: (num_envs,) booleans.
          seeds: for each row the seed whose first episode it begins. A row with None takes a start
            from the ring, or in the first call begins its first episode.
        """
        numbers = np.arange(self.num_envs) if mask is None else np.flatnonzero(mask)
        given = list(seeds) if seeds is not None else [None] * self.num_envs
        if self._ring is None:
            given = [
                own if one is None else one for own, one in zip(self.seeds, given, strict=True)
            ]
            numbers = np.arange(self.num_envs)
        drawn = [row for row in numbers.tolist() if given[row] is not None]
        with self.simulation.scope():
            if drawn:
                self._begin_seeded(drawn, given)
            others = np.isin(numbers, drawn, invert=True)
            if others.any():
                chosen = torch.zeros_like(self._none)
                chosen[torch.from_numpy(numbers[others]).to(self.device)] = True
                self._begin(chosen)
            self.simulation.first_half()
            return self._observation()

    def _begin_seeded(self, drawn: Sequence[int], seeds: Sequence[int | None]) -> None:
        """Begins the first episodes of seeds in rows."""
        values = np.zeros((self.num_envs, self.starts.width), np.float32)
        values[drawn] = self.starts.draw([int(seeds[row] or 0) for row in drawn])
        self._check_shared(values[drawn])
        for row in drawn:
            self.seeds[row] = int(seeds[row] or 0)
        mask = np.zeros(self.num_envs, bool)
        mask[drawn] = True
        chosen, rows = (torch.from_numpy(array).to(self.device) for array in (mask, values))
        if self._ring is None:
            self._ring = _Ring(rows.clone())
        self._rows.write(chosen, rows)
        self.counter.begin(chosen)

    def begin(self, mask: torch.Tensor) -> _Observation:
        """Begins the next episode in rows of a mask, a tensor; returns the observation of all."""
        with self.simulation.scope():
            self._begin(mask)
            self.simulation.first_half()
            return self._observation()

    def _begin(self, mask: torch.Tensor) -> None:
        assert self._ring is not None
        self._rows.write(mask, self._ring.take(mask))
        self.counter.begin(mask)

    def step(self, actions: torch.Tensor) -> Outcome:
        """Applies an action in every row; a row whose action is not finite diverges.

        The action is repeated for the option's number of control steps. A row whose episode ends
        before the last of them waits unchanged; one that begins an episode does so in the last.

        Args:
          actions: (num_envs, ...) float32 on the device.
        """
        with self.simulation.scope():
            self._draw_fresh_starts()
            begun = self.counter.ended if self.options.begins_next else self._none.clone()
            finite = torch.isfinite(actions).reshape(self.num_envs, -1).all(dim=-1)
            safe = finite.reshape(-1, *(1,) * (actions.ndim - 1))
            actions = torch.where(safe, actions, torch.zeros_like(actions))
            if self.options.action_repeat == 1:
                return self._control_step(actions, finite, begun)
            return self._step_repeatedly(actions, finite, begun)

    def _step_repeatedly(
        self, actions: torch.Tensor, finite: torch.Tensor, begun: torch.Tensor
    ) -> Outcome:
        had_ended = self.counter.ended & ~begun
        total = self._control_step(actions, finite, begun, is_final=False)
        for number in range(2, self.options.action_repeat + 1):
            done = total.ending.last & ~had_ended
            waiting = done, self._rows.read()
            is_final = number == self.options.action_repeat
            outcome = self._control_step(actions, finite, begun, is_final, waiting)
            total = _with(total, outcome, done)
        return total

    def _control_step(
        self,
        actions: torch.Tensor,
        finite: torch.Tensor,
        begun: torch.Tensor,
        is_final: bool = True,
        waiting: tuple[torch.Tensor, torch.Tensor] | None = None,
    ) -> Outcome:
        """Makes a control step.

        Args:
          actions: numbers that are finite.
          finite: mask of rows whose action was finite; others diverge.
          begun: mask of rows that begin an episode with this action.
          is_final: whether this is the last control step of the action, in which they begin.
          waiting: mask of rows that do not take part, and the rows as numbers before the step.
        """
        self._set_controls(actions)
        self.simulation.advance(self.n_sub_steps)
        diverged = (~finite | self._out_of_range()) & ~begun
        overflow = self.simulation.take_overflow()
        self._rows.write_state(diverged, self._default)
        if waiting is not None:
            self._rows.write(*waiting)
        if is_final and self.options.begins_next:
            self._begin(begun)
        self.simulation.first_half()
        return self._outcome(begun, diverged, overflow)

    def _set_controls(self, actions: torch.Tensor) -> None:
        if type(self.task).before_step is base.Task.before_step:
            self.simulation.ctrl.copy_(actions)
            return
        with rows_of_a_batch(self.num_envs):
            self.task.before_step(device_array(actions), self.physics)

    def _out_of_range(self) -> torch.Tensor:
        bad = self._none
        for name in ("qpos", "qvel", "act"):
            values = self.simulation.live(name)
            if values.shape[-1]:
                bad = bad | ~(values.abs() <= _LARGEST).all(dim=-1)
        return bad

    def _outcome(
        self, begun: torch.Tensor, diverged: torch.Tensor, overflow: torch.Tensor
    ) -> Outcome:
        with rows_of_a_batch(self.num_envs):
            if not _is_inherited(self.task, "after_step"):
                self.task.after_step(self.physics)
            reward, terms = reward_and_terms(self.task, self.physics)
            ended = self.task.get_termination(self.physics)
            has_goal = terms and getattr(self.task, "GOAL", ())
            success = self._per_row(self.task.is_success(terms)) if has_goal else None
        ended = None if ended is None else self._per_row(ended)
        shown, ending = self.counter.count(begun, diverged, self._per_row(reward), ended)
        kept = {name: self._per_row(value).clone() for name, value in terms.items()}
        return Outcome(self._observation(), shown, ending, kept, success, begun, diverged, overflow)

    def _per_row(self, value: Quantity | torch.Tensor) -> torch.Tensor:
        """One number for each row, (num_envs,), of an array or a number for all rows."""
        if isinstance(value, float | int | np.generic | np.ndarray):
            value = torch.full((), value, dtype=torch.float32, device=self.device)
        return plain(value).expand(self.num_envs)

    def _observation(self) -> _Observation:
        with rows_of_a_batch(self.num_envs):
            observed = self.task.get_observation(self.physics)
        # Copies: observations may be views of the simulation.
        return {
            name: plain(values).to(torch.float32, copy=True) for name, values in observed.items()
        }

    def _draw_fresh_starts(self) -> None:
        """Replaces the oldest starts of the ring, while the device is busy with the last step."""
        assert self._ring is not None
        self._owed += self.options.starts_per_step * self.options.action_repeat
        count = self._fresh_at_once
        while self._owed >= count:
            self._owed -= count
            self._ring.replace(self.starts.draw(self._random.randint(2**32, size=count).tolist()))

    def _try_task(self) -> None:
        """Runs the task's code once, which registers the fields that it reads."""
        name = type(self.task).__name__
        try:
            with rows_of_a_batch(self.num_envs):
                self.task.get_observation(self.physics)
                _, terms = reward_and_terms(self.task, self.physics)
                self.task.get_termination(self.physics)
                if terms and getattr(self.task, "GOAL", ()):
                    self.task.is_success(terms)
        except torch.cuda.OutOfMemoryError:  # a RuntimeError that is not the code's
            raise
        except (TypeError, AttributeError, RuntimeError, ValueError, IndexError) as error:
            raise TypeError(f"task {name} cannot run on a device: {error}") from error

    def _check_shared(self, values: np.ndarray) -> None:
        """Raises ValueError if a start sets elements of a field that all rows must share."""
        official = self.environment.physics.model._official
        for part in self.starts.parts:
            if part.kind != "model":
                continue
            shared = model_fields.shared_elements(official, part.name).ravel()
            nominal = model_fields.values(official, part.name).ravel().astype(np.float32)
            if (values[:, part.columns][:, shared] != nominal[shared]).any():
                raise ValueError(
                    f"episodes set {part.name} of sites that sensors measure within, which MuJoCo "
                    "Warp shares between all rows: use the CPU, limberjack.gym.load_vector"
                )

    def state_dict(self) -> BatchState:
        """Everything that the future of the batch depends on, in copies."""
        assert self._ring is not None, "reset the batch first"
        with self.simulation.scope():
            return {
                "parts": self.parts(),
                "rows": self._rows.read(),
                "steps": self.counter.steps.clone(),
                "terminated": self.counter.terminated.clone(),
                "truncated": self.counter.truncated.clone(),
                "ring": self._ring.values.clone(),
                "head": self._ring.head.clone(),
                "tail": self._ring.tail,
                "owed": self._owed,
                "random": _saved_stream(self._random),
                "seeds": list(self.seeds),
            }

    def load_state_dict(self, state: BatchState) -> None:
        """Continues from the result of `state_dict` of a batch of the same task and size."""
        random = _stream(state["random"])  # raises before anything is loaded
        with self.simulation.scope():
            rows = state["rows"].to(self.device)
            self._rows.write(~self._none, rows)
            for name in ("steps", "terminated", "truncated"):
                getattr(self.counter, name).copy_(state[name])
            self._ring = _Ring(state["ring"].to(self.device, copy=True))
            self._ring.head.copy_(state["head"])
            self.simulation.first_half()
        self._ring.tail, self._owed = state["tail"], state["owed"]
        self._random = random
        self.seeds = list(state["seeds"])

    def parts(self) -> list[str]:
        """The task and the fields of a row of numbers, to compare with those of a saved state."""
        named = [f"{part.name} {part.columns}" for part in self.starts.parts]
        return [self.environment._ours.name or type(self.task).__name__, *named]

    def observation(self) -> _Observation:
        """The current observation, by name."""
        with self.simulation.scope():
            return self._observation()

    def read_rows(self) -> torch.Tensor:
        """The rows as numbers, (num_envs, width); see `Starts.parts`."""
        with self.simulation.scope():
            return self._rows.read()

    def close(self) -> None:
        """Frees the batch."""
        self.starts.close()


class _Ring:
    """A ring buffer of starts of episodes on a device.

        ring = _Ring(starts)                # (size, width), tensor
        rows = ring.take(mask)              # (num_envs, width): a start for each row of the mask
        ring.replace(new)                   # (n, width) NumPy, in place of the oldest

    The starts that rows take are chosen on the device, so nothing waits for it.

    Attributes:
      values: the starts, (size, width).
      head: number of the start that is used next, a tensor.
      tail: number of the start that is replaced next.
    """

    def __init__(self, values: torch.Tensor) -> None:
        """Takes over the starts; the first one is used and replaced first."""
        self.values = values
        self.head = torch.zeros((), dtype=torch.int64, device=values.device)
        self.tail = 0

    def take(self, mask: torch.Tensor) -> torch.Tensor:
        """A start for each row, (num_envs, width); rows of the mask get the next ones in order."""
        count = torch.cumsum(mask, 0)
        which = torch.remainder(self.head + count - 1, len(self.values))
        self.head.copy_(torch.remainder(self.head + count[-1], len(self.values)))
        return self.values[which]

    def replace(self, rows: np.ndarray) -> None:
        """Overwrites the oldest starts with new ones, (n, width)."""
        size = len(self.values)
        for row in np.array_split(rows, range(size - self.tail, len(rows), size)):
            fresh = torch.from_numpy(np.ascontiguousarray(row))
            if self.values.is_cuda:
                fresh = fresh.pin_memory()  # else the copy would wait for the device
            place = self.values[self.tail : self.tail + len(row)]
            place.copy_(fresh, non_blocking=True)
            self.tail = (self.tail + len(row)) % size


class _Rows:
    """The fields of a simulation that a start sets, written and read as rows of numbers.

        rows = _Rows(simulation, starts.parts)
        rows.write(mask, values)            # values (num_envs, width), where the mask is set
        everything = rows.read()            # (num_envs, width)

    Nothing waits for the device: rows are chosen by masks.
    """

    def __init__(self, simulation: WarpSimulation, parts: Sequence[Part]) -> None:
        """Looks up the fields that the parts of a start name."""
        self._targets = [(part, _target(simulation, part)) for part in parts]

    def write(self, mask: torch.Tensor, values: torch.Tensor) -> None:
        """Writes rows of numbers, (num_envs, width), into the rows of a mask, (num_envs,)."""
        for part, target in self._targets:
            _put(target, mask, values[:, part.columns])

    def write_state(self, mask: torch.Tensor, row: torch.Tensor) -> None:
        """Writes one row of numbers, (width,), into rows of a mask; the model's fields stay."""
        for part, target in self._targets:
            if part.kind in ("state", "late"):
                _put(target, mask, row[part.columns].expand(len(mask), -1))

    def read(self) -> torch.Tensor:
        """The rows as numbers, (num_envs, width) float32."""
        parts = [target.reshape(len(target), -1) for _, target in self._targets]
        return torch.cat([part.to(torch.float32) for part in parts], dim=1)


def _target(simulation: WarpSimulation, part: Part) -> torch.Tensor:
    if part.kind == "model":
        return simulation.own[part.name]
    return simulation.late.get(part.name, simulation.live(part.name))


def _put(target: torch.Tensor, mask: torch.Tensor, values: torch.Tensor) -> None:
    shaped = values.reshape(target.shape)
    given = shaped != 0 if target.dtype == torch.bool else shaped.to(target.dtype)
    torch.where(mask.reshape(-1, *(1,) * (target.ndim - 1)), given, target, out=target)


def _with(total: Outcome, outcome: Outcome, done: torch.Tensor) -> Outcome:
    """The combined outcome of control steps and of the next one, without rows that are `done`."""
    counts = ~done & ~outcome.diverged
    observation = {
        name: torch.where(
            done.reshape(-1, *(1,) * (values.ndim - 1)), total.observation[name], values
        )
        for name, values in outcome.observation.items()
    }
    terms = {
        name: total.terms[name] + torch.where(counts, values, torch.zeros_like(values))
        for name, values in outcome.terms.items()
    }
    success = outcome.success
    if success is not None and total.success is not None:
        success = torch.where(counts, success, total.success)
    return dataclasses.replace(
        outcome,
        observation=observation,
        reward=total.reward + outcome.reward,
        terms=terms,
        success=success,
        diverged=total.diverged | (outcome.diverged & ~done),
        overflow=total.overflow | (outcome.overflow & ~done),
    )


def _saved_stream(random: np.random.RandomState) -> _Stream:
    _, key, position, has_gauss, gauss = random.get_state(legacy=True)
    numbers = torch.from_numpy(np.asarray(key, np.int64))
    return {"key": numbers, "position": int(position), "gauss": (int(has_gauss), float(gauss))}


def _stream(saved: _Stream) -> np.random.RandomState:
    random = np.random.RandomState()
    try:
        key = saved["key"].cpu().numpy().astype(np.uint32)
        random.set_state(("MT19937", key, saved["position"], *saved["gauss"]))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"the random stream of the state is damaged, or of an earlier version ({error!r}); "
            "nothing was loaded"
        ) from error
    return random


def usual_starts_per_step(num_envs: int, step_limit: float) -> float:
    """New starts per step with which each start is used once if episodes have full length."""
    return num_envs / (step_limit if math.isfinite(step_limit) else _USUAL_EPISODE)


def _is_inherited(task: Task, name: str) -> bool:
    """Whether the task has the suite's own method of this name."""
    return getattr(type(task), name) is getattr(base.Task, name)


def _free_memory(device: torch.device) -> float:
    """Free memory of a device, bytes; infinite if unknown."""
    if device.type == "cuda":
        return torch.cuda.mem_get_info(device)[0]
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on this system
        return float("inf")


def _check_memory(num_envs: int, bytes_per_row: int, device: torch.device) -> None:
    """Raises MemoryError if a batch of `num_envs` rows would not fit, with the number that would.

    Args:
      num_envs: number of rows.
      bytes_per_row: memory that a row takes.
      device: a `torch.device`.
    """
    free = _free_memory(device)
    if num_envs * bytes_per_row <= _SHARE * free:
        return
    raise MemoryError(
        f"num_envs is {num_envs}, which takes {num_envs * bytes_per_row / 1e9:.1f} GB on {device}, "
        f"where {free / 1e9:.1f} GB are free: at most {int(_SHARE * free / bytes_per_row)} rows of "
        f"{bytes_per_row / 1e3:.0f} kB fit; smaller nconmax or njmax make rows smaller"
    )
