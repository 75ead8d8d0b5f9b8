"""Parameters of the suite's models that faults perturb, beside models of changed files."""

from typing import Any
from xml.etree import ElementTree

import mujoco as official
import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.control import Environment
from limberjack.suite import _parameters, cartpole

_TASKS = {
    "cartpole": "swingup",
    "walker": "walk",
    "quadruped": "walk",
    "humanoid": "walk",
    "manipulator": "bring_ball",
}
# Start, lowest, highest and std of each alone, and the ranges of easy, medium and hard, in
# _setup_perturb and combined_challenge of the Real World RL suite.
_PUBLISHED = {
    ("cartpole", "pole_length"): (1, 0.3, 3, 0.3, (0.9, 1.1), (0.7, 1.7), (0.5, 2.3)),
    ("cartpole", "pole_mass"): (0.1, 0.1, 10, 0.5),
    ("cartpole", "joint_damping"): (2e-6, 2e-6, 0.2, 0.02),
    ("cartpole", "slider_damping"): (5e-4, 5e-4, 3, 0.3),
    ("walker", "thigh_length"): (
        *(0.225, 0.1, 0.7, 0.05, (0.225, 0.25), (0.225, 0.4), (0.225, 0.55)),
    ),
    ("walker", "torso_length"): (0.3, 0.1, 0.7, 0.05),
    ("walker", "joint_damping"): (0.1, 0.1, 10, 0.5),
    ("walker", "contact_friction"): (0.7, 0.01, 2, 0.05),
    ("quadruped", "shin_length"): (*(0.25, 0.25, 2, 0.1, (0.25, 0.3), (0.25, 0.8), (0.25, 1.4)),),
    ("quadruped", "torso_density"): (1000, 500, 10000, 500),
    ("quadruped", "joint_damping"): (30, 10, 150, 10),
    ("quadruped", "contact_friction"): (1.5, 0.1, 4.5, 0.5),
    ("humanoid", "contact_friction"): (0.7, 0.05, 1.2, 0.1, (0.6, 0.8), (0.5, 0.9), (0.4, 1.0)),
    ("humanoid", "joint_damping"): (0.2, 0.01, 2.5, 0.2),
    ("humanoid", "head_size"): (0.09, 0.01, 0.19, 0.02),
    ("manipulator", "lower_arm_length"): (
        *(0.12, 0.1, 0.25, 0.01, (0.1, 0.25), (0.1, 0.25), (0.1, 0.25)),
    ),
    ("manipulator", "root_damping"): (2, 0.1, 10, 0.1),
    ("manipulator", "shoulder_damping"): (1.5, 0.1, 10, 0.1),
}
_PARAMETERS = [(domain, _TASKS[domain], name) for domain, name in _PUBLISHED]


def test_figures_are_the_published_ones() -> None:
    ranges = {
        (domain, name): one
        for domain, task in _TASKS.items()
        for name, one in suite.load(domain, task).task.PERTURBATIONS.items()
    }
    assert ranges.keys() == _PUBLISHED.keys()
    for (domain, name), one in ranges.items():
        start, lowest, highest, std, *presets = _PUBLISHED[domain, name]
        assert one.start == start
        assert (one.range.lowest, one.range.highest, one.range.std) == (lowest, highest, std)
        found = [(range.lowest, range.highest) for range in one.presets.values()]
        assert found == presets


def _perturbed(domain: str, task: str, name: str, value: float, seed: int = 0) -> Any:
    perturbation = {"parameter": name, "schedule": "constant", "start": value}
    env = suite.load(domain, task, {"random": seed}, faults={"perturbation": perturbation})
    env.reset()
    assert env.randomization[name] == value
    return env


def _middle(domain: str, task: str, name: str) -> float:
    one = suite.load(domain, task).task.PERTURBATIONS[name]
    return (one.range.lowest + 2 * one.range.highest) / 3


@pytest.mark.parametrize(("domain", "task", "name"), _PARAMETERS)
def test_a_model_is_that_of_a_file_with_the_change(domain: str, task: str, name: str) -> None:
    value = _middle(domain, task, name)
    env = _perturbed(domain, task, name, value)
    mjcf, assets = suite.load(domain, task).physics.model._shared.mjcf
    root = ElementTree.fromstring(mjcf)
    env.task.PERTURBATIONS[name].edit(root, value)
    expected = official.MjModel.from_xml_string(ElementTree.tostring(root), assets)
    own = getattr(env.task, "EPISODE_FIELDS", ())
    found = env.physics.model._official
    for field in dir(expected):
        values = getattr(expected, field)
        if isinstance(values, np.ndarray) and not field.startswith("_") and field not in own:
            np.testing.assert_array_equal(getattr(found, field), values, field)


@pytest.mark.parametrize(("domain", "task", "name"), _PARAMETERS)
def test_a_perturbation_changes_the_trajectory(domain: str, task: str, name: str) -> None:
    env, plain = (
        _perturbed(domain, task, name, _middle(domain, task, name)),
        suite.load(domain, task, {"random": 0}),
    )
    plain.reset()
    # The same start, so that only the dynamics differ; the humanoid and the walker lie or fall.
    for one in (env, plain):
        spec = one.action_spec()
        draw = np.random.RandomState(0)
        for _ in range(30):
            one.step(draw.uniform(spec.minimum, spec.maximum))
    assert np.abs(env.physics.data.qpos - plain.physics.data.qpos).max() > 1e-6


def test_the_pole_is_that_of_a_changed_file_in_every_step() -> None:
    mjcf, assets = cartpole.get_model_and_assets()
    changed = mjcf.replace(b'fromto="0 0 0 0 0 1"', b'fromto="0 0 0 0 0 2"').replace(
        b'mass=".1"', b'mass="0.2"'
    )
    assert changed.count(b'fromto="0 0 0 0 0 2"') == changed.count(b'mass="0.2"') == 1
    physics = cartpole.Physics.from_xml_string(changed, assets)
    env = _perturbed("cartpole", "swingup", "pole_length", 2.0, seed=7)
    # The statistics of the nominal model, which scale the solver's tolerance.
    physics.model.ptr.stat.meaninertia = env.physics.model._official.stat.meaninertia
    other = Environment(physics, cartpole.Balance(True, False, 7), time_limit=10)
    other.reset()
    for action in np.random.RandomState(0).uniform(-1, 1, (300, 1)):
        found, expected = env.step(action), other.step(action)
        assert found.reward == expected.reward
        np.testing.assert_array_equal(env.physics.state(), other.physics.state())


def test_the_poles_of_a_chain_stay_joined() -> None:
    env = _perturbed("cartpole", "two_poles", "pole_length", 0.5)
    model = env.physics.model
    np.testing.assert_array_equal(model.body_pos[3], [0, 0, 0.5])
    assert (model.geom_size[-1] == model.geom_size[-2]).all()


def test_models_without_published_parameters_have_none() -> None:
    assert suite.load("humanoid_CMU", "walk").task.PERTURBATIONS == {}
    with pytest.raises(ValueError, match="HumanoidCMU has no parameter 'head_size' to perturb"):
        suite.load("humanoid_CMU", "walk", faults={"perturbation": {"parameter": "head_size"}})


def test_defaults_that_do_not_exist_are_named() -> None:
    root = ElementTree.fromstring("<mujoco><default><geom/></default></mujoco>")
    assert _parameters.default_of(root, None, "geom").tag == "geom"
    with pytest.raises(ValueError, match="no defaults of joint in class 'pole'"):
        _parameters.default_of(root, "pole", "joint")
