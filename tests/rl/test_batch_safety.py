"""Tasks that would be wrong in a batch are refused when it is created, with the reason."""

import collections
import contextlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.rl import batch, batch_of, control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale
from limberjack.suite import base
from limberjack.utils import arrays, rewards
from tests.laws.episodes import variant
from tests.representatives import FEATURES

_ARM = """
<mujoco model="arm">
  <option timestep="0.01"/>
  <asset>
    <hfield name="hills" nrow="3" ncol="3" size="1 1 1 .1" elevation="0 0 0 0 1 0 0 0 0"/>
    <texture name="sky" type="skybox" builtin="gradient" width="8" height="8"/>
    <mesh name="shard" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
    <material name="self"/>
  </asset>
  <worldbody>
    <geom name="hills" type="hfield" hfield="hills" contype="0" conaffinity="0" pos="0 0 -5"/>
    <geom name="shard" type="mesh" mesh="shard" contype="0" conaffinity="0" pos="0 0 -5"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping="0.1"/>
      <geom name="upper" type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
      <body name="lower" pos="0 0 0.5">
        <joint name="elbow" axis="0 1 0" damping="0.1"/>
        <geom name="lower" type="capsule" size="0.03" fromto="0 0 0 0 0 0.5"/>
        <site name="tip" pos="0 0 0.5"/>
      </body>
    </body>
    <body name="goal" pos="0.5 0 1"><site name="goal"/></body>
  </worldbody>
  <actuator>
    <motor joint="shoulder" ctrllimited="true" ctrlrange="-1 1"/>
    <motor joint="elbow"/>
  </actuator>
</mujoco>
"""


class Physics(mujoco.Physics):
    def tip_to_goal(self) -> Any:
        sites = self.named.data.site_xpos
        return sites["goal"] - sites["tip"]


class Reach(base.Task[Physics]):
    """Batch-safe; each task below breaks one rule."""

    EPISODE_FIELDS = ("body_pos",)
    GOAL = ("near",)

    def initialize_episode(self, physics: Physics) -> None:
        physics.named.data.qpos[["shoulder", "elbow"]] = self.random.uniform(-1, 1, 2)
        physics.named.model.body_pos["goal", "x"] = self.random.uniform(0.2, 0.8)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> Any:
        obs = collections.OrderedDict()
        obs["angles"] = physics.position()
        obs["to_goal"] = physics.tip_to_goal()
        obs["velocity"] = physics.velocity()
        return obs

    def reward_terms(self, physics: Physics) -> Any:
        return {
            "near": rewards.tolerance(arrays.norm(physics.tip_to_goal()), (0, 0.1), margin=1),
            "slow": rewards.mean_tolerance(physics.velocity(), margin=2),
        }

    def reward_of(self, terms: Any) -> Any:
        return terms["near"] * terms["slow"]


def _environment(task: Any, **kwargs: Any) -> control.Environment:
    physics = Physics.from_xml_string(_ARM)
    return control.Environment(physics, task, time_limit=1, n_sub_steps=2, **kwargs)


def _batch(task: Any, num_envs: int = 3, **kwargs: Any) -> BatchEnvironment:
    return BatchEnvironment.from_environment(_environment(task, **kwargs), num_envs, 1, seed=0)


def _with(**methods: Any) -> Any:
    """A task that breaks a rule in one of its methods."""
    return type("Broken", (Reach,), methods)(random=0)


def _observing(quantity: Any) -> Any:
    def get_observation(self: Any, physics: Physics) -> Any:
        obs = Reach.get_observation(self, physics)
        obs["mine"] = quantity(physics)
        return obs

    return _with(get_observation=get_observation)


def _rewarding(quantity: Any) -> Any:
    return _with(get_reward=lambda self, physics: quantity(physics))


def _starting(set_model: Any) -> Any:
    def initialize_episode(self: Any, physics: Physics) -> None:
        Reach.initialize_episode(self, physics)
        set_model(physics, self.random.uniform(0.1, 0.2))

    return _with(initialize_episode=initialize_episode)


@pytest.mark.parametrize("num_envs", [1, 2, 7])
def test_a_batch_safe_task_is_accepted(num_envs: int) -> None:
    assert _batch(Reach(random=0), num_envs).num_envs == num_envs


@pytest.mark.parametrize(
    ("quantity", "message"),
    [
        (lambda p: p.position()[:1], r"has shape \(1, 2\) in a batch of 3; expected \(3, 1\)"),
        (lambda p: p.position()[0], r"has shape \(2,\) in a batch of 3; expected \(3,\)"),
        (lambda p: np.linalg.norm(p.tip_to_goal()), r"has shape \(\) in a batch of 3"),
        # Shapes that fit: only the values differ.
        (lambda p: p.position()[::-1].copy(), r"is .* at index \[0\] in row 0 .*; expected"),
        (lambda p: p.velocity() / np.linalg.norm(p.position()), r"is .* in row \d"),
        (lambda p: p.position() - p.position().mean(), r"is .* in row \d"),
        (lambda p: p.position().astype("f4" if p.num_envs else "f8"), "has dtype float32"),
    ],
)
@pytest.mark.parametrize("num_envs", [3, 64])
def test_an_observation_is_compared_with_a_single_simulations(
    quantity: Any, message: str, num_envs: int
) -> None:
    message = message.replace("of 3", "of {0}").replace("(3", "({0}")
    expected = f"observation 'mine' of task Broken {message.format(min(num_envs, 4))}"
    with pytest.raises(ValueError, match=expected) as caught:
        _batch(_observing(quantity), num_envs)
    assert "index with `...`, reduce over axis -1" in str(caught.value)


def test_an_error_that_is_kept_does_not_keep_the_context_of_the_rows() -> None:
    x = np.zeros(2)
    with pytest.raises(ValueError, match=r"in row \d of a batch") as caught:
        _batch(_rewarding(lambda physics: np.abs(physics.velocity()).max()), len(x))
    # Else powers of any vector of as many numbers would be rounded as those of rows.
    assert not arrays.one_value_per_row(x), caught


def test_a_batch_of_one_is_checked_on_two_rows() -> None:
    with pytest.raises(ValueError, match=r"has shape \(2,\) in a batch of 2; expected \(2,\)|is "):
        _batch(_observing(lambda physics: physics.position()[0]), 1)


@pytest.mark.parametrize(
    "quantity",
    [
        lambda p: rewards.tolerance(float(np.linalg.norm(p.tip_to_goal())), margin=1),
        lambda p: p.velocity().mean(),
        lambda p: p.position()[..., 0] - p.position()[0, ..., 0] if p.num_envs else 0.0,
        lambda p: np.abs(p.velocity()).max(),
    ],
)
def test_a_reward_over_all_rows_is_refused_by_its_value(quantity: Any) -> None:
    with pytest.raises(ValueError, match=r"the reward of task Broken is .* in row \d of a batch"):
        _batch(_rewarding(quantity))


def test_a_reward_that_is_a_constant_is_accepted() -> None:
    batch = _batch(_rewarding(lambda physics: 0.5))
    batch.reset()
    assert batch.step(np.zeros((3, 2))).reward.tolist() == [0.5] * 3


@pytest.mark.parametrize(
    ("quantity", "error"),
    [
        (lambda p: max(p.position()[..., 0], 0.0), "ValueError"),
        (lambda p: float(p.position()[..., 0]), "TypeError"),
        (lambda p: 1.0 if p.position()[..., 0] > 0 else 0.0, "ValueError"),
        (lambda p: p.tip_to_goal()[2], "IndexError"),
        (lambda p: np.concatenate([p.position(), p.tip_to_goal()[..., 0]]), "ValueError"),
    ],
)
def test_an_error_in_a_batch_names_the_observation_and_the_line(quantity: Any, error: str) -> None:
    def single_or_batch(physics: Physics) -> Any:
        if not physics.num_envs and error in ("ValueError", "IndexError"):
            return np.float64(0)
        return quantity(physics)

    with pytest.raises(ValueError, match="observation 'mine' of task Broken raises") as caught:
        _batch(_observing(single_or_batch), 2)
    text = str(caught.value)
    assert f"raises {error} in a batch of 2 rows, but not in a single simulation: " in text
    assert re.search(r"line \d+: `.*p\.", text), text
    assert "np.maximum and np.where for max() and if" in text
    assert type(caught.value.__cause__).__name__ == error


@pytest.mark.parametrize(
    ("method", "label"),
    [
        ("get_reward", "the reward"),
        ("reward_terms", "the reward"),
        ("is_success", "is_success"),
        ("get_termination", "get_termination"),
        ("before_step", "before_step"),
        ("after_step", "after_step"),
    ],
)
def test_an_error_in_any_other_part_of_a_task_is_named(method: str, label: str) -> None:
    def broken(self: Any, *given: Any) -> Any:
        physics = given[-1]
        is_batch = np.ndim(given[0]["near"]) if method == "is_success" else physics.num_envs
        if is_batch:
            return np.zeros(2) + np.zeros(5)
        return getattr(super(type(self), self), method)(*given)

    with pytest.raises(ValueError, match=f"{label} of task Broken raises ValueError") as caught:
        _batch(_with(**{method: broken}))
    assert "shapes (2,) (5,)" in str(caught.value)


def test_terms_success_and_termination_are_compared() -> None:
    def near_of_all(self: Any, physics: Physics) -> Any:
        terms = Reach.reward_terms(self, physics)
        return {**terms, "near": terms["near"] * np.mean(physics.velocity())}

    def any_ends(self: Any, physics: Physics) -> Any:
        ends = physics.velocity()[..., 0] > 0
        if physics.num_envs is None:
            return 0.0 if ends else None
        return np.where(ends.any(), 0.0, np.full(physics.num_envs, np.nan))

    for broken, label in (
        ({"reward_terms": near_of_all}, "the reward"),
        ({"reward_terms": near_of_all, "reward_of": lambda self, terms: 1.0}, "reward term 'near'"),
        ({"is_success": lambda self, terms: terms["near"] > np.mean(terms["near"])}, "is_success"),
        ({"get_termination": any_ends}, "get_termination"),
    ):
        with pytest.raises(ValueError, match=f"{label} of task Broken is .* in row"):
            _batch(_with(**broken))


def test_names_of_observations_must_not_depend_on_the_batch() -> None:
    def fewer(self: Any, physics: Physics) -> Any:
        obs = Reach.get_observation(self, physics)
        if physics.num_envs:
            del obs["to_goal"]
        return obs

    def more(self: Any, physics: Physics) -> Any:
        obs = Reach.get_observation(self, physics)
        return {**obs, "rows": physics.position()} if physics.num_envs else obs

    with pytest.raises(ValueError, match="observation 'to_goal' of task Broken is missing"):
        _batch(_with(get_observation=fewer))
    with pytest.raises(ValueError, match="observation 'rows' of task Broken exists in a batch"):
        _batch(_with(get_observation=more))


def test_an_attribute_that_a_start_sets_is_named() -> None:
    def initialize_episode(self: Any, physics: Physics) -> None:
        Reach.initialize_episode(self, physics)
        self._offset = self.random.uniform(-1, 1, 2)

    def get_observation(self: Any, physics: Physics) -> Any:
        return {"angles": physics.position() - self._offset}  # a shape that fits

    task = _with(initialize_episode=initialize_episode, get_observation=get_observation)
    with pytest.raises(ValueError, match=r"sets self\._offset in initialize_episode"):
        _batch(task)
    assert not hasattr(task, "_offset")


def test_an_attribute_counts_even_if_it_is_set_to_an_equal_value() -> None:
    def after_step(self: Any, physics: Physics) -> None:
        self.has_touched = False

    task = _with(after_step=after_step)
    task.has_touched = False
    with pytest.raises(ValueError, match=r"sets self\.has_touched in initialize_episode"):
        _batch(task)


_HOOKS = ["initialize_episode", "before_step", "after_step", "get_reward", "get_observation"]
_HOOKS += ["get_termination", "begin_stream"]


def _then(hook: str, change: Any) -> Any:
    """A task that does something more in a hook."""

    def more(self: Any, *args: Any) -> Any:
        change(self, args[-1])
        return getattr(Reach, hook)(self, *args)

    return _with(**{hook: more})


def _append(self: Any, physics: Physics) -> None:
    self.history.append(0)


def _count_in_physics(self: Any, physics: Physics) -> None:
    if isinstance(physics, Physics):
        physics.calls = 1  # pyright: ignore[reportAttributeAccessIssue]


def _count_in_class(self: Any, physics: Physics) -> None:
    type(self).calls.append(0)


class _Filter:
    def __init__(self) -> None:
        self.value = 0.0


def _filter(self: Any, physics: Physics) -> None:
    self.filter.value += 1.0


@pytest.mark.parametrize("hook", _HOOKS)
@pytest.mark.parametrize(
    ("change", "named"),
    [
        (_append, r"self\.history"),
        (_filter, r"self\.filter"),
        (_count_in_class, r"\w+\.calls"),
        (_count_in_physics, r"physics\.calls"),
    ],
)
def test_what_a_hook_remembers_is_named(hook: str, change: Any, named: str) -> None:
    if hook == "begin_stream" and change is _count_in_physics:
        return  # this hook does not see the physics
    task = _then(hook, change)
    task.history, task.filter = [], _Filter()
    type(task).calls = []
    expected = "initialize_episode" if hook == "after_step" else hook  # a start calls it first
    with pytest.raises(ValueError, match=f"sets .*{named}.* in {expected}"):
        _batch(task)
    assert not task.history
    assert not task.filter.value


def test_a_cached_property_is_not_memory() -> None:
    import functools

    class Cached(Reach):
        @functools.cached_property
        def scale(self) -> list[float]:
            return [2.0]

        def get_reward(self, physics: Physics) -> Any:
            self.scale.append(0.0)
            return self.scale[0] * physics.velocity()[..., 0]

    _batch(Cached(random=0))


@pytest.mark.parametrize("hook", _HOOKS[1:-1])
@pytest.mark.parametrize("stream", ["the task's", "NumPy's global"])
def test_a_hook_of_a_step_that_draws_is_refused_and_streams_do_not_advance(
    hook: str, stream: str
) -> None:
    def draw(self: Any, physics: Physics) -> None:
        (self.random if stream == "the task's" else np.random).uniform()

    task = _then(hook, draw)
    np.random.seed(5)
    expected = np.random.RandomState(5).uniform()
    is_first = hook == "after_step" and stream != "the task's"  # a start calls it too
    expected_hook = "initialize_episode" if is_first else hook
    with pytest.raises(ValueError, match=f"draws from {stream} random stream in {expected_hook}"):
        _batch(task)
    assert np.random.uniform() == expected
    assert task.random.uniform() == np.random.RandomState(0).uniform()


def test_a_class_is_left_as_it_was() -> None:
    class Assigning(Reach):
        def __setattr__(self, name: str, value: object) -> None:
            object.__setattr__(self, name, value)

    before = {cls: vars(cls).get("__setattr__") for cls in (Assigning, Reach, Physics)}
    _batch(Assigning(random=0))
    assert {cls: vars(cls).get("__setattr__") for cls in before} == before


class _Measuring(Physics):
    """Methods as programs for single simulations write them, and two that are right."""

    def distance(self) -> Any:
        return np.linalg.norm(self.tip_to_goal())

    def tip_height(self) -> Any:
        return self.named.data.site_xpos["tip"][2]

    def is_near(self) -> Any:
        return self.distance() < 1e-3

    def reach(self) -> Any:
        return self.model.geom_size[:2, 1]

    def gaps(self) -> list[Any]:
        return [self.tip_to_goal()[..., axis] for axis in range(3)]

    def columns(self) -> Any:
        return np.array(self.gaps())


@pytest.mark.parametrize(
    ("quantity", "message"),
    [
        # Both are 0 in every state of the check.
        (lambda p: rewards.tolerance(p.distance(), (0, 1e-3)), r"distance\(\) .* has shape \(\)"),
        (lambda p: 0.0 if p.is_near() else 0.1, r"distance\(\) .* has shape \(\)"),
        (lambda p: rewards.tolerance(p.tip_height(), (90, 99)), r"tip_height\(\) .* is .* in row"),
    ],
)
def test_a_wrong_measurement_is_refused_where_the_reward_is_too_sparse_to_show_it(
    quantity: Any, message: str
) -> None:
    physics = _Measuring.from_xml_string(_ARM)
    env = control.Environment(physics, _rewarding(quantity), time_limit=1, n_sub_steps=2)
    with pytest.raises(ValueError, match=rf"^physics\.{message}.*arrays\.norm\(x\)"):
        BatchEnvironment.from_environment(env, 3, 1, seed=0)


def test_a_measurement_may_be_a_constant_or_arranged_as_the_task_likes() -> None:
    def gap(physics: Any) -> Any:
        return physics.columns()[0] + sum(physics.gaps()) + physics.reach()[0]

    physics = _Measuring.from_xml_string(_ARM)
    env = control.Environment(physics, _rewarding(gap), time_limit=1, n_sub_steps=2)
    assert BatchEnvironment.from_environment(env, 3, 1, seed=0).num_envs == 3
    assert "distance" not in vars(physics)


def test_a_physics_that_replaces_a_part_of_its_step_is_refused() -> None:
    class Careless(Physics):
        @contextlib.contextmanager
        def check_invalid_state(self) -> Iterator[None]:
            yield

    physics = Careless.from_xml_string(_ARM)
    env = control.Environment(physics, Reach(random=0), time_limit=1, n_sub_steps=2)
    message = "Careless replaces check_invalid_state, which the rows of a batch do not call"
    with pytest.raises(ValueError, match=message):
        BatchEnvironment.from_environment(env, 3, 1, seed=0)
    assert batch_of(env, 2, 1, seed=0).why_rows is not None


def _set_hills(physics: Physics, value: float) -> None:
    physics.model.hfield_data[4] = value


def _set_sky(physics: Physics, value: float) -> None:
    physics.model.tex_data[0] = int(value * 1_000)


def _set_shard(physics: Physics, value: float) -> None:
    physics.model.mesh_vert[0, 0] = value


def _set_colour(physics: Physics, value: float) -> None:
    physics.named.model.geom_rgba["upper", "r"] = value


def _set_gravity(physics: Physics, value: float) -> None:
    physics.model.opt.gravity[0] = value


def _set_density(physics: Physics, value: float) -> None:
    physics.model.opt.density = value


def _set_contacts(physics: Physics, value: float) -> None:
    physics.model.geom_contype[:] = int(value * 1_000)


@pytest.mark.parametrize(
    ("set_model", "field"),
    [
        (_set_colour, "geom_rgba"),
        (_set_gravity, r"opt\.gravity"),
        (_set_density, r"opt\.density"),
        (_set_contacts, "geom_contype"),
        (_set_hills, "hfield_data"),
        (_set_shard, "mesh_vert"),
    ],
)
def test_a_start_that_sets_an_undeclared_field_is_refused_with_advice(
    set_model: Any, field: str
) -> None:
    declared = rf"\('body_pos', '{field}'\)"
    expected = rf"Broken sets {field} of the model as .*; declare EPISODE_FIELDS = {declared}"
    with pytest.raises(ValueError, match=expected):
        _batch(_starting(set_model))


def test_a_start_that_sets_a_shared_field_is_refused() -> None:
    expected = "Broken sets tex_data of the model .*the rows of a batch share tex_data"
    with pytest.raises(ValueError, match=expected):
        _batch(_starting(_set_sky))
    task = _starting(_set_sky)
    task.EPISODE_FIELDS = ("body_pos", "tex_data")
    with pytest.raises(ValueError, match="declares 'tex_data' in EPISODE_FIELDS, which cannot"):
        _batch(task)


@pytest.mark.parametrize(
    ("set_model", "field"), [(_set_hills, "hfield_data"), (_set_shard, "mesh_vert")]
)
def test_a_field_that_needs_a_model_for_each_row_may_be_declared(
    set_model: Any, field: str
) -> None:
    task = _starting(set_model)
    task.EPISODE_FIELDS = ("body_pos", field)
    _batch(task)


def test_large_fields_are_looked_at_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    from limberjack.rl import batch_safety

    monkeypatch.setattr(batch_safety, "_LARGE", 4)
    with pytest.raises(ValueError, match="sets hfield_data of the model in an episode"):
        _batch(_starting(_set_hills))


@pytest.mark.parametrize("hook", ["before_step", "after_step"])
def test_a_step_that_sets_an_undeclared_field_is_refused(hook: str) -> None:
    def step(self: Any, *given: Any) -> None:
        getattr(Reach, hook)(self, *given)
        if given[-1].num_envs is None and given[-1].time():
            _set_colour(given[-1], 0.25)

    with pytest.raises(ValueError, match="Broken sets geom_rgba of the model during a step"):
        _batch(_with(**{hook: step}))


def test_declared_fields_are_compared() -> None:
    def after_step(self: Any, physics: Physics) -> None:
        if physics.num_envs is None:
            physics.named.model.body_pos["goal", "z"] += 0.5

    with pytest.raises(ValueError, match=r"model\.body_pos of task Broken is .* in row 0"):
        _batch(_with(after_step=after_step))


def test_controls_of_rows_are_compared() -> None:
    def before_step(self: Any, action: Any, physics: Physics) -> None:
        physics.set_control(action)
        if physics.num_envs:
            physics.data.ctrl[1] = action[0]

    with pytest.raises(ValueError, match=r"data\.ctrl of task Broken is .* in row 1 .*after 1 "):
        _batch(_with(before_step=before_step))


@pytest.mark.parametrize(
    ("fields", "error", "match"),
    [
        ("body_pos", TypeError, "EPISODE_FIELDS of task Broken is 'body_pos'; expected a tuple"),
        (("bodypos",), ValueError, r"declares 'bodypos' .*'body_pos'\?"),
        (("names",), ValueError, "declares 'names' in EPISODE_FIELDS"),
    ],
)
def test_fields_that_no_row_can_have_are_refused(fields: Any, error: Any, match: str) -> None:
    with pytest.raises(error, match=match):
        _batch(_with(EPISODE_FIELDS=fields))


def test_a_quantity_that_ignores_randomised_fields_is_refused() -> None:
    class Weighing(Reach):
        def __init__(self, mass: float) -> None:
            super().__init__(random=0)
            self._mass = mass

        def get_reward(self, physics: Physics) -> Any:
            mass = (
                physics.named.model.body_mass["upper"] if physics.num_envs is None else self._mass
            )
            return physics.velocity()[..., 0] * mass

    mass = float(Physics.from_xml_string(_ARM).named.model.body_mass["upper"])
    _batch(Weighing(mass))
    with pytest.raises(ValueError, match="the reward of task Weighing"):
        _batch(Weighing(mass), randomize={"body_mass": scale(0.5, 2)})


def test_the_task_is_left_as_it_was() -> None:
    counted: list[str] = []

    def initialize_episode(self: Any, physics: Physics) -> None:
        Reach.initialize_episode(self, physics)
        counted.append("a start")

    task = _with(initialize_episode=initialize_episode)
    before = {**vars(task)}
    batch = _batch(task)
    # Of copies: three rows, of which one begins twice, and all three with one task.
    assert len(counted) == 7
    assert vars(task) == before
    assert batch.begins.all()


def test_a_row_that_begins_again_later_is_compared() -> None:
    def get_reward(self: Any, physics: Physics) -> Any:
        # Rows are mixed once one of them has begun again.
        time = np.asarray(physics.data.time)
        return np.zeros(time.shape) + (time.min() if np.ptp(time) else 0.0)

    with pytest.raises(ValueError, match=r"reward of .* in row 0 of a batch after 7 steps"):
        _batch(_with(get_reward=get_reward))


def test_a_task_that_cannot_be_copied_is_refused_with_the_reason() -> None:
    import threading

    task = Reach(random=0)
    task.lock = threading.Lock()  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(ValueError, match=r"attribute task\.lock cannot be copied .*build\(seed\)"):
        _batch(task)


def test_a_function_that_uses_the_task_itself_is_refused() -> None:
    task = Reach(random=0)
    old = task.get_reward
    task.get_reward = lambda physics: old(physics) * 2  # pyright: ignore
    with pytest.raises(ValueError, match=r"task\.get_reward is a function that uses the env"):
        _batch(task)


def test_a_row_that_diverges_is_compared_no_further() -> None:
    def initialize_episode(self: Any, physics: Physics) -> None:
        Reach.initialize_episode(self, physics)
        if physics.data.qpos[0] > 0:
            physics.data.qvel[:] = 1e9

    def get_observation(self: Any, physics: Physics) -> Any:
        return {"angles": physics.position()}

    _batch(_with(initialize_episode=initialize_episode, get_observation=get_observation), 5)


@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
def test_the_suites_tasks_are_accepted_with_all_observation_options(
    task: tuple[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    kwargs = variant(task)
    monkeypatch.setattr(batch, "is_proved", lambda *given: False)  # this is their proof
    others = [{"legacy_step": False}, {"randomize": {"body_mass": scale(0.9, 1.1)}}]
    for options in ({}, *(others if task in FEATURES.values() else [])):
        assert suite.load_batch(*task, 1, 1, task_kwargs=kwargs, environment_kwargs=options)


@pytest.mark.parametrize(
    ("hook", "value", "message"),
    [
        ("get_reward", None, "get_reward of task Broken returned None; expected a number"),
        ("get_reward", "text", "get_reward of task Broken returned 'text'; expected a number"),
        ("get_reward", np.zeros(3), r"returned an array of shape \(3,\) in a single simulation"),
        ("get_termination", "text", "get_termination of task Broken returned 'text'; expected"),
        ("get_termination", np.zeros(2), r"get_termination of task Broken returned an array"),
        ("get_observation", None, "get_observation of task Broken returned None; expected a map"),
        ("get_observation", {"a": None}, "observation 'a' of task Broken returned None; expected"),
        ("get_observation", {"a": "b"}, "observation 'a' of task Broken returned 'b'; expected"),
    ],
)
def test_what_is_not_a_number_is_named_with_task_and_hook(
    hook: str, value: Any, message: str
) -> None:
    def broken(self: Any, physics: Physics) -> Any:
        return value

    with pytest.raises((TypeError, ValueError), match=message):
        _batch(_with(**{hook: broken}))


@pytest.mark.parametrize(
    ("hook", "value", "message"),
    [
        ("get_reward", None, "get_reward of task Broken returned None; expected a number for each"),
        ("get_reward", "text", "get_reward of task Broken returned 'text'; expected a number for"),
        ("get_reward", np.zeros(2), r"returned an array of shape \(2,\); expected \(3,\)"),
        ("get_termination", "text", "get_termination of task Broken returned 'text'; expected a"),
        ("get_termination", np.zeros((3, 1)), r"get_termination .* shape \(3, 1\); expected"),
        ("get_observation", None, "get_observation of task Broken returned None; expected a map"),
        ("get_observation", {}, r"get_observation of task Broken lacks \['angles'\]"),
        ("get_observation", {"angles": None}, "observation 'angles' of task Broken has shape None"),
        ("get_observation", {"angles": np.zeros((3, 3))}, r"has shape \(3, 3\) .*; expected"),
        ("get_observation", {"angles": np.zeros((3, 2), "f4")}, "dtype float32; expected"),
        ("get_observation", {"angles": np.zeros((3, 2)), "b": np.zeros(3)}, "'b' of task Broken"),
    ],
)
def test_what_changes_only_later_is_named_at_that_step(hook: str, value: Any, message: str) -> None:
    def broken(self: Any, physics: Physics) -> Any:
        if np.any(np.asarray(physics.data.time) > 0.3):
            return value
        if hook == "get_observation":
            return {"angles": physics.position()}
        return getattr(Reach, hook)(self, physics)

    batch = _batch(_with(**{hook: broken}))
    batch.reset()

    def play() -> None:
        for _ in range(100):
            batch.step(np.zeros((3, 2)))

    with pytest.raises((TypeError, ValueError), match=message):
        play()
    assert batch.begins.all()
