"""`limberjack train`: messages and exit statuses."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from limberjack.training import TrainingError
from limberjack.utils.requirements import install_command

from .conftest import invoke

needs_the_extra = pytest.mark.skipif(
    importlib.util.find_spec("sbx") is None, reason="needs the extra 'train'"
)
_PATIENCE = 540  # seconds
_SMALL = """
steps = 1200
time_limit = 0.4
num_envs = 3
random_steps = 60
updates = 1.0
batch_size = 16
actor = [16, 16]
critic = [16]
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A file of settings with which a run takes a second."""
    path = tmp_path / "small.toml"
    path.write_text(_SMALL)
    return path


def _call(*arguments: str) -> "subprocess.CompletedProcess[str]":
    """The result of a command that compiles networks: minutes on a busy machine."""
    command = [sys.executable, "-m", "limberjack", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE)


def _arguments(out: Path, config: Path) -> list[str]:
    return ["train", "pendulum", "swingup", "--config", str(config), "--out", str(out)]


def test_without_its_packages_one_sentence_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sbx", None)
    monkeypatch.delitem(sys.modules, "limberjack.training.learner", raising=False)
    result = invoke("train", "pendulum", "swingup", "--out", str(tmp_path / "run"))
    assert result.exit_code == 1
    expected = f"limberjack train needs the extra 'train': {install_command('train')}"
    assert result.stderr == f"limberjack: {expected}\n"
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["pendulum"], "got pendulum without a task; choose one of: swingup"),
        (["pendulum", "swing"], "swing"),
        ([], "got no task; expected DOMAIN TASK"),
        (["pendulum", "swingup", "--config", "none.toml"], "none.toml"),
        (["pendulum", "swingup", "--env", "a:b"], "expected one of them"),
        (["pendulum", "swingup", "--faults", "eesy"], "there are no faults 'eesy'"),
        (["pendulum", "swingup", "--demonstrations", "none"], "none is no folder"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    result = invoke("train", *arguments, "--out", str(tmp_path / "run"))
    if message == "swing" and importlib.util.find_spec("sbx") is None:
        pytest.skip("needs the extra 'train'")
    assert result.exit_code == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "run").exists()


def test_a_setting_that_does_not_exist_is_named(tmp_path: Path, config: Path) -> None:
    config.write_text("batchsize = 3")
    result = invoke(*_arguments(tmp_path / "run", config))
    assert result.exit_code == 2
    assert "there is no setting 'batchsize'" in result.stderr
    assert "batch_size" in result.stderr


def test_a_run_that_cannot_go_on_is_not_said_to_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def train(*where: object, on_progress: Callable[..., object], **kwargs: object) -> None:
        on_progress(300, 1200, 1.0)
        raise TrainingError("loss is nan: train in another folder")

    monkeypatch.setattr("limberjack.training.train", train)
    result = invoke("train", "pendulum", "swingup", "--out", str(tmp_path / "run"))
    assert result.exit_code == 1
    assert result.stderr == "limberjack: loss is nan: train in another folder\n"


@needs_the_extra
def test_a_killed_command_continues_and_a_finished_one_reports_itself(
    tmp_path: Path, config: Path
) -> None:
    out = tmp_path / "run"
    arguments = _arguments(out, config)
    process = subprocess.Popen([sys.executable, "-m", "limberjack", *arguments])
    deadline = time.monotonic() + _PATIENCE
    while not (out / "curve.csv").exists() and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not list(out.glob("*.safetensors"))
    for beginning in ("finished: return", "finished earlier: return"):
        done = _call(*arguments)
        assert done.returncode == 0, done.stderr
        first, second, third = done.stdout.splitlines()
        assert first.startswith(beginning)
        assert "over 10 episodes, after 1,200 control steps and" in first
        assert (second, third) == (str(out / "policy.safetensors"), str(out / "curve.png"))
    (out / "curve.png").unlink()
    hidden = "import sys; sys.modules['matplotlib.figure'] = None\n"
    program = f"{hidden}from limberjack.cli import main; main()"
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1:] == [second]
    assert done.stderr.splitlines()[-1].startswith("limberjack: no curve.png: needs the extra")
    played = _call("run", "pendulum", "swingup", "--policy", f"mlp:{second}", "--time-limit", "0.4")
    assert played.returncode == 0, played.stderr
    other = _call(*arguments, "--seed", "1")
    assert other.returncode == 2
    assert "has a run whose seed is 0, not 1: choose another folder" in other.stderr


@needs_the_extra
def test_an_interrupt_says_how_to_continue(tmp_path: Path, config: Path) -> None:
    out = tmp_path / "run"
    process = subprocess.Popen(
        # So many steps that it cannot end before the signal.
        [sys.executable, "-m", "limberjack", *_arguments(out, config), "--steps", "1000000"],
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + _PATIENCE
    while not (out / "checkpoint.pickle").exists() and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=_PATIENCE)
    assert process.returncode == 130
    assert "the same command continues from the last checkpoint in" in errors
    assert "0 of 0 control steps" not in errors  # before the first step
