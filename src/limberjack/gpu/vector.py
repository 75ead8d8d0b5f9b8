"""`VectorEnv`: a batch on a device as a `gymnasium.vector.VectorEnv` of torch tensors.

    envs = load_vector("humanoid", "walk", num_envs=4096, device="cuda:0", seed=0)
    observations, info = envs.reset()
    observations, rewards, terminated, truncated, info = envs.step(actions)    # (4096, 21) float32

Observations, rewards, masks and the info are tensors on the device, which later steps do not
change. The info has the keys of `limberjack.gym.VectorEnv`. Every entry is present in every step,
and its mask says for which rows it is valid: checking whether there are any would wait for the
device. In same-step mode, `final_obs` therefore has a row for every environment, and `final_info`
is one mapping. `overflow` marks rows whose contacts or constraints had no room.

docs/gpu.md describes what equals the CPU, and how closely.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import SupportsIndex

import mujoco
import numpy as np
from gymnasium import error
from gymnasium import vector as gymnasium_vector
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from limberjack import suite
from limberjack.gpu import model_fields
from limberjack.gpu.backend import device_of, torch
from limberjack.gpu.batch import (
    BatchState,
    DeviceBatch,
    Options,
    Outcome,
    usual_starts_per_step,
)
from limberjack.gpu.sizes import Sizes, measured
from limberjack.gym import arguments
from limberjack.gym.observations import Info, Observations, action_space, specs_of_one_row
from limberjack.mujoco.simulation import STATE, without_calls
from limberjack.rl.action_specs import bounded_spec
from limberjack.rl.batches import vectorisable
from limberjack.rl.control import Environment
from limberjack.rl.guards import as_rows, at_least_one
from limberjack.rl.randomize import stream_beside
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.keywords import with_keywords
from limberjack.utils.log import log

__all__ = ["VectorEnv", "load_vector"]

_NO_PICTURES = (
    "no pictures are drawn on a device: observe them with limberjack.gym.load_vector, or take rows "
    "to the CPU with to_cpu(rows) and restore them into a batch of suite.load_batch, which renders"
)

_Observation = torch.Tensor | dict[str, torch.Tensor]
# Observation, reward, terminated, truncated, info.
_Step = tuple[_Observation, torch.Tensor, torch.Tensor, torch.Tensor, Info]


class VectorEnv(gymnasium_vector.VectorEnv[_Observation, torch.Tensor, torch.Tensor]):
    """A batch on a device; see the module's docstring.

    `device` is a `torch.device`; `layout` gives the position of each observation in the flat array,
    as `limberjack.gym.Part`s of name, slice and shape; `action_shape` is that of all rows' actions;
    `batch` is the `DeviceBatch`.
    """

    closed = True  # until it is made

    def __init__(
        self,
        batch: DeviceBatch,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        flat: bool = True,
    ) -> None:
        """Take over a batch.

        Args:
          batch: not to be used elsewhere. Its option `begins_next` must fit the mode.
          autoreset_mode: the time at which a row whose episode has ended begins the next one.
          flat: observations in one array, (num_envs, size), instead of a dict of arrays.

        Raises:
          ValueError: the mode is unknown, or does not fit the batch.
        """
        self._mode = arguments.autoreset_mode(autoreset_mode)
        if batch.options.begins_next is not (self._mode is AutoresetMode.NEXT_STEP):
            raise ValueError(
                f"autoreset_mode is {self._mode.value!r} and the batch has begins_next="
                f"{batch.options.begins_next}; expected True for 'NextStep' alone"
            )
        self.batch, self.device, self.num_envs = batch, batch.device, batch.num_envs
        on_cpu = batch.starts.batch
        of_one = specs_of_one_row(on_cpu.observation_spec())
        form = Observations(of_one, flat, "float32")
        self._is_flat, self.layout = flat, form.layout
        self.single_action_space = action_space(bounded_spec(batch.task, on_cpu.single))
        self.single_observation_space = form.space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(form.space, self.num_envs)
        shape = on_cpu.action_spec().shape[1:]
        self.action_shape: tuple[int, ...] = (self.num_envs, *shape)
        self._all = torch.ones(self.num_envs, dtype=torch.bool, device=self.device)
        self._overflows = torch.zeros((), dtype=torch.int64, device=self.device)
        self._was_reset = False
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.metadata["render_fps"] = round(1 / self.dt)
        self.closed = False

    @property
    def dt(self) -> float:
        """Time between two actions, seconds."""
        return self.batch.environment.control_timestep() * self.batch.options.action_repeat

    @property
    def step_limit(self) -> float:
        """Control steps of an episode; infinite without a time limit."""
        return self.batch.counter.step_limit

    @property
    def overflows(self) -> int:
        """Number of steps of rows, since creation, whose contacts or constraints had no room.

        Reading it waits for the device. Above 0, pass a larger `nconmax` or `njmax`.
        """
        return int(self._overflows.cpu())

    # Gymnasium's own vector environments take sequences of seeds as well.
    def reset(  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
        *,
        seed: SupportsIndex | Sequence[SupportsIndex | None] | None = None,
        options: Mapping[str, object] | None = None,
    ) -> tuple[_Observation, Info]:
        """Begin an episode in every row, or in some; return the observations and info.

        Args:
          seed: row i begins the first episode of `RandomState(seed + i)`; a sequence has a seed for
            each row. A row with None takes one of the starts that were drawn in advance, or in the
            first reset begins the first episode of the seed that the environment was made with.
          options: `{"reset_mask": mask}`, (num_envs,) booleans in an array or a tensor, resets some
            rows only. A tensor on the device without seeds does not wait for the device.

        Raises:
          ValueError, TypeError: a seed or the mask is invalid; nothing was reset.
        """
        self._check_open()
        on_device = self._mask_on_device(options)
        if on_device is not None and seed is None and self._was_reset:
            return self._in_form(self.batch.begin(on_device)), self._drawn(on_device)
        mask = arguments.reset_mask(_on_cpu(options), self.num_envs)
        seeds = arguments.row_seeds(seed, self.num_envs)
        if isinstance(seed, int | np.integer):
            super().reset(seed=seeds[0])
            if mask is None:
                self.batch.seed(seeds[0])
        observation = self.batch.reset(mask, seeds)
        of_all = mask is None or not self._was_reset  # the first call begins all rows
        begun = self._all if of_all else torch.from_numpy(mask).to(self.device)
        self._was_reset = True
        return self._in_form(observation), self._drawn(begun)

    def step(self, actions: torch.Tensor) -> _Step:
        """Step every row; return observations, rewards, terminated, truncated and info.

        With an `action_repeat` of k each row makes k control steps, or fewer if its episode ends.
        Rewards and their terms are summed; everything else belongs to the last control step.
        A row whose action is not finite diverges: its episode ends. With `autoreset_mode` DISABLED
        a row whose episode has ended reports that again, with reward 0, until it is reset.

        Args:
          actions: (num_envs, ...) float32, a tensor on the device.

        Raises:
          ResetNeeded: `reset` was not called.
          ValueError, TypeError: the actions have another shape, dtype or device; nothing was
            stepped.
        """
        self._check_open()
        if not self._was_reset:
            raise error.ResetNeeded("no episode is running: call reset() before step()")
        self._check_actions(actions)
        outcome = self.batch.step(actions.detach())
        self._overflows += outcome.overflow.sum()
        observation = self._in_form(outcome.observation)
        ending = outcome.ending
        if self._mode is AutoresetMode.SAME_STEP:
            info = self._terms(outcome, ~ending.last)
            info |= {"final_obs": observation, "_final_obs": ending.last}
            info |= {"final_info": self._terms(outcome, ending.last), "_final_info": ending.last}
            observation = self._in_form(self.batch.begin(ending.last))
            info |= self._drawn(ending.last)
        else:
            info = self._terms(outcome, ~outcome.begun) | self._drawn(outcome.begun)
        for name in ("diverged", "overflow"):
            info |= {name: getattr(outcome, name), f"_{name}": self._all.clone()}
        return observation, outcome.reward, ending.terminated, ending.truncated, info

    def to_cpu(self, rows: Sequence[int] | np.ndarray) -> Snapshot:
        """The rows as a `Snapshot`, which batches and environments on the CPU restore.

        A state is rounded to float32 on the device, so the CPU continues from it closely, not bit
        for bit. The next episode of a restored row is the first one of its seed.

        Args:
          rows: sorted row numbers, or a mask.
        """
        self._check_begun()
        return _snapshot_of(self.batch, as_rows(rows, self.num_envs))

    def state_dict(self) -> BatchState:
        """Everything that the future of the batch depends on, for `torch.save`."""
        self._check_begun()
        return self.batch.state_dict()

    def load_state_dict(self, state: BatchState) -> _Observation:
        """Continue from the result of `state_dict`; return the observations.

        Raises:
          ValueError: it belongs to another task or number of rows; nothing was changed.
        """
        self._check_open()
        _check_state(self.batch, state)
        self.batch.load_state_dict(state)
        self._was_reset = True
        return self._in_form(self.batch.observation())

    def render(self) -> None:
        """Refuses: pictures are drawn on the CPU."""
        raise RuntimeError(_NO_PICTURES)

    def close_extras(self, **kwargs: object) -> None:
        """Free the batch; `close` calls it, once. A warning is logged if there were overflows."""
        if self.overflows:
            sizes = self.batch.options.sizes
            log.warning(
                "contacts or constraints had no room in %s steps of rows: pass more than nconmax="
                "%s, njmax=%s",
                *(self.overflows, sizes.nconmax, sizes.njmax),
            )
        self.batch.close()

    def __repr__(self) -> str:
        name = self.batch.environment._ours.name or type(self.batch.task).__name__
        return f"<VectorEnv {name}, {self.num_envs} rows, {self.device}>"

    def _in_form(self, observation: Mapping[str, torch.Tensor]) -> _Observation:
        if not self._is_flat:
            return {part.name: observation[part.name] for part in self.layout}
        parts = [observation[part.name].reshape(self.num_envs, -1) for part in self.layout]
        return torch.cat(parts, dim=1)

    def _terms(self, outcome: Outcome, rows: torch.Tensor) -> Info:
        """The terms of the reward, and whether the goal is reached, in some rows."""
        if not outcome.terms:
            return {}
        rows = rows & ~outcome.diverged
        shown = {name: torch.where(rows, each, 0.0) for name, each in outcome.terms.items()}
        info: Info = {"reward_terms": _with_masks(shown, rows), "_reward_terms": rows}
        if outcome.success is not None:
            info |= {"success": outcome.success & rows, "_success": rows}
        return info

    def _drawn(self, begun: torch.Tensor) -> Info:
        """The model's fields that were drawn for the episodes that rows have begun."""
        randomizer = self.batch.environment._ours.randomizer
        if randomizer is None:
            return {}
        own = self.batch.simulation.own
        values = _with_masks({name: own[name].clone() for name in randomizer.fields}, begun)
        return {"randomization": values, "_randomization": begun.clone()}

    def _check_actions(self, actions: torch.Tensor) -> None:
        if not isinstance(actions, torch.Tensor):
            raise TypeError(
                f"actions are a {type(actions).__name__}; expected a torch.Tensor on {self.device}"
                ": torch.as_tensor(actions, dtype=torch.float32, device=envs.device)"
            )
        if actions.device != self.device:
            raise ValueError(
                f"actions are on {actions.device}; expected {self.device}: use actions.to(envs."
                "device); nothing was stepped"
            )
        if actions.dtype != torch.float32:
            raise TypeError(
                f"actions have dtype {actions.dtype}; expected torch.float32: use actions.float(); "
                "nothing was stepped"
            )
        if tuple(actions.shape) != self.action_shape:
            raise ValueError(
                f"actions have shape {tuple(actions.shape)}; expected {self.action_shape}; "
                "nothing was stepped"
            )

    def _mask_on_device(self, options: Mapping[str, object] | None) -> torch.Tensor | None:
        mask = _tensor_mask(options)
        if mask is None or mask.device != self.device:
            return None
        fits = mask.dtype == torch.bool and tuple(mask.shape) == (self.num_envs,)
        return mask.clone() if fits else None

    def _check_open(self) -> None:
        if self.closed:
            raise error.ClosedEnvironmentError("this environment is closed: make a new one")

    def _check_begun(self) -> None:
        self._check_open()
        if not self._was_reset:
            raise error.ResetNeeded("no episode is running: call reset() first")


def _tensor_mask(options: Mapping[str, object] | None) -> torch.Tensor | None:
    """The mask in the options of a reset if it is a tensor, else None."""
    mask = options.get("reset_mask") if isinstance(options, Mapping) else None
    return mask if isinstance(mask, torch.Tensor) else None


def _on_cpu(options: Mapping[str, object] | None) -> Mapping[str, object] | None:
    """The options with the mask as a NumPy array."""
    mask = _tensor_mask(options)
    if mask is None:
        return options
    return {**(options or {}), "reset_mask": mask.cpu().numpy()}


def _snapshot_of(batch: DeviceBatch, rows: np.ndarray) -> Snapshot:
    """The rows as a snapshot that batches and single environments of the same task restore.

    Args:
      batch: the batch, which has been reset.
      rows: sorted row numbers.
    """
    fields = batch.starts.of_rows(batch.read_rows().cpu().numpy()[rows])
    like = batch.starts.batch.snapshot([0])
    official = batch.environment.physics.model._official
    states = _states(official, fields, len(rows))
    readings = fields.get("sensordata", np.zeros((len(rows), official.nsensordata)))
    physics = without_calls({"state": states, "sensordata": readings})
    for name in like.physics.keys() - physics.keys():
        nominal = model_fields.values(official, name)
        is_nominal = fields[name] == nominal.astype(np.float32)  # else kept in double precision
        physics[name] = np.where(is_nominal, nominal, fields[name]).astype(nominal.dtype)
    streams = []
    for row in rows.tolist():
        own = np.random.RandomState(batch.seeds[row])
        pair = (own.get_state(), stream_beside(own).get_state())
        streams.append(pair[: len(like.streams[0])])
    return dataclasses.replace(
        like,
        physics={name: physics[name] for name in like.physics},
        step_count=batch.counter.steps.cpu().numpy()[rows].astype(int),
        begins=batch.counter.ended.cpu().numpy()[rows],
        streams=streams,
        registration=batch.environment._ours.registration,
        name=batch.environment._ours.name,
    )


def _check_state(batch: DeviceBatch, state: BatchState) -> None:
    """Raises ValueError unless a batch can continue from the result of its `state_dict`."""
    if not isinstance(state, Mapping):
        raise ValueError(f"expected the result of state_dict; got {state!r}; nothing was loaded")
    missing = BatchState.__required_keys__ - state.keys()
    if missing:
        raise ValueError(
            f"expected the result of state_dict; it lacks {sorted(missing)}; nothing was loaded"
        )
    rows, width = batch.num_envs, batch.starts.width
    shapes = {"rows": (rows, width), "ring": (rows, width)}
    shapes |= dict.fromkeys(("steps", "terminated", "truncated"), (rows,))
    for name, expected in shapes.items():
        shape = tuple(getattr(state[name], "shape", ()))
        if shape != expected:
            raise ValueError(
                f"the state has {name} of shape {shape}; expected {expected}, of the same task "
                "with the same number of environments; nothing was loaded"
            )
    if state["parts"] != batch.parts():
        raise ValueError(
            f"the state is of {state['parts'][:1]}; expected {batch.parts()[:1]}, of the same task "
            "with the same fields for each row; nothing was loaded"
        )


def _states(official: mujoco.MjModel, fields: Mapping[str, np.ndarray], count: int) -> np.ndarray:
    """Integration states, (n, nstate), of fields by name."""
    data = mujoco.MjData(official)
    states = np.empty((count, mujoco.mj_stateSize(official, STATE)))
    for row, state in enumerate(states):
        for name, values in fields.items():
            live = getattr(data, name, None)
            if name == "time":
                data.time = float(values[row])
            elif isinstance(live, np.ndarray):
                live[...] = values[row]
        mujoco.mj_getState(official, data, state, STATE)
    return states


def _with_masks(values: Mapping[str, torch.Tensor], rows: torch.Tensor) -> dict[str, torch.Tensor]:
    """The values and, as in Gymnasium, the mask of rows that each is valid for, as '_name'."""
    return {**values, **{f"_{name}": rows.clone() for name in values}}


@arguments.suggests_names
def load_vector(
    domain: str,
    task: str,
    num_envs: int,
    *,
    device: object = "cuda:0",
    seed: int | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    flat: bool = True,
    time_limit: float | None = None,
    task_kwargs: Mapping[str, object] | None = None,
    environment_kwargs: Mapping[str, object] | None = None,
    randomize: Mapping[str, object] | None = None,
    nconmax: int | None = None,
    njmax: int | None = None,
    starts_per_step: float | None = None,
    graphs: bool | None = None,
    action_repeat: int | None = None,
    pixels: object = None,
    render_mode: object = None,
) -> VectorEnv:
    """A vector environment of a task on a device.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      num_envs: number of rows.
      device: 'cuda:0' and so on, or 'cpu' to try things out; slow.
      seed: row i's first episode is that of `RandomState(seed + i)`; None for an arbitrary seed.
      autoreset_mode: the time at which a row whose episode has ended begins the next one.
      flat: observations in one array instead of a dict of arrays.
      time_limit: length of an episode, seconds; None for the task's own.
      task_kwargs: see `suite.load_batch`.
      environment_kwargs: see `suite.load_batch`.
      randomize: fields of the model to draw for each episode; see `limberjack.rl.randomize`.
      nconmax: contacts for each row, on average; None for twice the peak of some episodes.
      njmax: rows of constraints for each row, at most; likewise.
      starts_per_step: new starts of episodes to draw in each control step; None for as many as
        episodes of full length use, 0 to use those of the first episodes again and again.
      graphs: replay recorded sequences of kernels; None for True on CUDA.
      action_repeat: control steps per action, whose rewards are summed; None for the environment's
        own, mostly 1. See `suite.load_batch`.
      pixels, render_mode: refused; pictures are drawn on the CPU.

    Raises:
      ImportError: PyTorch, Warp or MuJoCo Warp is not installed.
      ValueError: the device cannot be used, the task is not for a device, as one that remembers
        something, or a number is out of range.
      TypeError: an argument is unknown; the message suggests the nearest name.
      MemoryError: this many rows do not fit into the device's memory.
    """
    of_environment = with_keywords("environment_kwargs", environment_kwargs, randomize=randomize)
    for name, value in (("pixels", pixels), ("render_mode", render_mode)):
        given = of_environment.get(name) if value is None else value
        if given is not None:
            raise ValueError(f"{name} is {given!r}: {_NO_PICTURES}")
    num_envs = at_least_one("num_envs", num_envs)
    if action_repeat is not None:
        at_least_one("action_repeat", action_repeat)
    mode = arguments.autoreset_mode(autoreset_mode)
    place = device_of(device)
    of_task = with_keywords("task_kwargs", task_kwargs, time_limit=time_limit)
    environment = vectorisable(suite.load(domain, task, of_task, of_environment))
    if not environment.physics.legacy_step:
        raise ValueError("legacy_step is False: use the CPU, limberjack.gym.load_vector")
    world = Environment.world.of(environment)
    if world is not None:
        options = " and ".join(world)
        raise ValueError(f"{options} are not for devices: use the CPU, limberjack.gym.load_vector")
    if starts_per_step is None:
        starts_per_step = usual_starts_per_step(num_envs, environment._step_limit)
    if not 0 <= starts_per_step < math.inf:
        raise ValueError(
            f"starts_per_step is {starts_per_step}; expected a finite number, at least 0"
        )
    options = Options(
        _sizes(suite.load(domain, task, {**of_task, "random": 0}, of_environment), nconmax, njmax),
        float(starts_per_step),
        place.type == "cuda" if graphs is None else graphs,
        mode is AutoresetMode.NEXT_STEP,
        environment._ours.action_repeat if action_repeat is None else action_repeat,
    )
    return VectorEnv(DeviceBatch(environment, num_envs, place, seed, options), mode, flat)


def _sizes(environment: Environment, nconmax: int | None, njmax: int | None) -> Sizes:
    """The given sizes; for None what the environment needs."""
    needed = measured(environment)
    return Sizes(
        needed.nconmax if nconmax is None else at_least_one("nconmax", nconmax),
        needed.njmax if njmax is None else at_least_one("njmax", njmax),
    )
