"""dm_control's own test files pass here, with their import root renamed in memory."""

import unittest

import pytest

from . import shipped

pytestmark = pytest.mark.oracle

_FILES = [
    "suite.suite_test",
    "suite.loader_test",
    "rl.control_test",
    "suite.utils.randomizers_test",
    "utils.rewards_test",
    "utils.containers_test",
    "utils.xml_tools_test",
    "suite.wrappers.pixels_test",
    "suite.wrappers.action_scale_test",
    "suite.wrappers.action_noise_test",
    "mujoco.index_test",
    "mujoco.engine_test",
    "mujoco.wrapper.core_test",
    "mujoco.wrapper.mjbindings_test",
    "mujoco.thread_safety_test",
]
