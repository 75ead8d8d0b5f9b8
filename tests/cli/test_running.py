"""The part that `run` and `solve` share: who plays, messages and exit statuses."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.cli.output import FAILED, INTERRUPTED, MISUSED
from limberjack.cli.progress import Units, show_units
from limberjack.cli.running import finish, scale_of
from limberjack.episodes.running import Run
from limberjack.policies import PolicyError
from limberjack.workers import State

from . import environments

_SECONDS = 0.1  # four steps


class _Scripted:
    """Stands still; the second episode fails if the test says so."""

    failure: BaseException | None = None

    def __init__(self) -> None:
        self.episodes = 0

    def reset(self) -> None:
        self.episodes += 1

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        if self.failure is not None and self.episodes == 2:
            raise self.failure
        return np.zeros(21)


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], None]:
    """Makes the second episode fail with an error."""
    return lambda failure: monkeypatch.setattr(_Scripted, "failure", failure)


def _made(out: Path | None = None, seeds: range = range(4, 7), **how: Any) -> Run:
    return Run("humanoid", "stand", _Scripted, seeds, out=out, time_limit=_SECONDS, **how)


def _finished(run: Run, out: Path | None = None) -> tuple[int, Units]:
    with show_units() as progress:
        return finish(run, progress, out), progress


def test_each_seed_is_played_once_and_the_mean_is_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run = _made()
    status, progress = _finished(run)
    assert (status, progress.episodes, progress.finished) == (0, 3, 3)
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    totals = {episode.seed: episode.total for episode in run.episodes}
    assert list(totals) == [4, 5, 6]
    for seed, total in totals.items():
        (row,) = [line for line in printed if line[:1] == [str(seed)]]
        assert row[-2:] == [f"{total:.3f}", "4"]
    assert ["mean", f"{sum(totals.values()) / 3:.3f}"] in printed


def test_an_episode_alone_has_no_mean(capsys: pytest.CaptureFixture[str]) -> None:
    assert _finished(_made(seeds=range(1)))[0] == 0
    assert "mean" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("failure", "status", "message"),
    [
        (KeyboardInterrupt(), INTERRUPTED, "limberjack: interrupted: 1 of 3 episodes finished"),
        (PolicyError("no action"), FAILED, ": no action; 1 of 3 episodes finished"),
        (OSError(28, "No space left"), FAILED, "No space left"),
        (ZeroDivisionError("bug"), FAILED, "ZeroDivisionError: bug ("),
    ],
)
def test_episodes_that_finished_before_an_error_are_shown_and_kept(
    failure: BaseException,
    status: int,
    message: str,
    failing: Callable[[BaseException], None],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    failing(failure)
    assert _finished(_made())[0] == status
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.err.endswith("; 1 of 3 episodes finished\n") or status == INTERRUPTED
    assert printed.err.count("\n") == 1
    assert [line.split()[0] for line in printed.out.splitlines()[2:]] == ["4"]
    assert _finished(_made(tmp_path), tmp_path)[0] == status
    kept = f"; what is kept in {tmp_path} is not played again\n"
    assert capsys.readouterr().err.endswith(kept)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert [episode["seed"] for episode in result["episodes"]] == [4]
    assert result["episodes_asked_for"] == 3
    assert result["time_limit"] == _SECONDS


def test_an_error_of_this_package_keeps_its_traceback_after_the_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: object, step: object) -> None:
        raise error

    error = KeyError("a bug of the package")
    run = _made(tmp_path)
    monkeypatch.setattr("limberjack.cli.running.users_failure", lambda failure: None)
    monkeypatch.setattr(Run, "_watch", broken)
    with pytest.raises(KeyError) as caught:
        _finished(run, tmp_path)
    assert caught.value is error
    assert (tmp_path / "result.json").exists()


def test_a_mistake_that_is_found_before_the_first_episode_writes_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _made(tmp_path)
    (tmp_path / "episodes").mkdir()
    (tmp_path / "episodes" / "seeds-0000000000-0000000001.parquet").write_bytes(b"PAR1")
    assert _finished(run, tmp_path)[0] == MISUSED
    printed = capsys.readouterr()
    assert "is damaged or no file of a dataset" in printed.err
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert not (tmp_path / "result.json").exists()


def test_episodes_that_diverged_are_named_and_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Run(environments.diverging, None, "zero", range(2), out=tmp_path)
    assert _finished(run, tmp_path)[0] == FAILED
    printed = capsys.readouterr().err
    assert printed.endswith(
        "limberjack: the simulation of seed 0 diverged in step 1\n"
        "limberjack: the simulation of seed 1 diverged in step 1\n"
    )
    assert (tmp_path / "report.html").exists()
    assert len(run.episodes) == 2


def test_the_options_say_who_plays_and_events_are_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with show_units() as progress:
        scale = scale_of(progress, 3, "local", 2, True)
        assert scale.on_state is not None
        scale.on_state(State(2, 1, note="node b was lost"))
    assert (scale.workers, scale.ray, scale.num_threads, scale.any_processor) == (
        3, "local", 2, True,
    )  # fmt: skip
    assert scale.executor is None
    assert capsys.readouterr().err == "limberjack: node b was lost\n"
