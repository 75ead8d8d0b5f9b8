"""Snapshots and copies: rejected ones, and their quantities."""

import collections
import copy
import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.batches import batch_of
from limberjack.rl.randomize import scale
from limberjack.rl.snapshot import Snapshot
from limberjack.suite import base
from tests.laws.episodes import rotated

_TASK = ("stacker", "stack_2")


def _pickled(env: Any) -> Any:
    return pickle.loads(pickle.dumps(env))


_COPIES = pytest.mark.parametrize("copied", [copy.deepcopy, _pickled], ids=["copy", "pickle"])
# Statistics of the solver, not quantities: MuJoCo does not pickle them.
_STATISTICS = ("solver_niter", "solver_nnz")


def _single(task: tuple[str, str] = _TASK, **kwargs: Any) -> Any:
    env = suite.load(*task, {"random": 1}, kwargs)
    env.reset()
    for action in _actions(env, 7):
        env.step(action)
    return env


def _batch(num_envs: int = 3, **kwargs: Any) -> BatchEnvironment:
    batch = suite.load_batch(*_TASK, num_envs, 1, 0, **kwargs)
    batch.reset()
    for action in _actions(batch, 3):
        batch.step(action)
    return batch


def _actions(env: Any, steps: int) -> np.ndarray:
    return np.random.RandomState(2).uniform(-1, 1, (steps, *env.action_spec().shape))


def _future(env: Any) -> list[Any]:
    return [
        [value.tobytes() for value in env.step(action).observation.values()]
        for action in _actions(env, 5)
    ]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e11])
@pytest.mark.parametrize("field", ["qpos", "qvel"])
def test_a_state_that_has_diverged_is_not_restored_as_another_one(field: str, value: float) -> None:
    env, other = _single(), _single()
    getattr(env.physics.data, field)[0] = value
    snapshot = env.snapshot()
    with pytest.raises(control.PhysicsError, match=rf"data\.{field} has diverged"):
        other.restore(snapshot)
    assert other.step(np.zeros(5)).first()


@_COPIES
@pytest.mark.parametrize("field", ["qpos", "qvel"])
def test_a_state_that_has_diverged_is_not_copied_as_another_one(field: str, copied: Any) -> None:
    env = _single()
    getattr(env.physics.data, field)[0] = np.nan
    for one in (env, env.physics):
        with pytest.raises(control.PhysicsError, match=rf"data\.{field} has diverged"):
            copied(one)


def _copy_by_restoring(batch: Any) -> Any:
    other = _batch()
    other.restore(batch.snapshot())
    return other


def _copy_by_pickling(batch: Any) -> Any:
    return pickle.loads(pickle.dumps(batch))


@pytest.mark.parametrize("copied", [_copy_by_restoring, _copy_by_pickling, copy.deepcopy])
@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_a_row_whose_state_is_invalid_diverges_in_a_copy_as_well(copied: Any, value: float) -> None:
    batch = _batch()
    batch.physics.data.qvel[1, 0] = value
    other = copied(batch)
    for _ in range(3):
        expected, found = (one.step(np.zeros((3, 5))) for one in (batch, other))
        np.testing.assert_array_equal(found.step_type, expected.step_type)
        np.testing.assert_array_equal(found.discount, expected.discount)
        np.testing.assert_array_equal(found.reward, expected.reward)
        assert other.diverged.tolist() == batch.diverged.tolist()
        for name, values in expected.observation.items():
            np.testing.assert_array_equal(found.observation[name], values)


def test_copies_know_which_rows_have_just_diverged() -> None:
    batch = _batch()
    batch.physics.data.qvel[1, 0] = np.nan
    batch.step(np.zeros((3, 5)))
    assert copy.deepcopy(batch).diverged.tolist() == [False, True, False]


def _set_gravity(env: Any) -> None:
    env.physics.model.opt.gravity[2] = -1.0


def _set_masses(env: Any) -> None:
    env.physics.model.body_mass[3] *= 2


def _set_timestep(env: Any) -> None:
    env.physics.model.opt.timestep = 0.002


@pytest.mark.parametrize(
    ("edit", "field"),
    [
        (_set_gravity, r"opt\.gravity"),
        (_set_masses, "body_mass"),
        (_set_timestep, r"opt\.timestep"),
    ],
)
def test_a_snapshot_of_a_model_with_other_numbers_is_refused(edit: Any, field: str) -> None:
    edited, other, batch = _single(), _single(), _batch()
    edit(edited)
    snapshot = edited.snapshot()
    twin = copy.deepcopy(other)
    for refuse in (
        lambda: other.restore(snapshot),
        lambda: batch.restore(snapshot, [1]),
        lambda: edited.restore(twin.snapshot()),
    ):
        with pytest.raises(ValueError, match=rf"a model with other values of {field}[,;]"):
            refuse()
    edited.restore(snapshot)
    assert _future(other) == _future(twin)


def test_colours_do_not_matter_and_neither_do_fields_of_the_episode() -> None:
    env = suite.load(*_TASK, {"random": 1}, visualize_reward=True)
    env.reset()
    env.step(np.ones(5))
    other = _single()
    other.restore(env.snapshot())
    assert _future(other) == _future(env)


def test_randomised_fields_do_not_matter() -> None:
    randomize = {"body_mass": scale(0.5, 2), "opt.gravity": scale(0.9, 1.1)}
    env, other = _single(randomize=randomize), _single(randomize=randomize)
    other.reset()
    other.restore(env.snapshot())
    assert _future(other) == _future(env)


@pytest.mark.parametrize(("version", "is_accepted"), [("4.0.99", True), ("4.99.0", False)])
def test_patch_versions_of_mujoco_interchange(version: str, is_accepted: bool) -> None:
    env = _single()
    snapshot = env.snapshot()
    assert snapshot.origin["MuJoCo"]
    snapshot.origin["MuJoCo"] = version
    if is_accepted:
        env.restore(snapshot)
        return
    with pytest.raises(ValueError, match=rf"the snapshot is of MuJoCo '{version}'; expected"):
        env.restore(snapshot)


def _with_physics(name: str, change: Callable[[np.ndarray], Any]) -> Callable[[Any], Any]:
    def damaged(snapshot: Any) -> Any:
        physics = {**snapshot.physics, name: change(snapshot.physics[name])}
        return dataclasses.replace(snapshot, physics=physics)

    return damaged


_DAMAGE = {
    "a short state": _with_physics("state", lambda a: a[:, 1:]),
    "single precision": _with_physics("state", lambda a: a.astype("f4")),
    "no array": _with_physics("sensordata", lambda a: a.tolist()),
    "a field of another shape": _with_physics("body_pos", lambda a: a[..., :2]),
    "no state": lambda s: dataclasses.replace(
        s, physics={n: v for n, v in s.physics.items() if n != "state"}
    ),
    "an unknown field": lambda s: dataclasses.replace(
        s, physics={**s.physics, "geom_pos": np.zeros((len(s), 1))}
    ),
    "too many counts": lambda s: dataclasses.replace(s, step_count=np.zeros(9, int)),
    "counts that are no numbers": lambda s: dataclasses.replace(s, step_count=s.begins),
    "flags that are numbers": lambda s: dataclasses.replace(s, begins=s.step_count),
    "no streams": lambda s: dataclasses.replace(s, streams=[()] * len(s)),
    "streams of something else": lambda s: dataclasses.replace(s, streams=[("PCG", 1)] * len(s)),
    "a stream that is none": lambda s: dataclasses.replace(s, streams=[("noise",)] * len(s)),
    "a stream before its key": lambda s: _with_position(s, -1),
    "a stream behind its key": lambda s: _with_position(s, 625),
    "counts below 0": lambda s: dataclasses.replace(s, step_count=s.step_count - 99),
    "no origin": lambda s: dataclasses.replace(s, origin=None),
    "no physics": lambda s: dataclasses.replace(s, physics=[1]),
    "no list of streams": lambda s: dataclasses.replace(s, streams=None),
    "frames of something else": lambda s: dataclasses.replace(s, frames="none"),
}


def _with_position(snapshot: Any, position: int) -> Any:
    streams = [((*own[:2], position, *own[3:]), *rest) for own, *rest in snapshot.streams]
    return dataclasses.replace(snapshot, streams=streams)


@pytest.mark.parametrize("make", [_single, _batch])
@pytest.mark.parametrize("damage", _DAMAGE.values(), ids=_DAMAGE)
def test_a_damaged_snapshot_is_refused_before_anything_moves(damage: Any, make: Any) -> None:
    env, twin = make(), make()
    with pytest.raises(ValueError, match="nothing was restored"):
        env.restore(damage(env.snapshot()))
    assert _future(env) == _future(twin)


def _quantities(env: Any, leave_out: tuple[str, ...] = ()) -> dict[str, bytes]:
    """Every array of the data, and the task's observation."""
    data = env.physics.data.ptr
    names = [name for name in dir(data) if not name.startswith("_") and name not in leave_out]
    shown = {n: getattr(data, n) for n in names if isinstance(getattr(data, n), np.ndarray)}
    shown |= env.task.get_observation(env.physics)
    return {name: np.asarray(value).tobytes() for name, value in shown.items()}


@pytest.mark.parametrize(
    ("task", "legacy_step", "copied"), rotated([True, False], [copy.deepcopy, _pickled])
)
def test_a_copied_environment_has_the_same_quantities(
    task: tuple[str, str], legacy_step: bool, copied: Any
) -> None:
    env = _single(task, legacy_step=legacy_step)
    other = copied(env)
    assert _quantities(other, _STATISTICS) == _quantities(env, _STATISTICS)
    assert _future(other) == _future(env)


@pytest.mark.parametrize("task", [("humanoid", "walk"), _TASK], ids="-".join)
def test_a_restored_environment_has_the_same_quantities_after_whole_steps(
    task: tuple[str, str],
) -> None:
    env, other = (_single(task, legacy_step=False) for _ in range(2))
    other.reset()
    other.restore(env.snapshot())
    shown, expected = (each.task.get_observation(each.physics) for each in (other, env))
    for name, value in expected.items():
        np.testing.assert_array_equal(shown[name], value, name)


@pytest.mark.parametrize("task", [("humanoid", "walk"), _TASK], ids="-".join)
def test_a_restored_environment_has_the_same_accelerations_and_forces(
    task: tuple[str, str],
) -> None:
    env, other = (_single(task) for _ in range(2))
    other.reset()
    other.restore(env.snapshot())
    for name in ("qacc", "qfrc_constraint", "sensordata", "cfrc_ext", "actuator_force"):
        shown, expected = (getattr(each.physics.data, name) for each in (other, env))
        np.testing.assert_array_equal(shown, expected, name)


_ORIGIN = {"task": "Humanoid", "fields": ("body_pos",), "nq": 28}


def _made(size: int = 2, **origin: Any) -> Snapshot:
    return Snapshot(
        {**_ORIGIN, **origin},
        {"state": np.zeros((size, 3))},
        np.zeros(size, int),
        np.zeros(size, bool),
        [()] * size,
    )


def test_its_length_is_the_number_of_environments() -> None:
    assert [len(_made(size)) for size in (1, 5)] == [1, 5]


def test_one_of_the_same_origin_and_size_is_accepted() -> None:
    _made().check(_ORIGIN, size=2)


@pytest.mark.parametrize(
    ("name", "value"), [("task", "Stack"), ("fields", ("body_quat",)), ("nq", 27)]
)
def test_one_of_another_origin_is_refused_by_name_with_both_values(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name) as caught:
        _made(**{name: value}).check(_ORIGIN, size=2)
    assert repr(value) in str(caught.value)
    assert repr(_ORIGIN[name]) in str(caught.value)


def test_one_that_lacks_a_part_of_the_origin_is_refused() -> None:
    with pytest.raises(ValueError, match="camera"):
        _made().check({**_ORIGIN, "camera": "side"}, size=2)


@pytest.mark.parametrize("size", [1, 3])
def test_one_of_another_size_is_refused_with_both_sizes(size: int) -> None:
    with pytest.raises(ValueError, match=f"2 environments; expected {size}"):
        _made().check(_ORIGIN, size)


def test_it_is_the_same_after_pickling() -> None:
    snapshot = _made()
    again = pickle.loads(pickle.dumps(snapshot))
    again.check(_ORIGIN, size=2)
    np.testing.assert_array_equal(again.physics["state"], snapshot.physics["state"])


@pytest.mark.parametrize("make", [_single, _batch])
@pytest.mark.parametrize("given", [None, {"state": 1}, "snapshot.pkl", b"..."])
def test_only_a_snapshot_can_be_restored(given: Any, make: Any) -> None:
    env, twin = make(), make()
    with pytest.raises(TypeError, match=r"snapshot is .*; expected a Snapshot"):
        env.restore(given)
    assert _future(env) == _future(twin)


@pytest.mark.parametrize("make", [_single, _batch])
@pytest.mark.parametrize("steps", [10**12, -(10**12)])
def test_a_damaged_number_of_steps_is_not_repeated(steps: int, make: Any) -> None:
    env, twin = make(), make()
    env.restore(_with_physics("call", lambda calls: np.full_like(calls, steps))(env.snapshot()))
    assert _future(env) == _future(twin)


_TWO_LINKS = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" limited="true" range="-40 40"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
      <body name="lower" pos="0 0 0.5">
        <joint name="elbow" axis="0 1 0" limited="true" range="-30 30"/>
        <geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


class _Lengthening(base.Task):
    """Its starts, at the limits of the joints, draw a length on which MuJoCo's constants depend."""

    EPISODE_FIELDS = ("body_pos",)

    def initialize_episode(self, physics: Any) -> None:
        physics.named.model.body_pos["lower", "z"] = self.random.uniform(0.1, 0.9)
        physics.data.qpos[:] = 0.68, 0.5
        physics.data.qvel[:] = 5.0

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(position=physics.position())

    def get_reward(self, physics: Any) -> Any:
        return physics.position()[..., 0]


def _lengthening() -> control.Environment:
    physics = mujoco.Physics.from_xml_string(_TWO_LINKS)
    randomize = {"body_mass": scale(0.5, 2)}
    return control.Environment(physics, _Lengthening(0), n_sub_steps=30, randomize=randomize)


def _restored(env: Any) -> Any:
    other = _lengthening()
    if isinstance(env, BatchEnvironment):
        other = BatchEnvironment.from_environment(other, env.num_envs, 1, seed=9)
    other.restore(env.snapshot())
    return other


@pytest.mark.parametrize("copied", [_restored, copy.deepcopy])
@pytest.mark.parametrize(
    "make",
    [_lengthening, lambda: BatchEnvironment.from_environment(_lengthening(), 2, 1, seed=0)],
    ids=["single", "batch"],
)
def test_constants_of_randomised_models_are_those_of_the_original(make: Any, copied: Any) -> None:
    env = make()
    env.reset()
    env.reset()
    other = copied(env)
    assert _future(env) == _future(other)


def test_a_row_has_the_constants_of_its_single_environment() -> None:
    env = _lengthening()
    batch = BatchEnvironment.from_environment(env, 2, 1, seed=0)
    for _ in range(2):
        env.reset(), batch.reset()
        for action in _actions(env, 5):
            expected = env.step(action).observation["position"]
            found = batch.step(np.tile(action, (2, 1))).observation["position"][0]
            np.testing.assert_array_equal(found, expected)


def test_seeding_in_mid_episode_leaves_the_state_of_a_randomised_environment() -> None:
    kwargs = {"randomize": {"body_mass": scale(0.5, 2)}}
    env = suite.load("lqr", "lqr_2_1", {"random": 0}, kwargs)
    env.reset()
    before = env.physics.position()
    env.reseed(7)
    np.testing.assert_array_equal(env.physics.position(), before)


class _Halving(control.Environment):
    """Halves the actions."""

    def step(self, action: Any) -> Any:  # as dm_env declares them
        return super().step(0.5 * np.asarray(action))


def _halving() -> _Halving:
    env = suite.load("cartpole", "swingup", {"random": 0})
    return _Halving(env.physics, env.task, time_limit=1, control_timestep=0.01)


def test_a_copy_of_another_kind_of_environment_is_refused_in_words() -> None:
    copies = batch_of(_halving(), 2, seed=0).snapshot()
    assert copies.copies
    expected = r"copies of environments \(.*_Halving\); expected states of plain environments"
    with pytest.raises(ValueError, match=expected):
        suite.load_batch("cartpole", "swingup", 2, seed=0).restore(copies)
    with pytest.raises(ValueError, match=r"_Halving'; expected '.*Environment'"):
        suite.load("cartpole", "swingup").restore(copies.part(0))


def test_the_state_of_a_plain_environment_is_refused_by_a_subclass_in_words() -> None:
    state = suite.load_batch("cartpole", "swingup", 2, seed=0).snapshot()
    expected = "states of plain environments; expected copies of environments"
    with pytest.raises(ValueError, match=expected):
        batch_of(_halving(), 2, seed=0).restore(state)
    with pytest.raises(ValueError, match=expected):
        _halving().restore(state.part(0))


def test_pictures_in_a_snapshot_are_ignored_where_none_are_observed_in_any_look() -> None:
    pixels = {"pixels": {"height": 8, "width": 8}}
    for look in ({}, {"appearance": "color_hard"}):
        seeing = suite.load("pendulum", "swingup", {"random": 0}, {**pixels, **look})
        blind = suite.load("pendulum", "swingup", {"random": 1}, look)
        seeing.reset()
        seeing.step([0.5])
        blind.restore(seeing.snapshot())
        np.testing.assert_array_equal(blind.physics.state(), seeing.physics.state())
