"""dm_control's own test files pass here, with their import root renamed in memory."""

import re
import unittest
from typing import Any

import pytest

from tests.representatives import FEATURES

from . import shipped
from .oracle import NO_RENDERING, ours

pytestmark = pytest.mark.oracle

_FILES = [
    "suite.suite_test",
    "suite.loader_test",
    "suite.lqr_test",
    "rl.control_test",
    "suite.utils.parse_amc_test",
    "suite.utils.randomizers_test",
    "utils.rewards_test",
    "utils.containers_test",
    "utils.inverse_kinematics_test",
    "utils.transformations_test",
    "utils.xml_tools_test",
    "suite.wrappers.pixels_test",
    "suite.wrappers.action_scale_test",
    "suite.wrappers.action_noise_test",
    "mujoco.engine_test",
    "mujoco.wrapper.core_test",
    "mujoco.wrapper.mjbindings_test",
    "mujoco.thread_safety_test",
]

# Cases that cannot pass, and why. One that would pass is an error here, so that the list shrinks
# as domains are built.
_MESSAGE = (
    "looks up the text of a message under a private name of dm_control; test_physics.py, "
    "test_model_and_data.py and test_frames.py compare these errors"
)
_CONTEXT = "makes a wrapper.MjrContext; here OpenGL contexts are the renderer's own"
_NO_SIZES = "there is no table of sizes: MuJoCo's struct fields are never enumerated eagerly"


def _listed(reason: str, case: str, *methods: str) -> dict[str, str]:
    return {f"{case}.{method}": reason for method in methods}


_CANNOT_PASS = {
    **_listed(
        "its model uses <composite>, which MuJoCo 4.0 removed; dm_control fails too",
        "mujoco.engine_test::MujocoEngineTest",
        "testSetGetPhysicsStateWithPlugin",
    ),
    **_listed(
        _MESSAGE,
        "mujoco.engine_test::MujocoEngineTest",
        *(f"testDivergenceException{warning}" for warning in range(7)),
        "testNanControl",
        "testReset",
        "testSuppressPhysicsError",
        "testExceptionIfBothDepthAndSegmentation",
        "testExceptionIfOverlaysAndDepthOrSegmentation",
        "testExceptionIfRenderFlagOverridesAndDepthOrSegmentation0",
        "testExceptionIfRenderFlagOverridesAndDepthOrSegmentation1",
    ),
    **_listed(
        _MESSAGE,
        "mujoco.wrapper.core_test::CoreTest",
        "testContactForce",
        "testSaveLastParsedModelToXML",
    ),
    **_listed(
        _CONTEXT,
        "mujoco.wrapper.core_test::CoreTest",
        "testFreeMjrContext",
        "testInvalidFontScale",
    ),
    **_listed(
        _NO_SIZES,
        "mujoco.wrapper.mjbindings_test::MjbindingsTest",
        *(f"testIndexDict{index}" for index in range(4)),
    ),
}

# Files that cannot even be imported.
_CANNOT_LOAD = {
    "mujoco.index_test": (
        "calls index.make_axis_indexers and index.struct_indexer, which read every field of "
        "MuJoCo's structs; test_named.py compares what they make"
    ),
}

_CASES = {
    f"{file}::{name}": case for file in _FILES for name, case in shipped.load_cases(file).items()
}


def _number(name: str) -> int:
    """The number at the end of a case's name; in suite_test, that of its task."""
    digits = re.search(r"\d*$", name)
    return int(digits[0]) if digits and digits[0] else -1


# Plays a thousand steps of each task and more. Observations are dm_control's, bit for bit, in all
# tasks (test_episodes.py), so that the case of a task says little of its own.
_LONG = "SuiteTest.test_observations_dont_contain_constant_elements"
# Height fields make the steps of quadruped escape ten times as long as others.
_PLAYED_LONG = set(FEATURES.values()) - {("quadruped", "escape")}


def _parameter(name: str) -> Any:
    # A thousand cases that read and write MuJoCo's own fields, one by one.
    is_slow = "::AttributesTest." in name
    if _LONG in name:
        is_slow = ours("suite").ALL_TASKS[_number(name)] not in _PLAYED_LONG
    return pytest.param(name, id=name, marks=[pytest.mark.slow] if is_slow else [])


# The cases of a task one after the other: its model is then compiled once.
@pytest.mark.parametrize("name", [_parameter(name) for name in sorted(_CASES, key=_number)])
def test_case(name: str) -> None:
    case: unittest.TestCase = _CASES[name]
    failure = shipped.run_case(case)
    if NO_RENDERING and "RenderingError" in failure:
        pytest.skip("MUJOCO_GL turns rendering off")
    if name not in _CANNOT_PASS:
        assert not failure, failure
        return
    assert failure, f"{name} passes: take it off the list"
    pytest.skip(_CANNOT_PASS[name])


def test_every_listed_case_exists() -> None:
    assert set(_CANNOT_PASS) <= set(_CASES)


@pytest.mark.parametrize("file", _CANNOT_LOAD)
def test_a_file_that_cannot_be_loaded_is_listed_rightly(file: str) -> None:
    with pytest.raises(AttributeError):
        shipped.load_cases(file)
    pytest.skip(_CANNOT_LOAD[file])
