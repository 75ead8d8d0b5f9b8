"""Plans of a policy's own."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.planner import Planner, Settings, cost_for
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.policy_plans import PolicyPlans, _spline_of
from limberjack.planner.spline import knot_weights
from limberjack.rl.control import Environment

_SETTINGS = Settings(samples=16, horizon=0.2, knots=9, gain=2.5, damping=0.05)


def _env(flat: bool = False, **options: Any) -> Environment:
    env = suite.load(
        "walker",
        "walk",
        {"random": 3},
        environment_kwargs={"flat_observation": flat, **options},
    )
    env.reset()
    return env


def _wave(observation: Any) -> np.ndarray:
    """A policy: smooth in the observation, so that its plan is a smooth spline."""
    return 0.5 * np.tanh(observation["orientations"][:6] + 0.1 * observation["velocity"][3:])


def test_the_first_plan_is_what_the_policy_would_do() -> None:
    env = _env()
    law = ControlLaw(env.physics.model._official, _SETTINGS)
    phases = np.arange(8.0)  # a knot at each control step
    plans = PolicyPlans(env, _wave, law, _SETTINGS).from_state(
        env.physics.copy(), phases, 3, np.random.default_rng(0)
    )
    assert plans.shape == (3, 9, 6)
    time_step = env.step(np.zeros(6))
    env = _env()
    observation = env.present_observation()
    for step in range(8):
        physics, wanted = env.physics, _wave(observation)
        found = law.controls(plans[0, step], physics.position(), physics.velocity())
        # The law inverted, and a spline fitted: they round.
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
        time_step = env.step(wanted)
        observation = time_step.observation
    spread = np.abs(plans[1:] - plans[0]).max()
    assert 0.0 < spread < 2.0


def test_a_policy_reads_flat_observations_of_a_flat_environment() -> None:
    seen = []

    def act(observation: Any) -> np.ndarray:
        seen.append(observation)
        return np.zeros(6)

    env = _env(flat=True)
    Planner(env, num_threads=1, settings=_SETTINGS, policy=act).act()
    assert [list(one) for one in seen] == [["observations"]] * 8
    np.testing.assert_array_equal(
        seen[0]["observations"], env.present_observation()["observations"]
    )


def test_the_plans_of_a_policy_are_among_the_samples_and_can_win() -> None:
    env = _env()
    settings = dataclasses.replace(_SETTINGS, noise=1e-6)  # nothing else goes anywhere
    policy = policies.find("pretrained", env)
    planner = Planner(env, num_threads=1, settings=settings, policy=policy)
    tried, costs = [], planner._costs

    def noting(saved: dict[str, np.ndarray], samples: np.ndarray) -> np.ndarray:
        tried.append((samples, costs(saved, samples)))
        return tried[-1][1]

    planner._costs = noting
    for _ in range(25):
        env.step(planner.act())
    # An eighth of 16 samples, after the current plan; the variations follow, by a noise of 1e-6.
    samples, _ = tried[0]
    assert np.abs(samples[1] - samples[0]).max() > 0.1
    np.testing.assert_allclose(samples[2:], samples[[1] + [0] * 13], rtol=0, atol=1e-4)
    won = [int(np.argmin(found)) in (1, 2) for _, found in tried]
    assert won[0]
    assert sum(won) > 4  # else mostly the current plan, which is the policy's of before


def test_a_policy_lets_a_short_search_play() -> None:
    returns = {}
    for policy in (None, "pretrained"):
        env = _env()
        settings = dataclasses.replace(
            cost_for(env.task).settings, samples=8, horizon=0.15, interval=2
        )
        found = policies.find(policy, env) if policy else None
        planner = Planner(env, num_threads=1, settings=settings, policy=found)
        returns[policy] = sum(env.step(planner.act()).reward or 0.0 for _ in range(60))
    assert returns["pretrained"] > returns[None] + 10


def test_the_environment_and_the_stream_of_the_episode_stay_as_they_are() -> None:
    env, twin = _env(), _env()
    planner = Planner(env, num_threads=1, settings=_SETTINGS, policy=_wave)
    for _ in range(3):
        action = planner.act()
        ours, theirs = env.step(action), twin.step(action)
        assert ours.reward == theirs.reward
        np.testing.assert_array_equal(ours.observation["height"], theirs.observation["height"])


def test_a_policy_that_makes_the_simulation_diverge_has_no_plans() -> None:
    env = _env()
    law = ControlLaw(env.physics.model._official, _SETTINGS)
    physics = env.physics.copy()
    physics.data.qvel[:] = 1e12
    plans = PolicyPlans(env, _wave, law, _SETTINGS)
    found = plans.from_state(physics, np.arange(8.0), 3, np.random.default_rng(0))
    assert found.shape == (0, 9, 6)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (np.zeros(5), r"the policy returned array\(.*expected finite numbers of shape \(6,\)"),
        (np.full(6, np.nan), "expected finite numbers"),
    ],
)
def test_what_is_no_action_is_named(returned: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Planner(
            _env(), num_threads=1, settings=_SETTINGS, policy=lambda observation: returned
        ).act()


def test_a_policy_of_pictures_is_refused() -> None:
    env = suite.load("walker", "walk", {"random": 0}, environment_kwargs={"pixels": {"height": 8}})
    with pytest.raises(ValueError, match="the environment observes pictures"):
        Planner(env, settings=_SETTINGS, policy=_wave)


def test_a_policy_is_refused_beside_faults_which_a_plan_does_not_simulate() -> None:
    settings = {"num_threads": 1, "settings": _SETTINGS, "policy": _wave}
    with pytest.raises(ValueError, match="the environment has faults, which a plan does not sim"):
        Planner(suite.load("walker", "walk", faults="easy"), **settings)
    Planner(suite.load("walker", "walk", appearance={"colors": "easy"}), **settings)


def test_the_closest_spline_goes_through_targets_that_lie_on_one() -> None:
    knots, phases = np.random.default_rng(0).normal(size=(4, 2)), np.linspace(0.0, 3.0, 13)
    found = _spline_of(knot_weights(4, phases) @ knots, phases, 4)
    np.testing.assert_allclose(found, knots, rtol=0, atol=1e-12)  # least squares round
    # A knot that no phase reaches holds the nearest target; least squares round.
    found = _spline_of(np.array([[1.0], [3.0]]), np.array([0.0, 1.0]), 4)
    np.testing.assert_allclose(found[:, 0], [1.0, 3.0, 3.0, 3.0], rtol=0, atol=1e-12)
