"""The planner: properties for all tasks, and rejected arguments."""

import dataclasses
from typing import Any

import gymnasium
import numpy as np
import pytest
from dm_env import specs

import limberjack.gym  # noqa: F401 (registers the environments)
from limberjack import policies, suite
from limberjack.planner import ICEM, Cost, Planner, Settings, cost_for
from limberjack.planner.optimisers.base import Search
from limberjack.planner.rollouts import Rollouts
from limberjack.rl import control
from limberjack.suite import acrobot, base
from tests.rollouts import run_episode

from .planned import PLANNED

every_task = pytest.mark.parametrize(("domain", "task"), PLANNED)


def _load(domain: str, task: str, seed: int = 5, time_limit: float = 10.0) -> Any:
    return suite.load(domain, task, task_kwargs={"random": seed, "time_limit": time_limit})


def _small(env: Any, **changes: Any) -> Settings:
    """The task's settings, for plans that are quick to make."""
    return dataclasses.replace(cost_for(env.task).settings, samples=12, horizon=0.1, **changes)


def _actions(env: Any, planner: Planner, steps: int) -> np.ndarray:
    actions = []
    for _ in range(steps):
        actions.append(planner.act())
        env.step(actions[-1])
    return np.array(actions)


def test_a_planner_knows_nothing_of_faults() -> None:
    longer = {"parameter": "pole_length", "lowest": 2.0, "highest": 2.3}
    late = {"delay": {"actions": 2, "observations": 2}, "perturbation": longer}
    faulty = suite.load("cartpole", "swingup", {"random": 5}, faults=late)
    faulty.reset()  # with a longer pole, before the planner is made
    faulty.reseed(5)
    planned = []
    for env in (faulty, _load("cartpole", "swingup")):
        planner = Planner(env, num_threads=1, settings=_small(env))
        env.reset()
        planned.append((planner, planner.act()))
    (blind, action), (planner, expected) = planned
    np.testing.assert_array_equal(action, expected)
    assert faulty._ours.faults is not None
    for name in faulty._ours.faults.fields:
        nominal = getattr(planner._now.model, name)
        for physics in (blind._now, *(one.physics for one in blind._rollouts.values())):
            np.testing.assert_array_equal(getattr(physics.model, name), nominal)
        assert not np.array_equal(getattr(faulty.physics.model, name), nominal)


def test_what_starts_draw_is_planned_with_in_an_environment_with_an_attribute_too() -> None:
    actions, targets = [], []
    for noted in (False, True):
        env = _load("stacker", "stack_2")
        if noted:
            env.note = "of mine"
        planner = Planner(env, num_threads=1, settings=_small(env))
        env.reset()
        actions.append(planner.act())
        targets.append(planner._now.named.model.body_pos["target"].copy())
        np.testing.assert_array_equal(targets[-1], env.physics.named.model.body_pos["target"])
    np.testing.assert_array_equal(actions[1], actions[0])


def _measured(planner: Planner) -> None:
    """Gives a planner's budget a first measurement: of almost no time."""
    planner._budget.begin()
    planner._budget.spent(planner._budget.size())


@every_task
def test_the_same_seed_gives_the_same_actions_at_any_number_of_threads(
    domain: str, task: str
) -> None:
    found = []
    for threads in (1, 3):
        env = _load(domain, task)
        planner = Planner(env, num_threads=threads, seed=1, settings=_small(env))
        env.reset()
        found.append(_actions(env, planner, 8))
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.parametrize("task", ["bring_ball", "insert_peg"])
def test_without_time_a_planner_tries_the_fewest_samples(
    task: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = _load("manipulator", task)
    env.reset()
    planner = Planner(env, num_threads=1, settings=_small(env), max_ms=1e-6)
    tried = []
    roll_out = Rollouts.roll_out

    def counting(batch: Rollouts, controls: np.ndarray, *args: Any) -> Any:
        tried.append(len(controls))
        return roll_out(batch, controls, *args)

    monkeypatch.setattr(Rollouts, "roll_out", counting)
    actions = _actions(env, planner, 4)
    assert set(tried) == {2}  # an eighth of 12 samples would be one
    spec = env.action_spec()
    assert (actions >= spec.minimum).all()
    assert (actions <= spec.maximum).all()
    assert planner.explain().terms


@every_task
def test_with_time_enough_a_planner_acts_as_without_a_budget(domain: str, task: str) -> None:
    found = []
    for max_ms in (None, 1e9):
        env = _load(domain, task)
        planner = Planner(env, num_threads=1, seed=1, settings=_small(env), max_ms=max_ms)
        if max_ms is not None:  # else the first planning step, before which nothing was measured
            _measured(planner)
        env.reset()
        found.append(_actions(env, planner, 4))
    np.testing.assert_array_equal(found[0], found[1])


@every_task
def test_planning_leaves_the_environment_as_it_is(domain: str, task: str) -> None:
    env, twin = _load(domain, task), _load(domain, task)
    env.reset()
    twin.reset()
    planner = Planner(env, num_threads=1, settings=_small(env))
    for _ in range(4):
        before = env.snapshot()
        action = planner.act()
        after = env.snapshot()
        for name, value in before.physics.items():
            np.testing.assert_array_equal(value, after.physics[name])
        # What no snapshot holds would show in what follows.
        ours, theirs = env.step(action), twin.step(action)
        assert ours.reward == theirs.reward
        for name, value in theirs.observation.items():
            np.testing.assert_array_equal(ours.observation[name], value)


@every_task
def test_actions_are_within_the_bounds_and_differ_with_the_seed(domain: str, task: str) -> None:
    found = []
    for seed in (0, 1):
        env = _load(domain, task)
        env.reset()
        planner = Planner(env, num_threads=1, seed=seed, settings=_small(env, interval=1))
        found.append(_actions(env, planner, 4))
        spec = env.action_spec()
        assert (found[-1] >= spec.minimum).all()
        assert (found[-1] <= spec.maximum).all()
    assert not np.array_equal(found[0], found[1])


def test_bounds_of_the_tasks_own_that_are_narrower_are_kept() -> None:
    class Narrow(acrobot.Balance):
        def action_spec(self, physics: Any) -> specs.BoundedArray:
            return specs.BoundedArray((1,), float, -0.25, 0.125)

    physics = acrobot.Physics.from_xml_string(*acrobot.get_model_and_assets())
    env = control.Environment(physics, Narrow(sparse=False, random=5))
    env.reset()
    found = _actions(env, Planner(env, num_threads=1, settings=_small(env, interval=1)), 6)
    assert ((found >= -0.25) & (found <= 0.125)).all()
    assert (abs(found) > 0.1).any()  # it would like to push harder


def test_an_environment_that_repeats_actions_is_refused() -> None:
    env = suite.load("acrobot", "swingup", action_repeat=2)
    with pytest.raises(ValueError, match="action_repeat=2, but the planner acts at every control"):
        Planner(env, num_threads=1)


class _Towards(Cost):
    """Wants the humanoid's abdomen bent as far as it goes."""

    settings = Settings(samples=32, horizon=0.15, knots=2, timestep=0.0125)

    def step_cost(self, physics: Any) -> np.ndarray:
        return -physics.named.data.qpos["abdomen_y"][..., 0]


def test_the_plan_lowers_the_cost() -> None:
    bent = {}
    for policy in ("planner", "zero"):
        env = _load("humanoid", "stand")
        env.reset()
        planner = Planner(env, num_threads=1, cost=_Towards(env.task))
        for _ in range(8):
            env.step(planner.act() if policy == "planner" else np.zeros(21))
        bent[policy] = float(env.physics.named.data.qpos["abdomen_y"][0])
    assert bent["planner"] > bent["zero"] + 0.3


def test_a_plan_reaches_the_last_of_its_intervals() -> None:
    env = _load("humanoid", "stand")
    env.reset()
    looks = []

    class Looking(_Towards):
        def update(self, physics: Any) -> None:
            looks.append(physics.time())

    settings = dataclasses.replace(_Towards.settings, interval=3)
    planner = Planner(env, num_threads=1, cost=Looking(env.task), settings=settings)
    _actions(env, planner, 7)
    # Simulated time is a sum of time steps, which rounds.
    np.testing.assert_allclose(looks, [0.0, 0.075, 0.15], rtol=0, atol=1e-12)


def test_proposals_are_tried_again_until_it_is_time_for_others_or_the_stage_changes() -> None:
    env = _load("humanoid", "stand")
    env.reset()
    asked, tried = [], []

    class Proposing(_Towards):
        settings = Settings(
            samples=4, horizon=0.2, knots=5, timestep=0.0125, proposal_interval=3, noise=1e-9
        )

        def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
            asked.append(len(tried))
            return np.linspace(0.0, 0.4, 5)[None, :, None] * np.ones(21)

        def stage(self) -> int:
            return len(tried) // 5

    planner = Planner(env, num_threads=1, cost=Proposing(env.task))
    costs = planner._costs

    def noting(saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        tried.append(samples[1, :, 0])
        return costs(saved, samples)

    planner._costs = noting
    _actions(env, planner, 8)
    assert asked == [0, 3, 5]
    # From one to the next half of the time between two knots has passed. Their last targets hold.
    for number, passed in enumerate([0, 1, 2, 0, 1, 0, 1, 2]):
        expected = 0.1 * np.arange(3) + 0.05 * passed
        # Splines of splines: they round.
        np.testing.assert_allclose(tried[number][:3], expected, rtol=0, atol=1e-12)


def test_anchored_knots_keep_their_moments_until_they_have_passed() -> None:
    env = _load("humanoid", "stand")
    env.reset()
    found = []

    class Looking(_Towards):
        settings = Settings(samples=2, horizon=0.15, knots=5, anchored=True, timestep=0.0125)

        def continued(self, plan: np.ndarray) -> np.ndarray:
            found.append((env.physics.time(), len(plan)))
            return super().continued(plan)

    planner = Planner(env, num_threads=1, cost=Looking(env.task))
    assert planner.settings.spacing == pytest.approx(0.05)  # two control steps
    _actions(env, planner, 6)
    assert [count for _, count in found] == [5, 5]
    # Simulated time is a sum of time steps, which rounds.
    np.testing.assert_allclose([time for time, _ in found], [0.05, 0.1], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("interval", "expected"), [(1, 6), (2, 3), (4, 2), (6, 1)])
def test_a_plans_cost_is_looked_at_as_often_as_is_asked(interval: int, expected: int) -> None:
    env = _load("humanoid", "stand")
    env.reset()
    seen = []

    class Looking(_Towards):
        def step_cost(self, physics: Any) -> np.ndarray:
            seen.append(physics.data.time.copy())
            return super().step_cost(physics)

    settings = dataclasses.replace(_Towards.settings, cost_interval=interval)
    Planner(env, num_threads=1, cost=Looking(env.task), settings=settings).act()
    moments = np.unique(seen[-1])
    assert len(moments) == expected
    assert len(seen[-1]) == expected * settings.samples
    assert moments[-1] == pytest.approx(settings.horizon)  # the last state counts


def test_an_episode_that_has_begun_is_planned_anew() -> None:
    env = _load("manipulator", "bring_ball")
    planner = Planner(env, num_threads=1, settings=_small(env))
    found = []
    for _ in range(2):
        env.reseed(5)
        env.reset()  # and no planner.reset()
        found.append(_actions(env, planner, 5))
    np.testing.assert_array_equal(found[0], found[1])


def test_an_episode_that_has_begun_after_a_single_step_is_planned_anew() -> None:
    env = _load("manipulator", "bring_ball")
    planner = Planner(env, num_threads=1, settings=_small(env))
    found = []
    for _ in range(3):
        env.reseed(5)
        env.reset()
        env.step(np.zeros(5))
        env.reset()  # another start at the same time
        assert env.physics.time() == 0
        found += [planner.act(), planner.act()]  # asked again, it says the same
        env.reseed(6)
        env.reset()
        assert (planner.act() != found[0]).any()
    for action in found:
        np.testing.assert_array_equal(action, found[0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_threads": 0}, "num_threads is 0; expected a whole number of at least 1"),
        ({"cost": _Towards}, "cost is _Towards itself; expected an instance of a subclass"),
        ({"settings": {"samples": 3}}, r"settings is dict; expected Settings\(...\)"),
        ({"cost": 3}, "cost is int; expected an instance of a subclass of Cost, .* or a function"),
        ({"policy": 3}, "policy is of type int; expected a function from an observation"),
    ],
)
def test_what_cannot_be_planned_with_is_named(arguments: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        Planner(_load("humanoid", "stand"), **arguments)


@pytest.mark.parametrize(
    ("proposals", "message"),
    [
        (np.zeros((2, 3, 21)), r"proposals of Proposing returned shape \(2, 3, 21\); expected"),
        (
            np.full((2, 2, 21), np.nan),
            "proposals of Proposing returned numbers that are not finite",
        ),
    ],
)
def test_proposals_that_are_no_plans_are_named(proposals: np.ndarray, message: str) -> None:
    class Proposing(_Towards):
        def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
            return proposals

    env = _load("humanoid", "stand")
    env.reset()
    with pytest.raises(ValueError, match=message):
        Planner(env, num_threads=1, cost=Proposing(env.task)).act()


@pytest.mark.parametrize(
    ("domain", "task"),
    [
        ("pendulum", "swingup"),
        ("humanoid", "run"),
        ("humanoid_CMU", "stand"),
        ("manipulator", "insert_ball"),
    ],
)
def test_proposals_have_the_knots_of_settings_that_replace_the_costs(
    domain: str, task: str
) -> None:
    env = _load(domain, task)
    env.reset()
    cost = cost_for(env.task)
    settings = _small(env, knots=cost.settings.knots + 2)
    planner = Planner(env, num_threads=1, cost=cost, settings=settings)
    planner.act()
    assert planner._proposals.shape[1] == settings.knots
    assert planner.cost.settings is settings


def test_a_tower_is_stacked_with_the_knots_of_its_cost_alone() -> None:
    env = _load("stacker", "stack_2")
    env.reset()
    message = r"shape \(\d+, 9, 5\); expected \(n, 11, 5\), for 11 knots"
    with pytest.raises(ValueError, match=message):
        Planner(env, num_threads=1, settings=_small(env, knots=11)).act()


def test_without_an_episode_there_is_nothing_to_plan_for() -> None:
    env = _load("humanoid", "stand", time_limit=0.05)
    planner = Planner(env, num_threads=1, settings=_small(env))
    with pytest.raises(RuntimeError, match=r"call env.reset\(\) before planner.act\(\)"):
        planner.act()
    env.reset()
    _actions(env, planner, 2)
    with pytest.raises(RuntimeError, match="no episode is running"):
        planner.act()


class _Own(base.Task):
    """A task that the planner does not know."""

    def initialize_episode(self, physics: Any) -> None:
        """Nothing."""

    def get_observation(self, physics: Any) -> dict[str, np.ndarray]:
        """The positions."""
        return {"position": physics.position()}

    def get_reward(self, physics: Any) -> float:
        """Nothing."""
        return 0.0


def _own_environment() -> control.Environment:
    return control.Environment(_load("humanoid", "stand").physics, _Own(), n_sub_steps=5)


def test_a_task_without_a_cost_is_told_what_to_write() -> None:
    with pytest.raises(ValueError, match="knows no cost for tasks of type _Own: write a subclass"):
        Planner(_own_environment())
    env = _own_environment()
    with pytest.raises(policies.PolicyError, match="policy 'planner': the planner knows no cost"):
        run_episode(env, policies.find("planner"), 0)


def test_a_cost_of_the_wrong_shape_is_named() -> None:
    class Wrong(Cost):
        def step_cost(self, physics: Any) -> np.ndarray:
            return physics.named.data.qpos["abdomen_y"]

    env = _own_environment()
    env.reset()
    planner = Planner(env, num_threads=1, cost=Wrong(env.task))
    with pytest.raises(ValueError, match=r"step_cost of Wrong returned shape \(\d+, 1\) and dtype"):
        planner.act()


_QUICK = Settings(samples=8, horizon=0.1, knots=2, timestep=0.0125)


def _planned_by(function: Any) -> Planner:
    env = _load("humanoid", "stand")
    env.reset()
    planner = Planner(env, num_threads=1, cost=function, settings=_QUICK)
    planner.act()
    return planner


def test_a_plain_function_is_a_cost() -> None:
    bent = {}
    for policy in ("planner", "zero"):
        env = _load("walker", "stand")
        env.reset()
        planner = Planner(
            env, num_threads=1, cost=lambda physics: {"height": -physics.torso_height()}
        )
        for _ in range(8):
            env.step(planner.act() if policy == "planner" else np.zeros(6))
        bent[policy] = float(env.physics.torso_height())
    assert bent["planner"] > bent["zero"] + 0.01
    assert list(_planned_by(lambda physics: physics.head_height()).explain().terms) == ["cost"]


def test_a_cost_may_read_what_the_model_has_none_of() -> None:
    def cost(physics: Any) -> Any:  # without activations
        state = physics.state()
        assert state.shape[1:] == (len(physics.model.qpos0) + physics.model.nv,)
        return state[..., 2] ** 2 + physics.data.act.sum(axis=-1)

    _planned_by(cost)


def _with_an_if(physics: Any) -> dict[str, np.ndarray]:
    if physics.head_height() > 1.0:
        return {"height": physics.head_height()}
    return {"height": 2.0 * physics.head_height()}


def test_an_if_over_rows_is_explained_as_in_a_batch() -> None:
    with pytest.raises(ValueError, match="cost _with_an_if raises ValueError") as error:
        _planned_by(_with_an_if)
    assert "in a batch of 32 rows, but not in a single simulation" in str(error.value)
    assert "`if physics.head_height() > 1.0:`" in str(error.value)
    assert "write np.maximum and np.where for max() and if" in str(error.value)


def test_a_mistake_that_is_none_of_rows_is_raised_as_it_is() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'heed_height'"):
        _planned_by(lambda physics: {"height": physics.heed_height()})


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (
            lambda physics: {
                "far": np.linalg.norm(physics.velocity()),
                "ok": physics.head_height(),
            },
            r"term 'far' of cost <lambda> has shape \(\) in a batch of 32; expected \(32,\): index",
        ),
        (
            lambda physics: {"joints": physics.joint_angles()},
            r"term 'joints' of cost <lambda> has shape \(32, 21\) in a batch of 32",
        ),
        (
            lambda physics: {"name": "high"},
            "term 'name' of cost <lambda> is of dtype <U4; expected numbers",
        ),
        (
            lambda physics: {"up": physics.head_height},
            r"term 'up' of cost <lambda> is a function that is not called: write head_height\(\)",
        ),
        (lambda physics: None, "term 'cost' of cost <lambda> is None: it must be returned"),
        (
            lambda physics: {"ok": physics.head_height(), "gap": physics.head_height() * np.nan},
            "'gap' of <lambda> is nan; expected finite numbers: look for a division by 0",
        ),
    ],
)
def test_a_term_that_is_no_number_for_each_state_is_named(function: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _planned_by(function)


def test_a_term_of_a_class_may_be_one_number_for_all_states() -> None:
    class Resting(Cost):
        settings = _QUICK

        def terms(self, physics: Any) -> dict[str, Any]:
            return {"height": physics.head_height(), "stage": 2.0}

    assert _planned_by(Resting(None)).explain().terms["stage"] == 2.0


class _Rising(Cost):
    """No cost before the horizon, and there the head's height."""

    settings = dataclasses.replace(_QUICK, cost_interval=2)
    until = 0.0  # seconds; the time at the horizon

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        return {"nothing": np.zeros(physics.num_envs)}

    def terminal(self, physics: Any) -> np.ndarray:
        assert physics.num_envs == self.settings.samples
        # Time is a sum of steps, which round.
        np.testing.assert_allclose(physics.data.time, self.until, rtol=0, atol=1e-9)
        return -physics.named.data.qpos["abdomen_y"][..., 0]


def test_what_follows_the_horizon_is_added_once_and_explained() -> None:
    env = _load("humanoid", "stand")
    env.reset()
    cost = _Rising(env.task)
    planner = Planner(env, num_threads=1, cost=cost)
    for _ in range(4):
        cost.until = env.physics.time() + planner.settings.horizon
        env.step(planner.act())
    assert planner._best is not None
    rollouts, best = planner._best
    bent = rollouts.physics.named.data.qpos["abdomen_y"][..., 0]
    assert best == np.argmax(bent)
    assert planner.explain().terms == {"nothing": 0.0, "terminal": -bent[best]}


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.zeros((8, 1)), r"terminal of Ending returned shape \(8, 1\) and dtype float64"),
        (np.full(8, np.nan), "no plan has a finite cost: 'terminal' of Ending is nan"),
    ],
)
def test_a_terminal_cost_that_is_no_number_for_each_plan_is_named(
    value: np.ndarray, message: str
) -> None:
    class Ending(_Rising):
        def terminal(self, physics: Any) -> np.ndarray:
            return value

    with pytest.raises(ValueError, match=message):
        _planned_by(Ending(None))


def test_servos_show_the_same_horizon() -> None:
    class Ending(Cost):
        def terms(self, physics: Any) -> dict[str, np.ndarray]:
            times.append(physics.data.time.copy())
            return {"nothing": np.zeros(physics.num_envs)}

        def terminal(self, physics: Any) -> np.ndarray:
            times.append(physics.data.time.copy())
            return physics.named.data.qpos["arm_root"][..., 0]

    times: list[np.ndarray] = []
    env = _load("manipulator", "bring_ball")
    env.reset()
    settings = _small(env)
    Planner(env, num_threads=1, cost=Ending(None), settings=settings).act()
    assert len(times[-1]) == settings.samples
    np.testing.assert_array_equal(times[-1], times[-2][-settings.samples :])


def test_an_optimiser_of_several_iterations_shares_the_samples_among_them() -> None:
    env = _load("humanoid", "stand")
    env.reset()
    settings = dataclasses.replace(_QUICK, samples=13, optimiser=ICEM(iterations=3))
    planner = Planner(env, num_threads=1, cost=_Towards(env.task), settings=settings)
    tried, costs = [], planner._costs

    def noting(saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        tried.append(len(samples))
        return costs(saved, samples)

    planner._costs = noting
    _actions(env, planner, 2)
    assert tried == [4] * 6


def test_an_optimiser_may_try_another_number_of_samples_in_each_iteration() -> None:
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Decaying(ICEM):
        def samples(self, search: Search, count: int, iteration: int) -> np.ndarray:
            return super().samples(search, count - 2 * iteration, iteration)

    env = _load("humanoid", "stand")
    env.reset()
    settings = dataclasses.replace(_QUICK, samples=12, optimiser=Decaying(iterations=2))
    planner = Planner(env, num_threads=1, cost=_Towards(env.task), settings=settings)
    _actions(env, planner, 2)
    assert {size: kept.simulation.num_envs for size, kept in planner._rollouts.items()} == {
        6: 6,
        4: 4,
    }


@pytest.mark.parametrize("anchored", [False, True])
def test_elites_are_shifted_in_time_with_the_plan(anchored: bool) -> None:
    env = _load("humanoid", "stand")
    env.reset()
    optimiser = ICEM(iterations=1, elites=0.5, kept=1.0)
    settings = Settings(
        samples=8, horizon=0.1, knots=4, anchored=anchored, timestep=0.0125, optimiser=optimiser
    )
    planner = Planner(env, num_threads=1, cost=_Towards(env.task), settings=settings)
    env.step(planner.act())
    before = planner._search.elites.copy() if planner._search else np.zeros(0)
    assert before.shape == (4, 4, 21)
    _, shifted = planner._shifted()
    if anchored:  # a control step is half a knot
        np.testing.assert_array_equal(shifted, before)
    else:  # and three quarters of one
        expected = 0.25 * before[:, :-1] + 0.75 * before[:, 1:]
        # Splines of splines: they round.
        np.testing.assert_allclose(shifted[:, :-1], expected, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(shifted[:, -1], before[:, -1])


def test_icem_lowers_the_cost_and_is_deterministic() -> None:
    found = []
    for threads in (1, 3):
        env = _load("humanoid", "stand")
        env.reset()
        settings = dataclasses.replace(_Towards.settings, optimiser=ICEM())
        planner = Planner(env, num_threads=threads, cost=_Towards(env.task), settings=settings)
        found.append(_actions(env, planner, 8))
        assert env.physics.named.data.qpos["abdomen_y"][0] > 0.3
    np.testing.assert_array_equal(found[0], found[1])


def test_the_plans_of_a_policy_are_an_eighth_of_the_samples_before_proposals() -> None:
    class Proposing(_Towards):
        settings = dataclasses.replace(_QUICK, samples=16, noise=1e-9)

        def proposals(self, physics: Any, random: np.random.Generator) -> np.ndarray:
            return np.full((1, 2, 21), 0.1)

    env = _load("humanoid", "stand")
    env.reset()
    planner = Planner(
        env, num_threads=1, cost=Proposing(None), policy=lambda observation: np.full(21, 0.2)
    )
    tried, costs = [], planner._costs

    def noting(saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        tried.append(samples)
        return costs(saved, samples)

    planner._costs = noting
    planner.act()
    (samples,) = tried
    moved = np.abs(samples - samples[0]).max(axis=(1, 2)) > 1e-6
    assert np.flatnonzero(moved).tolist() == [1, 2, 3]
    lowest = planner._law.within_limits(np.full(21, 0.1))
    np.testing.assert_array_equal(samples[3], [lowest] * 2)


def test_samples_that_diverge_or_cost_no_number_do_not_count() -> None:
    class Broken(_Towards):
        def step_cost(self, physics: Any) -> np.ndarray:
            cost = super().step_cost(physics)
            cost[1::2] = np.nan
            return cost

    env = _load("humanoid", "stand")
    env.reset()
    planner = Planner(env, num_threads=1, cost=Broken(env.task))
    assert np.isfinite(_actions(env, planner, 2)).all()
    assert np.isfinite(planner.explain().terms["cost"])


def test_what_is_no_environment_of_ours_is_refused() -> None:
    env: Any = gymnasium.make("limberjack/humanoid-stand-v0")
    with pytest.raises(TypeError, match=r"env is of type .*; expected a limberjack\.rl") as error:
        Planner(env)
    assert "which is env.unwrapped.environment here" in str(error.value)
    env.reset(seed=0)
    inner = env.unwrapped.environment
    action = Planner(inner, num_threads=1, settings=_small(inner)).act()
    assert env.action_space.contains(action.astype(np.float32))
    other: Any = object()
    with pytest.raises(TypeError, match=r"type object; expected a .*, as suite.load returns"):
        Planner(other)


def test_run_finds_the_planner_by_name() -> None:
    env = _load("humanoid", "stand", time_limit=0.1)
    episode = run_episode(env, policies.find("planner"), 5)
    again = _load("humanoid", "stand", time_limit=0.1)
    again.reset()
    planner = Planner(again, num_threads=1, seed=5)
    rewards = [again.step(planner.act()).reward for _ in range(4)]
    np.testing.assert_array_equal(episode.rewards, rewards)


def test_armature_is_that_of_the_plan_and_of_hinges_that_actuators_move() -> None:
    env = _load("stacker", "stack_2")
    before = env.physics.named.model.dof_armature[["arm_root", "thumbtip", "box0_y"]].copy()
    planner = Planner(env, num_threads=1, settings=_small(env))
    added = planner.settings.armature
    (rollouts,) = planner._rollouts.values()
    joints = rollouts.physics.named.model.dof_armature
    np.testing.assert_array_equal(joints[["arm_root", "thumbtip"]], before[:2] + added)
    np.testing.assert_array_equal(joints[["box0_x", "box0_z", "box0_y"]], before[2])
    unchanged = env.physics.named.model.dof_armature[["arm_root", "thumbtip", "box0_y"]]
    np.testing.assert_array_equal(unchanged, before)
    with pytest.raises(ValueError, match="armature is -1; expected a number from 0 up"):
        Settings(armature=-1)
