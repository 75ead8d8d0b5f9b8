"""A viewer's effects on an environment, with a clock that the tests set."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies, suite, viewer
from limberjack.rl.control import Environment, PhysicsError
from limberjack.suite import base
from limberjack.viewer.session import Session, idle
from tests.clocks import Clock
from tests.rollouts import run_episode

_INTERVAL = 0.025  # seconds; the humanoid's control step
_LIMIT = 0.25  # seconds; ten steps
_BEGINS = {"none": idle, "random": viewer.begin_with("random")}


@pytest.fixture
def clock() -> Clock:
    return Clock()


def _load(task: str = "stand", domain: str = "humanoid", time_limit: float = _LIMIT) -> Any:
    return suite.load(domain, task, task_kwargs={"random": 0, "time_limit": time_limit})


def _advance(session: Session, clock: Clock, seconds: float) -> bool:
    clock.now += seconds
    return session.advance()


def test_what_is_viewed_is_what_run_plays() -> None:
    session = Session(_load(), {"policy": viewer.begin_with("random")}, seed=5)
    for seed in (5, 6, 7):
        played = run_episode(
            suite.load("humanoid", "stand", task_kwargs={"random": seed, "time_limit": _LIMIT}),
            policies.random,
            seed,
        )
        rewards = []
        for _ in range(10):
            session.step()
            rewards.append(session.status().reward)
        np.testing.assert_array_equal(rewards, played.rewards)
        status = session.status()
        assert (status.seed, status.episode, status.start) == (seed, seed - 4, played.start)
        assert (status.step, status.total) == (10, pytest.approx(played.total))
        session.step()  # begins the next


def test_without_a_seed_the_environment_s_random_stream_goes_on() -> None:
    reference, environment = _load(), _load()
    session = Session(environment)
    for _ in range(3):
        reference.reset()
        np.testing.assert_array_equal(environment.physics.position(), reference.physics.position())
        assert session.status().seed is None
        session.reset()


def test_steps_are_taken_when_they_are_due(clock: Clock) -> None:
    session = Session(_load(), clock=clock)
    assert not _advance(session, clock, 0.6 * _INTERVAL)
    assert _advance(session, clock, 0.6 * _INTERVAL)  # the rest is kept
    assert session.status().step == 1
    assert _advance(session, clock, 0.8 * _INTERVAL)
    assert session.status().step == 2
    assert session.status().time == 2 * _INTERVAL


@pytest.mark.parametrize(("speed", "steps"), [(0.5, 1), (1.0, 2), (2.0, 4)])
def test_speed_is_simulated_time_per_time(clock: Clock, speed: float, steps: int) -> None:
    session = Session(_load(), speed=speed, clock=clock)
    _advance(session, clock, 2 * _INTERVAL)
    assert session.status().step == steps


def test_lost_time_is_not_caught_up(clock: Clock) -> None:
    session = Session(_load(time_limit=10), clock=clock)
    _advance(session, clock, 60.0)
    assert session.status().step == 4  # a tenth of a second


def test_a_slow_policy_does_not_keep_the_viewer_waiting(clock: Clock) -> None:
    def begin(environment: Any, seed: int) -> Callable[[Any], np.ndarray]:
        def act(time_step: Any) -> np.ndarray:
            clock.now += 1.0
            return np.zeros(21)

        return act

    session = Session(_load(), {"policy": begin}, clock=clock)
    for steps in (1, 2, 3):
        assert _advance(session, clock, _INTERVAL)
        assert session.status().step == steps


def test_pausing_stops_the_clock_and_going_on_does_not_catch_up(clock: Clock) -> None:
    session = Session(_load(), clock=clock)
    session.pause()
    assert session.status().paused
    assert not _advance(session, clock, 1.0)
    assert session.status().step == 0
    session.step()
    assert session.status().step == 1
    session.pause(False)
    assert not _advance(session, clock, 0.5 * _INTERVAL)
    assert session.status().step == 1


def test_an_episode_ends_at_its_limit_and_the_next_begins(clock: Clock) -> None:
    session = Session(_load(), seed=3, clock=clock)
    for _ in range(10):
        _advance(session, clock, _INTERVAL)
    assert (session.status().episode, session.status().step) == (1, 10)
    assert session.status().step_limit == 10
    _advance(session, clock, _INTERVAL)
    status = session.status()
    assert (status.episode, status.step, status.seed, status.reward) == (2, 0, 4, None)


def test_reset_begins_an_episode_with_a_new_seed_paused_or_not() -> None:
    session = Session(_load(), seed=2**32 - 1)
    session.pause()
    session.step()
    before = session.data.qpos.copy()
    session.reset()
    status = session.status()
    assert (status.episode, status.step, status.seed, status.paused) == (2, 0, 0, True)
    assert not np.array_equal(session.data.qpos, before)


def test_a_push_moves_the_body_and_changes_nothing_but_forces() -> None:
    pushed, alone = _load(), _load()
    session, reference = Session(pushed, seed=0), Session(alone, seed=0)
    body = 1  # the torso
    forces = np.zeros((pushed.physics.model.nbody, 6))
    forces[body, 0] = 500.0  # N
    session.push(forces)
    for one in (session, reference):
        one.step()
    assert session.data.qvel[0] > reference.data.qvel[0] + 0.1  # along x
    # The step was that of the forces, no more: it can be repeated by hand.
    repeated = _load()
    repeated.reseed(0)
    repeated.reset()
    repeated.physics.data.xfrc_applied[:] = forces
    repeated.step(np.zeros(21))
    np.testing.assert_array_equal(session.data.qpos, repeated.physics.data.qpos)
    np.testing.assert_array_equal(
        session.model.body_mass, repeated.physics.model._official.body_mass
    )


def test_a_released_body_is_pushed_no_more_and_the_others_never_were() -> None:
    environment = _load()
    session = Session(environment)
    mine, theirs = 1, 2
    environment.physics.data.xfrc_applied[theirs, 2] = 3.0  # as a task may
    forces = np.zeros((environment.physics.model.nbody, 6))
    forces[mine, 0] = 5.0
    session.push(forces)
    session.step()
    assert session.data.xfrc_applied[mine, 0] == 5.0
    session.push(np.zeros_like(forces))
    session.step()
    assert not session.data.xfrc_applied[mine].any()
    assert session.data.xfrc_applied[theirs, 2] == 3.0


def test_without_pushes_an_episode_after_one_is_what_it_would_have_been() -> None:
    session, reference = Session(_load(), seed=0), Session(_load(), seed=1)
    forces = np.full((session.model.nbody, 6), 50.0)
    session.push(forces)
    session.step()
    session.push(np.zeros_like(forces))
    session.reset()
    for _ in range(10):
        session.step()
        reference.step()
        np.testing.assert_array_equal(session.data.qpos, reference.data.qpos)


@pytest.mark.parametrize(
    ("forces", "message"),
    [(np.zeros((3, 6)), r"shape \(3, 6\); expected \(17, 6\)"), (np.full((17, 6), np.nan), "NaN")],
)
def test_a_bad_push_is_refused(forces: np.ndarray, message: str) -> None:
    session = Session(_load())
    with pytest.raises(ValueError, match=message):
        session.push(forces)
    session.step()
    assert not session.data.xfrc_applied.any()


def test_a_diverged_simulation_ends_its_episode() -> None:
    session = Session(_load(), seed=0)
    session.push(np.full((session.model.nbody, 6), 1e12))
    session.step()
    status = session.status()
    assert "episode 1 ended early" in status.note
    session.push(np.zeros((session.model.nbody, 6)))
    session.step()
    status = session.status()
    assert (status.episode, status.step, status.seed) == (2, 0, 1)
    assert "episode 1 ended early" in status.note
    session.step()
    assert np.isfinite(session.data.qpos).all()
    session.reset()
    assert session.status().note == ""


def test_errors_of_a_policy_are_its_user_s() -> None:
    session = Session(_load(), {"policy": viewer.begin_with(lambda time_step: np.zeros(3))})
    with pytest.raises(ValueError, match=r"action has shape \(3,\)"):
        session.step()
    with pytest.raises(policies.PolicyError, match="there is no module"):
        viewer.begin_with("nowhere:policy")
    with pytest.raises(TypeError, match="expected a function"):
        viewer.begin_with(3)  # pyright: ignore[reportArgumentType]


def test_a_policy_of_time_steps_is_told_of_each_start() -> None:
    class Policy:
        resets = 0

        def reset(self) -> None:
            self.resets += 1

        def __call__(self, time_step: Any) -> np.ndarray:
            assert time_step.observation["velocity"].shape == (27,)
            return np.ones(21)

    policy = Policy()
    session = Session(_load(), {"policy": viewer.begin_with(policy)})
    for _ in range(11):
        session.step()
    assert policy.resets == 2
    session.step()
    np.testing.assert_array_equal(session.data.ctrl, np.ones(21))


def test_without_a_policy_the_actions_are_in_the_middle() -> None:
    environment = _load("bring_ball", "manipulator")
    act = idle(environment, 0)
    spec = environment.action_spec()
    spec.validate(act(environment.reset()))
    np.testing.assert_array_equal(act(environment.reset()), 0.5 * (spec.minimum + spec.maximum))


def test_the_status_has_the_terms_of_the_reward() -> None:
    environment = _load()
    session = Session(environment)
    session.step()
    status = session.status()
    assert dict(status.terms) == environment.task.reward_terms(environment.physics)
    assert status.reward == environment.task.reward_of(status.terms)
    assert status.success is False


def test_what_cannot_be_viewed_is_refused() -> None:
    with pytest.raises(TypeError, match="has no MuJoCo simulation to show"):
        Session(object())
    with pytest.raises(TypeError, match="has no MuJoCo simulation to show"):
        Session(suite.load_batch("humanoid", "stand", num_envs=2, seed=0))
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="expected a positive number"):
            Session(_load(), speed=speed)
    with pytest.raises(ValueError, match="expected a whole number from 0 to"):
        Session(_load(), seed=-1)
    session = Session(_load())
    with pytest.raises(ValueError, match="expected a positive number"):
        session.set_speed(0.0)
    assert session.speed == 1.0


def test_an_environment_without_reseed_is_viewed_without_a_seed() -> None:
    class Bare:
        """The attributes that other libraries' environments have."""

        def __init__(self) -> None:
            inner = _load()
            self.physics, self.reset, self.step = inner.physics, inner.reset, inner.step
            self.action_spec, self.control_timestep = inner.action_spec, inner.control_timestep

    session = Session(Bare())
    for _ in range(11):
        session.step()
    status = session.status()
    assert (status.episode, status.seed, status.terms, status.success) == (2, None, {}, None)
    with pytest.raises(ValueError, match="Bare has no method reseed"):
        Session(Bare(), seed=0)


def test_a_start_that_fails_is_not_stepped_from() -> None:
    environment = _load()
    session = Session(environment, seed=0)
    starts = environment.task.initialize_episode

    def fail(physics: Any) -> None:
        raise PhysicsError("no start")

    environment.task.initialize_episode = fail
    with pytest.raises(PhysicsError, match="no start"):
        session.reset()
    environment.task.initialize_episode = starts
    session.step()
    assert (session.status().step, session.status().reward) == (0, None)


def test_the_planner_can_be_viewed() -> None:
    begins = {"planner": viewer.begin_with("planner")}
    session = Session(_load("bring_ball", "manipulator"), begins, seed=0)
    for _ in range(2):
        session.step()
        session.reset()
    session.step()
    assert (session.status().episode, session.status().step) == (3, 1)
    assert session.data.ctrl.any()


def test_the_plans_of_the_planner_are_part_of_the_status() -> None:
    plans = viewer.Plans()
    environment = suite.load("stacker", "stack_2", {"random": 0, "time_limit": 0.05})
    session = Session(environment, {"planner": plans.begin_with(environment)}, 3, plan=plans.last)
    assert session.status().plan is None
    session.step()
    plan = session.status().plan
    assert plan is not None
    assert plan.stage
    assert "reward" in plan.terms
    for _ in range(3):  # control steps to the next planning step
        session.step()
    assert session.status().plan != plan
    session.reset()
    assert session.status().plan is None  # it belonged to the episode before


def test_a_chosen_seed_begins_its_episode_and_the_next_follow() -> None:
    session = Session(_load(), seed=0)
    session.reset()
    session.begin(40)
    chosen = session.data.qpos.copy()
    assert session.status().seed == 40
    session.reset()
    assert session.status().seed == 41
    np.testing.assert_array_equal(chosen, Session(_load(), seed=40).data.qpos)
    with pytest.raises(ValueError, match="no seeds to choose"):
        Session(_load()).begin(1)
    with pytest.raises(ValueError, match="seed"):
        session.begin(-1)
    assert session.status().seed == 41


def test_the_next_start_of_a_kind_is_that_of_its_seed() -> None:
    session = Session(_load("swimmer6", "swimmer"), seed=0)
    kinds = [session.status().start]
    for kind in ("far", "close", "far"):
        before = session.status()
        session.begin_kind(kind)
        status = session.status()
        assert (status.start, status.episode) == (kind, before.episode + 1)
        assert status.seed is not None
        assert status.seed > (before.seed or 0)
        again = Session(_load("swimmer6", "swimmer"), seed=status.seed)
        assert again.status().start == kind
        kinds.append(kind)
    with pytest.raises(ValueError, match="no kind of start is 'nowhere'"):
        session.begin_kind("nowhere")


def test_the_episode_after_a_vain_search_for_a_start_is_the_next_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("limberjack.viewer.session._MOST_STARTS", 3)
    monkeypatch.setattr(Session, "kinds", ("nowhere",))
    session = Session(_load("swimmer6", "swimmer"), seed=3)
    with pytest.raises(ValueError, match="none of 3 starts was of the kind 'nowhere'"):
        session.begin_kind("nowhere")
    assert (session.status().episode, session.status().seed) == (2, 6)
    session.reset()
    assert (session.status().episode, session.status().seed) == (3, 7)


def test_a_policy_is_switched_within_an_episode_and_goes_on_in_the_next() -> None:
    session = Session(_load(), seed=2, policies=_BEGINS)
    assert session.policies == ("none", "random")
    session.step()
    assert not session.data.ctrl.any()
    session.choose("random")
    assert (session.status().step, session.status().episode) == (1, 1)
    session.step()
    assert session.data.ctrl.any()
    session.reset()
    assert session.status().policy == "random"
    with pytest.raises(ValueError, match="no policy is 'planner'"):
        session.choose("planner")


def test_a_policy_that_cannot_act_leaves_the_one_before() -> None:
    def fail(environment: Any, seed: int) -> Any:
        raise policies.PolicyError("it does not fit")

    session = Session(
        _load(), seed=2, policies={"random": viewer.begin_with("random"), "bad": fail}
    )
    session.choose("bad")
    status = session.status()
    assert (status.policy, status.note) == ("random", "it does not fit")
    session.step()
    assert session.status().step == 1


class _Unlimited(base.Task):
    def get_observation(self, physics: Any) -> Any:
        return {"qpos": physics.position()}

    def get_reward(self, physics: Any) -> Any:
        return 0.0

    def action_spec(self, physics: Any) -> Any:
        return specs.BoundedArray((1,), float, -np.inf, np.inf)


def test_without_a_policy_actions_without_bounds_are_zeros() -> None:
    physics = _load(domain="pendulum", task="swingup").physics
    session = Session(Environment(physics, _Unlimited(random=0)))
    session.step()
    assert session.status().action == (0.0,)


class _Tiring(base.Task):
    """Rewards less with each call."""

    calls = 0

    def get_observation(self, physics: Any) -> Any:
        return {"qpos": physics.position()}

    def reward_terms(self, physics: Any) -> Any:
        self.calls += 1
        return {"left": 1 / self.calls}


def test_a_status_leaves_no_trace_in_the_task() -> None:
    task = _Tiring(random=0)
    session = Session(Environment(_load(domain="pendulum", task="swingup").physics, task))
    for _ in range(2):
        session.step()
        assert session.status().terms == session.status().terms
    assert session.status().total == 1 + 1 / 2


def test_an_error_as_a_policy_begins_is_raised_and_the_one_before_acts_on() -> None:
    def fail(environment: Any, seed: int) -> Any:
        raise ValueError("no weights")

    session = Session(_load(), seed=2, policies={"none": idle, "bad": fail})
    with pytest.raises(ValueError, match="no weights"):
        session.choose("bad")
    assert session.status().policy == "none"


def test_choosing_a_policy_after_the_end_begins_no_episode_by_half() -> None:
    session = Session(_load(), seed=2, policies=_BEGINS)
    for _ in range(10):
        session.step()
    session.choose("random")
    session.step()
    assert (session.status().episode, session.status().step) == (2, 0)


def test_an_action_by_hand_acts_until_a_policy_is_chosen() -> None:
    session = Session(_load("swimmer6", "swimmer"), seed=0, policies=_BEGINS)
    names = [actuator.name for actuator in session.actuators()]
    assert len(set(names)) == 5
    given = np.array([0.1, 0.2, -0.3, 0.4, 0.5])
    session.set_action(given)
    given[:] = 0
    session.step()
    np.testing.assert_array_equal(session.data.ctrl, [0.1, 0.2, -0.3, 0.4, 0.5])
    for bad in (np.zeros(4), np.full(5, np.nan)):
        with pytest.raises(ValueError, match="expected finite numbers"):
            session.set_action(bad)
    assert session.status().action == (0.1, 0.2, -0.3, 0.4, 0.5)
    session.choose("random")
    session.step()
    assert session.data.ctrl[0] != 0.1
    assert session.status().action == ()


def test_an_action_by_hand_is_whole_where_actions_are() -> None:
    environment = _load("swingup", "cartpole")
    environment.task.action_spec = lambda physics: specs.BoundedArray((1,), int, -1, 1)
    session = Session(environment, seed=0)
    session.set_action(np.array([0.7]))
    action = session._chosen_action()
    assert (action, getattr(action, "dtype", None)) == (1, int)


def test_nested_actions_need_a_policy_and_have_no_sliders() -> None:
    environment = _load("swingup", "cartpole")
    environment.task.action_spec = lambda physics: [specs.BoundedArray((1,), float, -1, 1)]
    environment.task.before_step = lambda action, physics: physics.set_control(action[0])
    begins = viewer.offered(environment, [lambda time_step: [np.ones(1)]])
    assert list(begins) == ["policy", "none"]
    session = Session(environment, seed=0, policies=begins)
    session.step()
    assert session.data.ctrl.tolist() == [1.0]
    assert session.actuators() == ()
    session.choose("none")
    assert "needs actions in one bounded array" in session.status().note
    assert session.status().policy == "policy"


def test_weights_of_the_planner_last_over_episodes() -> None:
    plans = viewer.Plans()
    with pytest.raises(ValueError, match="no planner acts"):
        plans.weigh("distance", 1.0)
    environment = _load("hard", "reacher")
    session = Session(environment, {"planner": plans.begin_with(environment)}, 0, plan=plans.last)
    session.step()
    plan = session.status().plan
    assert plan is not None
    assert plan.weights["distance"] == 4.0
    plans.weigh("distance", 0.0)
    for _ in range(2):
        session.reset()
        session.step()
        plan = session.status().plan
        assert plan is not None
        assert plan.terms["distance"] == 0.0
    with pytest.raises(ValueError, match="weight of 'distance' is -1"):
        plans.weigh("distance", -1)
    with pytest.raises(ValueError, match="what is terminal has no weight"):
        plans.weigh("terminal", 2.0)
    session.step()  # goes on


def test_the_plan_of_a_policy_is_not_shown_with_another_one() -> None:
    plans, environment = viewer.Plans(), _load("hard", "reacher")
    policies = {"planner": plans.begin_with(environment), "none": idle}
    session = Session(environment, seed=0, plan=plans.last, policies=policies)
    session.step()
    assert session.status().plan is not None
    session.choose("none")
    for act in (session.step, session.reset, session.step):
        assert session.status().plan is None
        act()
    session.choose("planner")
    session.step()
    assert session.status().plan is not None


def test_the_policies_on_offer_are_those_named_and_the_built_in_ones_that_fit() -> None:
    environment = _load("swimmer6", "swimmer")
    found = viewer.offered(environment, ["random"])
    assert list(found) == ["random", "none", "zero", "planner"]  # no bundled policy
    with pytest.raises(policies.PolicyError, match="pretrained"):
        viewer.offered(environment, ["pretrained"])


def test_an_action_that_is_repeated_takes_its_time(clock: Clock) -> None:
    environment = _load()
    environment.action_repeat = 4
    session = Session(environment, clock=clock)
    assert not _advance(session, clock, 3 * _INTERVAL)
    assert _advance(session, clock, _INTERVAL)
    status = session.status()
    assert (status.step, status.step_limit, status.time) == (1, 3, 4 * _INTERVAL)
    assert session.data.time == pytest.approx(4 * _INTERVAL)
