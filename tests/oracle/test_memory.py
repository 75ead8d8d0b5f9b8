"""The memory that comparisons with dm_control leave in use."""

import sys

import pytest

from tests import memory

from .oracle import theirs
from .shipped import load_cases, run_case

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

_MOST = 40.0  # megabytes


def _in_use() -> float:
    memory.free_what_nobody_uses()
    return memory.resident()


def test_the_largest_model_leaves_little() -> None:
    # A small model, so that all that loading imports is there before.
    theirs("suite").load("cartpole", "balance")
    before = _in_use()
    theirs("suite").load("dog", "stand")
    assert _in_use() - before < _MOST


def test_a_case_of_dm_control_keeps_nothing_that_its_set_up_made() -> None:
    case = load_cases("mujoco.engine_test")["MujocoEngineTest.testActionSpec"]
    before = set(vars(case))
    assert not run_case(case)
    assert set(vars(case)) == before
