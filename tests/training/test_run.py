"""Runs that are killed and continued, refused, or reported."""

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.policies import mlp
from limberjack.training import Run, Settings, TrainingError, train
from limberjack.training import run as run_module
from tests.training.small import SMALL, make, remembering

_REASON = "needs the extra 'train'"
pytest.importorskip("sbx", reason=_REASON)


class _Killed(Exception):
    """Raised in the place of a kill."""


def _pendulum(out: Path, **kwargs: Any) -> Run:
    return train("pendulum", "swingup", **{"out": out, "settings": SMALL, **kwargs})


def _killed_at(step: int) -> Callable[[int, int, float], None]:
    def kill(control_steps: int, steps: int, mean: float) -> None:
        if control_steps >= step:
            raise _Killed

    return kill


def _without_times(run: Run) -> list[tuple[int, int, tuple[float, ...]]]:
    return [(one.control_steps, one.agent_steps, one.returns) for one in run.curve]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return _pendulum(tmp_path_factory.mktemp("undisturbed"))


def test_a_run_leaves_one_policy_its_curve_and_events(undisturbed: Run) -> None:
    folder = undisturbed.policy.parent
    assert sorted(path.name for path in folder.iterdir()) == [
        *("curve.csv", "policy.safetensors", "tensorboard", "training.json"),
    ]
    assert list((folder / "tensorboard").iterdir())
    first, *_, last = undisturbed.curve
    assert (first.control_steps, last.control_steps) == (0, 1200)
    assert len(undisturbed.curve) == 21
    assert undisturbed.settings == SMALL
    lines = (folder / "curve.csv").read_text().splitlines()
    assert lines[0].startswith("control_steps,agent_steps,processor_seconds,mean,return_1,")
    assert len(lines) == 22


def test_a_killed_run_continues_bit_for_bit(
    undisturbed: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "_PATIENCE", 0.05)  # checkpoints between evaluations too
    kills = sorted(np.random.RandomState(0).randint(6, 1200, size=10).tolist())
    for step in kills:
        with pytest.raises(_Killed):
            _pendulum(tmp_path, on_progress=_killed_at(step))
    run = _pendulum(tmp_path)
    assert not run.was_finished
    assert _without_times(run) == _without_times(undisturbed)
    assert run.policy.read_bytes() == undisturbed.policy.read_bytes()
