"""`sb3:PATH`, with a stand-in for the reader; evaluation/test_saved_models.py has real models."""

import os
from pathlib import Path

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.policies import saved
from limberjack.see.report import Step
from tests.policies import saved_models
from tests.rollouts import run_episode


@pytest.mark.parametrize(
    ("policy", "expected"),
    [("sb3:walk.zip", True), ("sb3:", True), ("sb3", False), ("module:act", False), (3, False)],
)
def test_a_saved_model_is_recognised_by_its_prefix(policy: object, expected: bool) -> None:
    assert saved.is_saved_model(policy) == expected


def test_a_saved_model_plays_a_single_environment_in_the_row_of_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    environment = suite.load("humanoid", "stand", {"random": 70, "time_limit": 0.1})
    actions: list[np.ndarray] = []

    def on_step(step: Step) -> None:
        if step.action is not None:
            actions.append(step.action)

    for given in (environment, None):  # checked now, or loaded as the episode begins
        policy = policies.find(name, given)
        run_episode(environment, policy, 70, on_step)
    np.testing.assert_array_equal(actions, np.full((8, 21), 0.5 * 6 / 64))


def test_a_model_that_does_not_fit_is_refused_before_or_as_an_episode_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    environment = suite.load("stacker", "stack_2")
    environment.reset()
    with pytest.raises(policies.PolicyError, match=r"policy 'sb3:.*model\.zip': the model's act"):
        policies.find(name, environment)
    with pytest.raises(policies.PolicyError, match="the model's actions have shape"):
        policies.find(name).begin_alone(environment, 0)


def test_a_file_that_is_not_there_is_one_error_that_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved_models.install(monkeypatch, tmp_path)
    with pytest.raises(policies.PolicyError, match=r"policy 'sb3:none\.zip': .*No such file"):
        policies.find("sb3:none.zip", suite.load("humanoid", "stand"))


def test_a_model_is_read_with_the_normalisation_beside_it_and_called_code(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    model, beside = tmp_path / "walk.v1.zip", tmp_path / "walk.v1.vecnormalize.pkl"
    model.write_bytes(b"1")
    name = f"sb3:{tmp_path}/walk.v1"  # as `save` names it without the ending
    assert saved.read_model(name) == {model: b"1"}
    assert [record.getMessage() for record in caplog.records] == [saved.RUNS_CODE % name]
    beside.write_bytes(b"2")
    assert saved.read_model(f"{name}.zip") == {model: b"1", beside: b"2"}
    with pytest.raises(policies.PolicyError, match=r"is a folder; expected the file that mo"):
        saved.read_model(f"sb3:{tmp_path}")


def test_without_stable_baselines3_the_error_says_what_is_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    saved_models.without_sb3(monkeypatch)
    with pytest.raises(policies.PolicyError, match=r"policy 'sb3:model\.zip': needs"):
        policies.find("sb3:model.zip", suite.load("humanoid", "stand"))


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_what_may_never_end_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "model.zip").write_text("")
    os.mkfifo(tmp_path / "model.vecnormalize.pkl")  # which is read beside the model
    os.mkfifo(tmp_path / "pipe")
    for name in ("/dev/zero", tmp_path / "pipe", tmp_path / "model.zip"):
        with pytest.raises(policies.PolicyError, match=r"policy 'sb3:.* is a (pipe|device); expec"):
            saved.read_model(f"sb3:{name}")
