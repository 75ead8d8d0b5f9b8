"""`limberjack run`, called in this process and as a program."""

import ast
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import limberjack
from limberjack import data, policies, suite
from limberjack.cli.output import FAILED, INTERRUPTED, MISUSED
from limberjack.cli.progress import Units, show_units
from limberjack.cli.run import finish
from limberjack.episodes.manifest import DamagedError
from limberjack.episodes.running import Run
from limberjack.policies import PolicyError
from limberjack.suite import base, humanoid
from limberjack.utils.files import Hold
from tests.cli.conftest import call, invoke
from tests.policies import saved_models
from tests.rollouts import run_episode

from . import environments

_RUN = ["run", "humanoid", "stand", "--time-limit", "0.25"]


_BLOCKING = """
import os
import numpy as np

def block(observation):
    os.makedirs("out/result.json", exist_ok=True)
    return np.zeros(21)
"""
_STEPS = 10  # of 0.025 s


_ARM = ["run", "manipulator", "bring_ball", "--time-limit", "0.1"]

_SHOWN = {"result.json", "return.png", "report.html"}
_STEPS_KEPT = {"README.md", "dataset.json", "episodes", "run.json"}
_LEFT = "; what is kept in out is not played again\n"

_SECONDS = 0.1  # four steps


def _result(directory: Path) -> dict[str, Any]:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    return json.loads((directory / "result.json").read_text(), parse_constant=refuse)


def test_run_shows_the_returns_of_the_episodes() -> None:
    result = invoke(*_RUN, "--seeds", "7:12", "--episodes", "3", "--policy", "random")
    assert result.exit_code == 0, result.output
    for seed in (7, 8, 9):
        kwargs = {"random": seed, "time_limit": 0.25}
        environment = suite.load("humanoid", "stand", task_kwargs=kwargs)
        total = run_episode(environment, policies.random, seed).total
        assert re.search(rf"^ +{seed} +\w+ +{total:.3f} +{_STEPS} *$", result.stdout, re.MULTILINE)
    assert "mean" in result.stdout


def test_run_shows_the_kind_of_start_where_there_are_kinds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert re.search(r"seed +start +return +steps", invoke(*_ARM).stdout)
    monkeypatch.setattr(humanoid.Humanoid, "start", base.Task.start)
    assert re.search(r"seed +return +steps", invoke(*_RUN).stdout)


def test_run_writes_result_plot_video_and_report(tmp_path: Path, drawing: bool) -> None:
    out = tmp_path / "new" / "directory"
    result = invoke(*_ARM, "--seeds", "3:5", "--out", str(out))
    assert result.exit_code == 0, result.output

    content = _result(out)
    assert [episode["seed"] for episode in content["episodes"]] == [3, 4]
    for episode in content["episodes"]:
        assert set(episode) == {"seed", "return", "length", "start"}
        assert episode["length"] == 10
        assert episode["start"] in ("in_hand", "in_target", "uniform")
    assert content["domain"] == "manipulator"
    assert content["task"] == "bring_ball"
    assert content["policy"] == "zero"
    assert content["time_limit"] == 0.1
    assert content["control_timestep"] == 0.01
    assert content["episodes_asked_for"] == 2
    assert content["versions"]["limberjack"] == limberjack.__version__
    assert re.fullmatch("[0-9a-f]{64}", content["fingerprint"])

    film = ["video.mp4"] if drawing else []
    names = ["result.json", "return.png", *film, "report.html", "episodes"]
    assert {path.name for path in out.iterdir()} == {*names, *_STEPS_KEPT}
    assert result.stdout.splitlines()[-len(names) :] == [str(out / name) for name in names]


@pytest.mark.usefixtures("no_films")
def test_run_keeps_the_steps_of_all_episodes_as_a_dataset(tmp_path: Path) -> None:
    assert (
        invoke(*_ARM, "--seeds", "3:5", "--policy", "random", "--out", str(tmp_path)).exit_code == 0
    )
    dataset = data.load(tmp_path)
    for kept, listed in zip(dataset, _result(tmp_path)["episodes"], strict=True):
        assert kept.states is not None
        assert (kept.seed, kept.length, kept.start) == (
            listed["seed"], listed["length"], listed["start"],
        )  # fmt: skip
        assert kept.total == listed["return"]
    assert data.replay(dataset) is None


@pytest.mark.usefixtures("no_films")
def test_the_time_limit_of_a_result_is_the_tasks_own_if_none_is_given(tmp_path: Path) -> None:
    result = invoke("run", "stacker", "stack_2", "--out", str(tmp_path))
    assert result.exit_code == 0, result.stderr
    content = _result(tmp_path)
    assert content["time_limit"] == 10.0
    assert content["episodes"][0]["length"] == 1000


@pytest.mark.usefixtures("no_films")
def test_each_episode_can_be_run_again_alone(tmp_path: Path) -> None:
    arguments = [*_RUN, "--policy", "random"]
    invoke(*arguments, "--seeds", "5:8", "--out", str(tmp_path / "three"))
    invoke(*arguments, "--seeds", "7", "--out", str(tmp_path / "one"))
    three, one = _result(tmp_path / "three"), _result(tmp_path / "one")
    assert three["episodes"][2] == one["episodes"][0]
    assert three["fingerprint"] == one["fingerprint"]


def test_a_policy_is_found_in_the_working_directory(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(directory)
    monkeypatch.delitem(sys.modules, "my_policies", raising=False)
    result = invoke(*_RUN, "--policy", "my_policies:still")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("policy", ["zero", "my_policies:still"])
def test_a_stray_module_in_the_working_directory_is_not_imported(
    policy: str, tmp_path: Path
) -> None:
    (tmp_path / "matplotlib.py").write_text("raise SystemExit('the stray one')")
    (tmp_path / "my_policies.py").write_text(
        "import sys\ndef still(observation):\n    return [0.0] * 21\nprint(sys.path)\n"
    )
    arguments = [*_RUN, "--policy", policy, "--out", "out"]
    # As the installed command: `python -m` and `-c` search the working directory first.
    program = f"import sys; sys.argv[1:] = {arguments!r}; from limberjack.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": "disable"},  # no film: it takes long
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "return.png").exists()
    if ":" in policy:
        searched = ast.literal_eval(done.stdout.splitlines()[0])
        assert searched[-1] == str(tmp_path)


def test_output_without_a_terminal_is_clean(tmp_path: Path) -> None:
    for arguments in (["policies"], [*_RUN, "--episodes", "2"]):
        result = call(*arguments, directory=tmp_path)
        assert result.returncode == 0
        assert result.stderr == ""
        assert "\x1b" not in result.stdout
        assert "\r" not in result.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
def test_files_are_written_though_the_table_cannot_be_printed(tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "limberjack", *_RUN, "--out", "out"],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            timeout=120,
            # Python's own status, 120, would come first where it has something left to flush.
            env={**os.environ, "PYTHONUNBUFFERED": "1", "MUJOCO_GL": "disable"},
        )
    assert result.returncode == 1
    assert len(_result(tmp_path / "out")["episodes"]) == 1


def test_a_result_that_cannot_be_written_is_one_line_and_status_2_at_once(tmp_path: Path) -> None:
    (tmp_path / "out" / "result.json").mkdir(parents=True)  # a directory is in its place
    result = call(*_RUN, "--out", "out", directory=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith("limberjack: ")
    assert "result.json" in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


@pytest.mark.usefixtures("no_films")
def test_a_result_that_can_no_longer_be_written_is_one_line_and_status_1(
    directory: Path, invoke_there: Callable[..., Any]
) -> None:
    (directory / "my_policies.py").write_text(_BLOCKING)
    result = invoke_there(*_RUN, "--policy", "my_policies:block", "--out", "out")
    assert result.exit_code == 1
    assert re.fullmatch(
        r"limberjack: .*Is a directory: '.*result\.json'", result.stderr.splitlines()[-1]
    )
    assert re.search(rf"^ +0 +\w+ +\d\.\d+ +{_STEPS} *$", result.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "humanid", "stand"], "Did you mean 'humanoid'?"),
        (["run", "humanoid", "wlak"], "Did you mean 'walk'?"),
        (["run", "humanoid", "swim"], "Choose one of: run, run_pure_state, stand, walk."),
        ([*_RUN[:3], "--time-limit", "0"], "time_limit is 0.0; expected a positive number"),
        ([*_RUN[:3], "--time-limit", "-1"], "time_limit is -1.0; expected a positive number"),
        ([*_RUN[:3], "--time-limit", "nan"], "time_limit is nan; expected a positive number"),
        ([*_RUN[:3], "--time-limit", "inf"], "has no time limit, so an episode might never end"),
        ([*_RUN, "--seeds", "4294967295:4294967297"], "expected numbers up to 4294967295"),
        ([*_RUN, "--seeds", "3", "--episodes", "2"], "--episodes is 2, but --seeds 3 holds 1"),
        (["run"], "got no task; expected DOMAIN TASK, or --env MODULE:FUNCTION"),
        ([*_RUN, "--action-repeat", "2", "--policy", "planner"], "'planner' acts at every control"),
        ([*_RUN, "--policy", "radnom"], "Did you mean 'random'?"),
        ([*_RUN, "--policy", "no_module:act"], "there is no module 'no_module'"),
        ([*_RUN, "--policy", "my_policies:stil"], "Did you mean 'still'?"),
        ([*_RUN, "--policy", "my_policies:np"], "is of type module; expected a function"),
        ([*_RUN, "--out", "my_policies.py"], "my_policies.py'"),
        ([*_RUN, "--out", "my_policies.py/below"], "my_policies.py/below'"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line_and_status_2(
    arguments: list[str], message: str, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(directory)
    monkeypatch.delitem(sys.modules, "my_policies", raising=False)
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("limberjack: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("policy", "status", "message"),
    [
        ("Interrupted", 130, "limberjack: interrupted: 1 of 3 episodes finished"),
        (
            "NotANumber",
            1,
            "limberjack: policy 'my_policies:NotANumber', step 4 of the episode with seed 1: "
            "returned nan at index [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, "
            "18, 19, 20]; expected finite numbers; 1 of 3 episodes finished",
        ),
        (
            "Diverging",
            1,
            "limberjack: policy 'my_policies:Diverging', step 4 of the episode with seed 1: the "
            "simulation diverged; 1 of 3 episodes finished",
        ),
    ],
)
def test_a_run_that_is_cut_short_keeps_the_finished_episodes(
    policy: str,
    status: int,
    message: str,
    directory: Path,
    drawing: bool,
    invoke_there: Callable[..., Any],
) -> None:
    is_signal = policy == "Interrupted"  # as a program, which ends by it; without a film
    policy = f"my_policies:{policy}"
    arguments = [*_RUN, "--episodes", "3", "--policy", policy, "--out", "out"]
    if is_signal:
        result = call(*arguments, directory=directory, MUJOCO_GL="disable")
        code = result.returncode
    else:
        result = invoke_there(*arguments)
        code = result.exit_code
    assert code == status, result.stderr
    assert result.stderr.endswith(message + _LEFT)
    assert "Traceback" not in result.stderr
    assert re.search(rf"^ +0 +\w+ +\d\.\d+ +{_STEPS} *$", result.stdout, re.MULTILINE)
    content = _result(directory / "out")
    assert [episode["seed"] for episode in content["episodes"]] == [0]
    assert content["episodes_asked_for"] == 3
    names = {*_SHOWN, "parts", "run.json", *(["video.mp4"] if drawing and not is_signal else [])}
    assert {path.name for path in (directory / "out").iterdir()} == names
    assert len(list((directory / "out" / "parts").iterdir())) == 1


@pytest.mark.usefixtures("no_films")
def test_an_error_in_a_policy_is_shown_and_the_finished_episodes_kept(
    directory: Path, invoke_there: Callable[..., Any]
) -> None:
    arguments = [*_RUN, "--episodes", "3", "--policy", "my_policies:Broken", "--out", "out"]
    result = invoke_there(*arguments)
    assert result.exit_code == 1
    assert re.search(
        "^limberjack: policy 'my_policies:Broken', step 4 of the episode with seed 1: KeyError: "
        r"'no such key' \(my_policies\.py, line \d+, in \w+\); 1 of 3 episodes finished; what is ",
        result.stderr,
        re.MULTILINE,
    )
    assert "Traceback" not in result.stderr
    assert len(_result(directory / "out")["episodes"]) == 1


@pytest.mark.usefixtures("no_films")
def test_a_run_that_is_cut_short_is_continued(
    directory: Path, invoke_there: Callable[..., Any]
) -> None:
    arguments = [*_RUN, "--episodes", "3", "--policy", "my_policies:Interrupted", "--out", "out"]
    assert invoke_there(*arguments).exit_code == 130
    again = invoke_there(*arguments, EPISODE="2")
    assert again.exit_code == 0, again.stderr
    logged = json.loads((directory / "out" / "run.json").read_text())["calls"]
    assert [one["episodes"] for one in logged] == [3, 2]
    assert [one["seed"] for one in _result(directory / "out")["episodes"]] == [0, 1, 2]
    whole = [*arguments[:-1], "whole"]
    assert invoke_there(*whole, EPISODE="3").exit_code == 0
    for name in ("dataset.json", "result.json"):
        written = [(directory / folder / name).read_bytes() for folder in ("out", "whole")]
        assert written[0] == written[1]


@pytest.mark.usefixtures("no_films")
def test_a_run_that_ends_in_its_first_episode_leaves_nothing_of_an_earlier_one(
    directory: Path, invoke_there: Callable[..., Any]
) -> None:
    arguments = [*_RUN, "--policy", "my_policies:Interrupted", "--out", "out"]
    assert invoke_there(*arguments, EPISODE="1").exit_code == 0
    assert (directory / "out" / "return.png").exists()
    with (directory / "my_policies.py").open("a") as module:
        module.write("# another policy\n")
    result = invoke_there(*arguments, EPISODE="0")
    assert result.exit_code == 130
    assert "0 of 1 episodes finished" in result.stderr
    left = {path.name for path in (directory / "out").iterdir()}
    assert left == {"result.json", "run.json"}
    assert _result(directory / "out")["episodes"] == []


@pytest.mark.usefixtures("no_films")
def test_a_policy_that_has_changed_replaces_its_steps(
    directory: Path, invoke_there: Callable[..., Any]
) -> None:
    arguments = [*_RUN, "--policy", "my_policies:still", "--out", "out"]
    assert invoke_there(*arguments, "--episodes", "2").exit_code == 0
    before = _result(directory / "out")["episodes"]
    module = directory / "my_policies.py"
    module.write_text(module.read_text().replace("return np.zeros(21)\n", "return np.ones(21)\n"))
    done = invoke_there(*arguments)
    assert done.exit_code == 0, done.stderr
    (after,) = _result(directory / "out")["episodes"]
    assert after["return"] != before[0]["return"]
    dataset = data.load(directory / "out")
    assert list(dataset.seeds) == [0]
    assert dataset.episode(0).total == after["return"]


def test_the_steps_of_a_collection_are_not_replaced(tmp_path: Path) -> None:
    collected = ["collect", *_RUN[1:], "--episodes", "2", "--out", str(tmp_path)]
    assert invoke(*collected).exit_code == 0
    before = _bytes(tmp_path)
    result = invoke(*_RUN, "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "belongs to another dataset than the one asked for, whose states is" in result.stderr
    assert result.stderr.count("\n") == 1
    assert _bytes(tmp_path) == before


def test_an_interrupt_while_the_film_is_drawn_leaves_out_the_film_only(
    tmp_path: Path, drawing: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not drawing:
        pytest.skip("no OpenGL here")

    def interrupted(self: object, physics: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("limberjack.see.video.Film.add", interrupted)
    result = invoke(*_RUN, "--out", str(tmp_path))
    assert result.exit_code == 130
    assert result.stderr.startswith("limberjack: interrupted: 1 of 1 episodes finished")
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"result.json", "return.png", *_STEPS_KEPT}
    assert len(_result(tmp_path)["episodes"]) == 1


def _bytes(directory: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


@pytest.mark.usefixtures("no_films")
def test_a_folder_with_other_results_is_status_2_and_left_alone(tmp_path: Path) -> None:
    out = ["--out", str(tmp_path / "out")]
    assert invoke(*_RUN, *out).exit_code == 0
    assert invoke(*_RUN, "--seeds", "1", *out).exit_code == 0
    before = _bytes(tmp_path)
    result = invoke(*_RUN, "--policy", "random", *out)
    assert result.exit_code == 2
    assert result.stderr == (
        f"limberjack: {tmp_path / 'out'} holds results with policy 'zero', and these have "
        "'random': choose another folder\n"
    )
    assert _bytes(tmp_path) == before


def test_a_film_that_no_run_made_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "video.mp4").write_text("a film of `limberjack record`")
    result = invoke(*_RUN, "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "holds video.mp4 but no result.json" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]


def test_a_saved_model_runs_and_a_model_of_another_task_is_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    result = invoke("run", "humanoid/stand", "--time-limit", "0.25", "--policy", name)
    assert result.exit_code == 0, result.output
    wrong = invoke(*_ARM, "--policy", name)
    assert wrong.exit_code == 2
    assert wrong.stderr.count("\n") == 2  # the first says that it is a pickle
    assert "the model's actions have shape (21,)" in wrong.stderr
    assert invoke(*_RUN, "--policy", "sb3:none.zip").exit_code == 2


@pytest.mark.parametrize("command", [_RUN, ["solve", *_ARM[1:]], ["evaluate", *_ARM[1:]]])
def test_a_folder_that_another_process_writes_to_is_status_2(
    command: list[str], tmp_path: Path
) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    with Hold(tmp_path):
        result = invoke(*command, "--out", str(tmp_path))
        assert result.exit_code == 2
        assert "another process writes to" in result.stderr
        assert result.stderr.count("\n") == 1
        assert not list(tmp_path.iterdir())


def test_without_opengl_only_the_video_is_left_out_and_one_line_says_why(tmp_path: Path) -> None:
    result = call(*_RUN, "--out", "out", directory=tmp_path, MUJOCO_GL="disable")
    assert result.returncode == 0
    assert result.stderr.startswith("limberjack: no video.mp4: ")
    assert "MUJOCO_GL" in result.stderr
    assert result.stderr.count("\n") == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} == _SHOWN | _STEPS_KEPT


@pytest.mark.parametrize(
    ("missing", "lines", "left"),
    [
        (
            ["imageio_ffmpeg", "matplotlib"],
            "limberjack: no video.mp4 and no return.png: needs the extra 'video': "
            "pip install imageio-ffmpeg matplotlib pillow\n",
            {"report.html", "result.json"} | _STEPS_KEPT,
        ),
        (
            ["pyarrow"],
            "limberjack: no episodes: needs the extra 'data': pip install fsspec pyarrow\n",
            _SHOWN | {"video.mp4"},
        ),
    ],
)
def test_without_an_extra_one_line_names_its_packages(
    missing: list[str], lines: str, left: set[str], tmp_path: Path, drawing: bool
) -> None:
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({missing!r}))\n"
        f"sys.argv[1:] = {[*_RUN, '--out', 'out']!r}\n"
        "from limberjack.cli import main; main()"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    assert lines in result.stderr
    if drawing:
        assert result.stderr == lines
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == (left if drawing else left - {"video.mp4"})
    assert len(_result(tmp_path / "out")["episodes"]) == 1


@pytest.mark.parametrize("repeat", [1, 3])
def test_actions_are_repeated_and_control_steps_counted(repeat: int, tmp_path: Path) -> None:
    options = ["--policy", "random", "--action-repeat", str(repeat), "--out", str(tmp_path)]
    result = invoke(*_RUN, *options)
    assert result.exit_code == 0, result.output
    (episode,) = data.load(tmp_path)
    assert episode.length == _STEPS
    changes = (np.diff(episode.actions, axis=0) != 0).any(axis=1)
    assert (np.flatnonzero(changes) + 1).tolist() == list(range(repeat, _STEPS, repeat))
    assert _result(tmp_path).get("action_repeat", 1) == repeat


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
        try:
            return finish(run, progress, out), progress
        except typer.Exit as error:
            return error.exit_code, progress


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


def test_a_damaged_file_of_an_earlier_call_is_reported_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def damaged(run: Run, on_progress: Callable[[str, int], None]) -> None:
        on_progress("zero", 1)
        raise DamagedError("a part is damaged")

    monkeypatch.setattr(Run, "play", damaged)
    assert _finished(_made(tmp_path), tmp_path)[0] == FAILED
    assert capsys.readouterr().err == "limberjack: a part is damaged\n"


def test_an_error_of_this_package_keeps_its_traceback_after_the_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(self: object, step: object) -> None:
        raise error

    error = KeyError("a bug of the package")
    run = _made(tmp_path)
    monkeypatch.setattr("limberjack.cli.output.users_failure", lambda failure: None)
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
