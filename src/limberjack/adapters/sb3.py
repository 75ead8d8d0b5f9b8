"""`VecEnv`: a batch of simulations as a Stable-Baselines3 `VecEnv`; needs the extra `sb3`.

    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    envs = VecMonitor(make_vec_env("humanoid", "walk", num_envs=64, seed=0))
    PPO("MlpPolicy", envs).learn(1_000_000)

It behaves as SB3's `DummyVecEnv` of equally many `limberjack.gym.Env`, bit for bit: a row whose
episode has ended returns the first observation of its next one, and the last one in
`info["terminal_observation"]`; `info["TimeLimit.truncated"]` is true if only the time limit ended
it. Actions without limits, as of lqr, are offered between -1 and 1, since SB3 needs limits. Wrap it
in `VecMonitor` to log the returns of episodes. For a single simulation this module is not needed:
SB3 takes environments of `gymnasium.make`.

No other file imports stable_baselines3.
"""

import contextlib
import inspect
import io
import itertools
import operator
import pickle
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack import gym
from limberjack.gym import arguments, attributes
from limberjack.gym.observations import Info, Observations, action_space
from limberjack.registry.sets import Tasks
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch_contract import Batch
from limberjack.rl.row_step import as_mapping
from limberjack.utils.requirements import missing_extra
from limberjack.utils.seeds import checked_seed

try:
    from stable_baselines3.common import (  # pyright: ignore[reportMissingImports]
        save_util,
        vec_env,
    )
except ImportError as error:
    raise missing_extra("sb3") from error

__all__ = ["SavedModel", "SavedPolicy", "VecEnv", "make_vec_env"]

_Indices = int | Iterable[int] | None
_Observations = np.ndarray | dict[str, np.ndarray]
_ByName = dict[str, object]


class VecEnv(vec_env.VecEnv):
    """A batch with the interface of Stable-Baselines3; see the module's docstring.

    Each row's info has `TimeLimit.truncated` and `diverged`; if the task has them, `reward_terms`
    by name and `is_success`, which SB3 logs as a rate; and after an episode `terminal_observation`.
    `reset_infos` has for each row the values drawn for its episode under `randomization`, if there
    are any.
    """

    def __init__(
        self, envs: gym.VectorEnv | Batch, seed: int | None = None, action_bound: float = 1.0
    ) -> None:
        """Takes over a batch, with float32 observations in one array, or a vector environment.

        Args:
          envs: the batch, not to be used elsewhere. A `VectorEnv` must have
            `autoreset_mode="SameStep"`.
          seed: as given to `seed`; None continues the rows' random streams.
          action_bound: largest absolute action that is offered where the task has no bounds.

        Raises:
          TypeError: `envs` is neither a batch nor a vector environment.
          ValueError: its autoreset mode is another, or later observations overwrite earlier ones.
        """
        if not isinstance(envs, gym.VectorEnv):
            envs = _made_of(envs)
        _check_vector_env(envs)
        self.vector_env = envs
        self._own: list[_ByName] = [{} for _ in range(envs.num_envs)]
        self._actions: np.ndarray | None = None
        spec = envs.batches[0].single_action_spec()
        low, high = bounds_to_try(spec, action_bound)
        actions = action_space(specs.BoundedArray(spec.shape, spec.dtype, low, high))
        super().__init__(envs.num_envs, envs.single_observation_space, actions)
        if "render_fps" in envs.metadata:
            self.metadata = {**self.metadata, "render_fps": envs.metadata["render_fps"]}
        if seed is not None:
            self.seed(seed)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds the rows: the next `reset` begins row i with the first episode of `seed + i`.

        Returns the rows' seeds. None draws a seed; NumPy's global stream is not used.
        """
        first = np.random.RandomState().randint(2**31) if seed is None else checked_seed(seed)
        self._seeds: list[int | None] = arguments.row_seeds(first, self.num_envs)
        return list(self._seeds)

    def reset(self) -> _Observations:
        """Begins an episode in every row; returns the observations.

        `set_options` takes the options of `gym.Env.reset`, such as `state`.

        Raises:
          TypeError, ValueError: an option of a row is unknown or invalid; nothing was reset.
        """
        given = [arguments.check_options(o or None, arguments.STATE) for o in self._options]
        states = [options.get(arguments.STATE) for options in given]
        options = {arguments.STATE: states} if any(state is not None for state in states) else None
        observations, info = self.vector_env.reset(seed=self._seeds, options=options)
        self._reset_seeds()
        self._reset_options()
        self._actions = None
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._note_what_was_drawn(info)
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Takes the actions, (num_envs, ...), which `step_wait` applies."""
        self._actions = np.array(actions)

    def step_wait(self) -> tuple[_Observations, np.ndarray, np.ndarray, list[_ByName]]:
        """Steps every row; returns observations, float32 rewards, dones, infos.

        Raises:
          RuntimeError: `step_async` was not called.
          ValueError, TypeError: the actions are not finite numbers, one row for each environment;
            nothing was stepped.
        """
        if self._actions is None:
            raise RuntimeError("there are no actions: call step_async() before step_wait()")
        actions, self._actions = self._actions, None
        observations, rewards, terminated, truncated, info = self.vector_env.step(actions)
        self._note_what_was_drawn(info)
        infos = _infos_of_rows(info, truncated)
        return observations, rewards.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Frees the batch; closing twice is fine."""
        self.vector_env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture of each row, (height, width, 3) uint8; without a render mode, None for each."""
        return self.vector_env.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: _Indices = None) -> list[object]:
        """An attribute of each row: of the row itself, or a value that only `set_attr` gave.

        See `gym.VectorEnv.get_attr`; the rows also have the attributes of the `VectorEnv`, such as
        `layout`, in common.

        Raises:
          AttributeError: there is no such attribute.
        """
        rows = self._rows(indices)
        if all(attr_name in self._own[row] for row in rows):
            return [self._own[row][attr_name] for row in rows]
        if attributes.has(self.vector_env, attr_name) or not hasattr(self.vector_env, attr_name):
            values = self.vector_env.get_attr(attr_name)
        else:
            values = [getattr(self.vector_env, attr_name)] * self.num_envs
        return [self._own[row].get(attr_name, values[row]) for row in rows]

    def set_attr(self, attr_name: str, value: object, indices: _Indices = None) -> None:
        """Sets an attribute of rows: a setting of the task, or one that only `get_attr` returns.

        A setting of the task of a vectorised batch is set in all rows at once; see
        `gym.VectorEnv.set_attr`. A value under a new name changes nothing in the simulations.

        Raises:
          AttributeError: the rows have that attribute in common, and it cannot be set.
          ValueError, TypeError: the value does not fit, or it would differ between rows that share
            their task; nothing was set.
        """
        rows = self._rows(indices)
        if attributes.has(self.vector_env, attr_name):
            values = list(self.vector_env.get_attr(attr_name))
            for row in rows:
                values[row] = value
            self.vector_env.set_attr(attr_name, values)
            return
        if len(rows) == self.num_envs and attributes.are_environments(self.vector_env):
            self.vector_env.set_attr(attr_name, [value] * self.num_envs)
            return
        if hasattr(self.vector_env, attr_name):
            raise AttributeError(
                f"all rows share the attribute {attr_name!r}: set it as the batch is made"
            )
        for row in rows:
            self._own[row][attr_name] = value

    def env_method(
        self,
        method_name: str,
        *method_args: Any,  # of the method
        indices: _Indices = None,
        **method_kwargs: Any,  # as above
    ) -> list[object]:
        """Calls a method of rows, such as `render`; see `gym.VectorEnv.call`.

        Raises:
          AttributeError: rows have no such method; the `VectorEnv` may have it.
        """
        rows = self._rows(indices)

        def of_row(row: int, name: str) -> object:
            return self.get_attr(name, row)[0]

        if method_name == "get_wrapper_attr":  # with the attributes that only `get_attr` returns
            return [of_row(row, *method_args, **method_kwargs) for row in rows]
        return attributes.call(self.vector_env, method_name, method_args, method_kwargs, rows)

    def env_is_wrapped(self, wrapper_class: type, indices: _Indices = None) -> list[bool]:
        """False for each row: a batch's rows have no wrappers of their own."""
        return [False for _ in self._rows(indices)]

    def _rows(self, indices: _Indices) -> list[int]:
        """The numbers of the rows, each checked."""
        rows = [operator.index(row) for row in self._get_indices(indices)]
        for row in rows:
            if not 0 <= row < self.num_envs:
                raise IndexError(f"row is {row}; expected 0 to {self.num_envs - 1}")
        return rows

    def _note_what_was_drawn(self, info: Info) -> None:
        """Keeps the model fields that were drawn for the rows whose episodes have just begun."""
        drawn = info.get("randomization", {})
        for row in np.flatnonzero(info.get("_randomization", ())):
            fields = {name: drawn[name][row].copy() for name in drawn if f"_{name}" in drawn}
            self.reset_infos[row] = {"randomization": fields}


def _made_of(batch: Batch) -> gym.VectorEnv:
    """A vector environment of a batch, as SB3 needs it."""
    if not arguments.is_batch(batch):
        raise TypeError(
            f"got {type(batch).__name__}; expected a limberjack.gym.VectorEnv or a BatchEnvironment"
        )
    return gym.VectorEnv(batch, autoreset_mode="SameStep", flat=True, dtype="float32")


def _check_vector_env(envs: gym.VectorEnv) -> None:
    """Raises unless SB3 can use it."""
    mode = envs.metadata["autoreset_mode"].value
    if mode != "SameStep":
        raise ValueError(
            f"autoreset_mode is {mode!r}; Stable-Baselines3 needs 'SameStep': pass "
            "autoreset_mode='SameStep' to the VectorEnv"
        )
    if not all(part._copies for part in envs._parts):
        raise ValueError(
            "later observations overwrite earlier ones, and Stable-Baselines3 keeps them: make the "
            "VectorEnv with copy=True"
        )


def _infos_of_rows(info: Info, truncated: np.ndarray) -> list[_ByName]:
    """The info of a step, separately for each row."""
    diverged = info["diverged"]
    infos: list[_ByName] = [
        {"TimeLimit.truncated": by_limit, "diverged": by_itself}
        for by_limit, by_itself in zip(truncated.tolist(), diverged.tolist(), strict=True)
    ]
    _add_terms(infos, info)
    if "final_obs" in info:
        for row in np.flatnonzero(info["_final_obs"]):
            infos[row]["terminal_observation"] = info["final_obs"][row]
        _add_terms(infos, info["final_info"])
    return infos


def _add_terms(infos: list[_ByName], info: Info) -> None:
    """Adds the terms of the reward, and success, to the rows that have them."""
    if "reward_terms" not in info:
        return
    rows = np.flatnonzero(info["_reward_terms"])
    terms = info["reward_terms"]
    names = [name for name in terms if f"_{name}" in terms]
    values = np.stack([terms[name][rows] for name in names], axis=-1).tolist()
    has = np.stack([terms[f"_{name}"][rows] for name in names], axis=-1).tolist()
    for row, of_row, has_of_row in zip(rows, values, has, strict=True):
        infos[row]["reward_terms"] = dict(
            itertools.compress(zip(names, of_row, strict=True), has_of_row)
        )
    if "success" in info:
        for row in np.flatnonzero(info["_success"]):
            infos[row]["is_success"] = bool(info["success"][row])


# Any: of `gym.load_vector`.
def make_vec_env(
    domain: Tasks,
    task: str | None = None,
    num_envs: int | None = None,
    *,
    seed: int | None = None,
    **kwargs: Any,
) -> VecEnv:
    """A `VecEnv` of a task, or of several.

    Args:
      domain: such as 'humanoid'; or several tasks, see `limberjack.gym.load_vector`.
      task: such as 'walk'; None with several tasks.
      num_envs: number of rows; of several tasks together, a multiple of their number.
      seed: row i begins with the first episode of `RandomState(seed + i)`; None draws a seed.
      kwargs: see `limberjack.gym.load_vector`. Observations are float32 in one array unless `flat`
        or `dtype` say otherwise.
    """
    options = {"flat": True, "dtype": "float32", "autoreset_mode": "SameStep", **kwargs}
    return VecEnv(gym.load_vector(domain, task, num_envs, **options), seed)


class SavedModel:
    """A model in files, of any algorithm with continuous actions: its policy and its spaces.

    If the observations were normalised in training, save the `VecNormalize` beside the model,
    `walk.vecnormalize.pkl` beside `walk.zip`. Both files contain pickled Python: load only files
    that you trust.

    Attributes:
      data: settings by name, as `model.save` writes them.
      policy: with its networks, on the CPU, which act without dropout and batch statistics.
      normalisation: the `VecNormalize`; None if there is none.
    """

    def __init__(self, files: Mapping[Path, bytes]) -> None:
        """Loads the model.

        Args:
          files: contents by path: of the file that `model.save` wrote, then of the normalisation
            beside it, if there is one; see `policies.saved.read_model`.

        Raises:
          ValueError: it is not a model.
        """
        (path, content), *beside = files.items()
        self.data, parameters = _saved_model(path, content)
        space = self.data["observation_space"]
        self.normalisation = _saved_normalisation(*beside[0], space) if beside else None
        kwargs = dict(self.data["policy_kwargs"])
        if self.data.get("use_sde"):
            kwargs["use_sde"] = True
        make = self.data["policy_class"]
        if "lr_schedule" in inspect.signature(make).parameters:  # not of a policy without gradients
            kwargs["lr_schedule"] = lambda _: 0.0
        with _damage_named(path, "the networks of its own class of policies"):
            self.policy = make(space, self.data["action_space"], **kwargs)
            self.policy.load_state_dict(parameters["policy"])
        self.policy.set_training_mode(False)


class SavedPolicy:
    """The policy of a saved model, acting on batches without exploration; see `SavedModel`."""

    def __init__(self, files: Mapping[Path, bytes], environment: dm_env.Environment) -> None:
        """Loads the model, on the CPU.

        Args:
          files: as for `SavedModel`.
          environment: the one to act in.

        Raises:
          ValueError: it is not a model, or one of other observations or actions.
        """
        self.files = files
        self._model = SavedModel(files)
        if hasattr(self._model.policy, "lstm_actor"):
            raise ValueError(
                f"{next(iter(files))} is recurrent: it needs a memory of the steps before, which "
                "policies here do not have"
            )
        space = self._model.data["observation_space"]
        is_dict = hasattr(space, "spaces")
        dtype = np.float32 if is_dict else space.dtype
        spec = cast(Mapping[str, specs.Array], as_mapping(environment.observation_spec()))
        self._observations = Observations(spec, not is_dict, dtype)
        _check_space("observations", space, self._observations.space)
        _check_space("actions", self._model.data["action_space"], environment.action_spec())

    def act_batch(self, observations: Mapping[str, np.ndarray]) -> np.ndarray:
        """The actions, (N, ...), at observations of (N, ...) by name."""
        count = len(next(iter(observations.values())))
        seen = self._observations.of_batch(observations, self._observations.buffer(count))
        if self._model.normalisation is not None:
            seen = self._model.normalisation.normalize_obs(seen)
        actions, _ = self._model.policy.predict(seen, deterministic=True)
        return actions


# Any: SB3's own classes, spaces and settings.
def _saved_model(path: Path, content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """The settings and the networks' parameters in a file of `model.save`."""
    file = io.BytesIO(content)
    if not zipfile.is_zipfile(file):
        raise ValueError(
            f"{path} is not a model of Stable-Baselines3; expected a file that model.save wrote"
        )
    file.seek(0)
    with _damage_named(path, "a file that model.save wrote"):
        data, parameters, _ = save_util.load_from_zip_file(file, device="cpu")
    needed = {"action_space", "observation_space", "policy_class", "policy_kwargs"}
    if not (data and parameters and needed <= data.keys() and "policy" in parameters):
        raise ValueError(
            f"{path} holds no networks of PyTorch's: it is damaged, or a model of SBX; expected a "
            "file that model.save of Stable-Baselines3 wrote"
        )
    return data, parameters


# Any: a class of SB3.
def _saved_normalisation(path: Path, content: bytes, space: object) -> Any:
    """The normalisation that `VecNormalize.save` wrote."""
    with _damage_named(path, "a file that VecNormalize.save wrote"):
        saved = pickle.loads(content)
        _, of_saved = saved.normalize_obs, saved.observation_space
    if _shape(of_saved) != _shape(space):
        raise ValueError(
            f"{path} normalises observations of shape {_shape(of_saved)}; the model's have "
            f"{_shape(space)}"
        )
    return saved


@contextlib.contextmanager
def _damage_named(path: Path, expected: str) -> Iterator[None]:
    """Turns all errors that pickle, zipfile and torch raise for a damaged file into one."""
    try:
        yield
    except Exception as error:
        raise ValueError(f"{path} cannot be read ({error}); expected {expected}") from error


def _check_space(what: str, of_model: object, here: object) -> None:
    """Raises ValueError unless the model was trained with the shapes of the task."""
    found, expected = _shape(of_model), _shape(here)
    if found != expected:
        raise ValueError(f"the model's {what} have shape {found}; the task's have {expected}")


def _shape(space: object) -> object:
    """The shape of a space or spec, or the shapes of a dictionary of spaces, by name."""
    spaces = getattr(space, "spaces", None)
    if spaces is None:
        return getattr(space, "shape", None)
    return {name: one.shape for name, one in spaces.items()}
