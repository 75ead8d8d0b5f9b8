"""A whole evaluation: its result, its files, and continuing after a kill."""

import functools
import json
import linecache
import os
import re
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import evaluated
import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.evaluation import Evaluation, evaluate, experiment
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import PolicyError
from limberjack.rl import control
from limberjack.rl.control import Environment
from tests import plain_domain
from tests.plain_pictures import draw_plainly
from tests.rl import odd_environments
from tests.rollouts import run_episode

_SHORT = {"time_limit": 0.1, "num_threads": 1}
_WHERE = Path(__file__).parent


@pytest.fixture
def plotted() -> None:
    """The test is of returns.png too."""


@pytest.fixture(autouse=True)
def _no_plots(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots take longer to draw than these episodes to play."""
    if "plotted" not in request.fixturenames:
        monkeypatch.setitem(sys.modules, "matplotlib.figure", None)


def _evaluate(policy: Any = "zero", seeds: Any = range(3), **kwargs: Any) -> Evaluation:
    return evaluate("humanoid", "stand", policy, seeds, **{**_SHORT, **kwargs})


def _lines(directory: Path) -> list[dict[str, Any]]:
    text = (directory / "episodes.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def _result(directory: Path) -> dict[str, Any]:
    return json.loads((directory / "result.json").read_text(encoding="utf-8"))


def test_the_floors_are_played_on_the_same_seeds() -> None:
    evaluation = _evaluate("evaluated:linear", [4, 2])
    assert list(evaluation.scores) == ["evaluated:linear", "zero", "random"]
    for policy, scores in evaluation.scores.items():
        environment = suite.load("humanoid", "stand", {"time_limit": 0.1})
        for seed, score in zip([4, 2], scores, strict=True):
            environment.reseed(seed)
            episode = run_episode(environment, policies.find(policy), seed)
            assert (score.seed, score.total) == (seed, episode.total)


def test_a_floor_that_is_evaluated_is_played_once() -> None:
    assert list(_evaluate("random").scores) == ["random", "zero"]


@pytest.mark.usefixtures("plotted")
def test_the_result_has_all_that_is_needed_to_run_it_again(tmp_path: Path) -> None:
    evaluation = evaluate(
        "manipulator", "bring_ball", "random", range(5, 9), out=tmp_path / "out", **_SHORT
    )
    result = _result(tmp_path / "out")
    assert result == json.loads(json.dumps(evaluation.as_json()))
    assert (result["domain"], result["task"]) == ("manipulator", "bring_ball")
    assert (result["policy"], result["action_repeat"]) == ("random", 1)
    assert re.fullmatch("[0-9a-f]{64}", result["policy_sha256"])
    assert (result["seeds"], result["episodes_asked_for"]) == ("5:9", 4)
    assert (result["time_limit"], result["control_timestep"]) == (0.1, 0.01)
    assert result["success"] == {"last_steps": 100, "mean_reward_at_least": 0.9}
    assert result["versions"] == versions()
    model = suite.load("manipulator", "bring_ball").physics.model._official
    assert result["fingerprint"] == fingerprint(model)
    assert [episode["seed"] for episode in result["episodes"]] == [5, 6, 7, 8]
    for episode in result["episodes"]:
        assert episode.keys() == {"seed", "return", "length", "start", "final_reward", "success"}
        assert episode["length"] == 10
    assert len(result["floors"]["zero"]["returns"]) == 4
    mean = np.mean([episode["return"] for episode in result["episodes"]])
    assert result["summary"]["random"]["mean"] == mean
    starts = {episode["start"] for episode in result["episodes"]}
    assert set(result["summary"]["random"]["strata"]) == starts
    names = ("result.json", "report.html", "returns.png")
    assert evaluation.files == tuple(tmp_path / "out" / name for name in names)


def test_the_same_call_plays_nothing_again(tmp_path: Path) -> None:
    first = _evaluate("random", out=tmp_path)
    before = (tmp_path / "episodes.jsonl").read_bytes(), (tmp_path / "result.json").read_bytes()
    played = []
    second = _evaluate(
        "random", out=tmp_path, on_progress=lambda *reported: played.append(reported)
    )
    assert played == []
    assert second == first
    after = (tmp_path / "episodes.jsonl").read_bytes(), (tmp_path / "result.json").read_bytes()
    assert after == before


def test_more_seeds_are_added_to_those_that_are_there(tmp_path: Path) -> None:
    _evaluate("random", range(2, 4), out=tmp_path)
    counts: list[tuple[str, int]] = []
    _evaluate(
        "random",
        range(5),
        out=tmp_path,
        on_progress=lambda what, finished, part: counts.append((what, finished)),
    )
    assert counts[0] == ("random", 2)
    assert ("zero", 5 + 2) in counts
    assert counts[-1] == ("zero", 10)
    assert len(_lines(tmp_path)) == 1 + 2 * 5
    whole = _evaluate("random", range(5), out=tmp_path / "whole")
    assert _result(tmp_path) == json.loads(json.dumps(whole.as_json()))


def test_the_episode_of_an_unfinished_line_is_played_again(tmp_path: Path) -> None:
    expected = _evaluate("random", out=tmp_path)
    path = tmp_path / "episodes.jsonl"
    path.write_bytes(path.read_bytes()[:-20])
    assert _evaluate("random", out=tmp_path).scores == expected.scores
    assert len(_lines(tmp_path)) == 1 + 2 * 3


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    _evaluate(out=tmp_path)
    path = tmp_path / "episodes.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], "{}", *lines[3:]]) + "\n")
    with pytest.raises(ValueError, match=r"episodes.jsonl: line 3 is no episode: remove that line"):
        _evaluate(out=tmp_path)


@pytest.mark.parametrize(
    ("task", "kwargs", "message"),
    [
        ("walk", {}, "holds an evaluation with task 'stand', and this one has 'walk'"),
        ("stand", {"policy": "random"}, "with policy 'zero', and this one has 'random'"),
        ("stand", {"time_limit": 0.2}, "with time_limit 0.1, and this one has 0.2"),
    ],
)
def test_a_folder_with_other_results_is_refused_and_left_alone(
    task: str, kwargs: dict[str, Any], message: str, tmp_path: Path
) -> None:
    _evaluate(out=tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ValueError, match=message):
        evaluate("humanoid", task, seeds=range(3), out=tmp_path, **{**_SHORT, **kwargs})
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["result.json", "report.html", "returns.png"])
def test_the_folder_of_another_command_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("{}")
    with pytest.raises(ValueError, match=rf"holds {name} but no episodes.jsonl"):
        _evaluate(out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_the_folder_of_a_dataset_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(ValueError, match=r"holds a dataset, dataset\.json: choose another folder"):
        _evaluate(out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["dataset.json"]


def test_scores_are_not_written_to_a_url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="s3://bucket/scores is a URL; expected the path of a fol"):
        _evaluate(out="s3://bucket/scores")
    assert list(tmp_path.iterdir()) == []


def test_seeds_that_lie_far_apart_are_listed_one_by_one() -> None:
    for seeds in ([0, 2**62], [0, 2, 1, 3]):  # no list has the numbers between the first two
        assert experiment._asked_for(seeds)["seeds"] == seeds
    assert experiment._asked_for([3, 4])["seeds"] == "3:5"


def test_rows_can_be_asked_for_and_change_no_number() -> None:
    rows = _evaluate("random", vectorised=False)
    assert rows.scores == _evaluate("random", vectorised=True).scores
    with pytest.raises(ValueError, match="LastAction"):
        evaluate(_remembering, seeds=range(2), vectorised=True)


def _remembering(seed: int) -> control.Environment:
    return odd_environments.of_task(odd_environments.LastAction, seed)


def _moving(observation: Any) -> np.ndarray:
    os.chdir("/")
    return np.zeros(21)


def test_files_are_written_where_they_were_asked_for_though_the_policy_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _evaluate(_moving, out="out")
    assert _result(tmp_path / "out")["episodes_asked_for"] == 3


def test_a_policy_whose_source_has_changed_is_another_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "changing_policy.py"
    module.write_text("import numpy as np\n\ndef act(observation):\n    return np.zeros(21)\n")
    monkeypatch.syspath_prepend(tmp_path)
    _evaluate("changing_policy:act", out=tmp_path / "out")
    module.write_text("import numpy as np\n\ndef act(observation):\n    return np.ones(21)\n")
    with pytest.raises(ValueError, match="holds an evaluation with policy_sha256"):
        _evaluate("changing_policy:act", out=tmp_path / "out")


def test_a_domain_whose_source_has_changed_is_another_domain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = tmp_path / "changing_domain.py"
    module.write_text("from tests.plain_domain import SUITE\n")
    monkeypatch.syspath_prepend(tmp_path)
    suite.register("changing", "changing_domain")
    try:
        for workers in (None, 1):
            evaluate("changing", "push", "zero", range(2), out=tmp_path / "out", workers=workers)
        assert re.fullmatch("[0-9a-f]{64}", _result(tmp_path / "out")["domain_sha256"])
        module.write_text("from tests.plain_domain import SUITE  # otherwise\n")
        with pytest.raises(ValueError, match="holds an evaluation with domain_sha256 '"):
            evaluate("changing", "push", "zero", range(3), out=tmp_path / "out")
    finally:
        suite.unregister("changing")


def test_a_domain_without_a_file_is_evaluated_but_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed = types.ModuleType("tests.plain_domain")  # not the imported one of that name
    monkeypatch.setattr(typed, "SUITE", plain_domain.SUITE, raising=False)
    monkeypatch.setitem(suite._DOMAINS, "typed", typed)
    assert evaluate("typed", "push", "zero", range(2)).facts["domain"] == "typed"
    with pytest.raises(ValueError, match="the module of 'typed' has no file, so a change"):
        evaluate("typed", "push", "zero", range(2), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_policy_in_a_package_is_hashed_with_all_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "changing_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "network.py").write_text(
        "import numpy as np\n\ndef run():\n    return np.zeros(21)\n"
    )
    (package / "policy.py").write_text(
        "import importlib\n\ndef act(observation):\n"
        "    return importlib.import_module('changing_package.network').run()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    _evaluate("changing_package.policy:act", out=tmp_path / "out")
    (package / "network.py").write_text("# another network\n")
    with pytest.raises(ValueError, match="holds an evaluation with policy_sha256"):
        _evaluate("changing_package.policy:act", out=tmp_path / "out")


def test_an_evaluation_continues_with_another_patch_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected, now = _evaluate(seeds=range(3)), versions()
    _evaluate(seeds=range(2), out=tmp_path)
    assert "versions_of_episodes" not in _result(tmp_path)
    later = {**now, "mujoco": now["mujoco"] + "1"}
    monkeypatch.setattr("limberjack.workers.identity.versions", lambda: later)
    evaluation = _evaluate(seeds=range(3), out=tmp_path)
    assert evaluation.scores == expected.scores
    assert _result(tmp_path)["versions"] == later
    assert _result(tmp_path)["versions_of_episodes"] == [now, later]
    major, _, rest = now["mujoco"].partition(".")
    monkeypatch.setattr(
        "limberjack.workers.identity.versions",
        lambda: {**now, "mujoco": f"{int(major) + 1}.{rest}"},
    )
    with pytest.raises(ValueError, match="holds an evaluation with versions"):
        _evaluate(seeds=range(3), out=tmp_path)


def test_a_policy_without_a_file_is_identified_by_its_source_or_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "typed_in", types.ModuleType("typed_in"))
    cells = {f"<cell {n}>": f"def act(o):\n    return np.full(21, {n})\n" for n in (0, 1)}
    act = []
    for name, source in cells.items():
        module: dict[str, Any] = {"__name__": "typed_in", "np": np}
        exec(compile(source, name, "exec"), module)
        act.append(module["act"])
    _evaluate(act[0], out=tmp_path / "unknown")
    with pytest.raises(ValueError, match="'typed_in:act', whose source is unknown here"):
        _evaluate(act[0], out=tmp_path / "unknown")
    # As in a notebook: what was typed is kept where `inspect` looks.
    for name, source in cells.items():
        lines = len(source), None, source.splitlines(keepends=True), name
        monkeypatch.setitem(linecache.cache, name, lines)
    expected = _evaluate(act[0], out=tmp_path / "known")
    assert _evaluate(act[0], out=tmp_path / "known") == expected
    with pytest.raises(ValueError, match="holds an evaluation with policy_sha256"):
        _evaluate(act[1], out=tmp_path / "known")


def test_a_policy_that_fails_keeps_the_episodes_before(tmp_path: Path) -> None:
    seeds = range(100)  # seed 70 is in the second batch
    with pytest.raises(PolicyError, match="step 3 of the episode with seed 70"):
        _evaluate("evaluated:NotANumber", seeds, out=tmp_path)
    assert sorted(line["seed"] for line in _lines(tmp_path)[1:]) == list(range(64))
    assert not (tmp_path / "result.json").exists()


@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ([], "there are no seeds; expected at least one"),
        (range(5, 5), "there are no seeds"),
        ([-1], "seed is -1; expected a whole number from 0 to"),
        ([2**32], "seed is 4294967296; expected a whole number"),
        ([1.5], "seed is 1.5; expected a whole number"),
        ([True], "seed is True; expected a whole number"),
        ([1, 2, 1], "a seed occurs twice"),
    ],
)
def test_invalid_seeds_are_refused(seeds: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        _evaluate(seeds=seeds, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_invalid_task_or_number_creates_no_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(ValueError, match="Did you mean 'stand'"):
        evaluate("humanoid", "stnad", out=out)
    with pytest.raises(ValueError, match="num_threads is 0; expected a whole number of at least 1"):
        _evaluate(out=out, num_threads=0)
    with pytest.raises(
        ValueError, match="humanoid stand has no time limit, so an episode might never end"
    ):
        _evaluate(out=out, time_limit=float("inf"))
    with pytest.raises(PolicyError, match="there is no module 'nowhere'"):
        _evaluate("nowhere:act", out=out)
    with pytest.raises(ValueError, match=r"a shard needs a folder .*: give one as out \(--out DIR"):
        _evaluate(shard=(1, 2))
    assert not out.exists()


def test_progress_counts_the_episodes_of_all_policies() -> None:
    reported: list[tuple[str, int, float]] = []
    _evaluate("random", range(2), on_progress=lambda *now: reported.append(now))
    # At first, after each of four steps of two episodes at once, then after each episode.
    one = [(0, 0.0), (0, 0.5), (0, 1.0), (0, 1.5), (0, 2.0), (1, 1.0), (2, 0.0)]
    expected = [("random", finished, part) for finished, part in one]
    assert reported == expected + [("zero", 2 + finished, part) for finished, part in one]


def test_without_matplotlib_everything_but_the_picture_is_written(tmp_path: Path) -> None:
    evaluation = _evaluate(out=tmp_path)
    assert evaluation.files == (tmp_path / "result.json", tmp_path / "report.html")
    assert evaluation.left_out == (
        "no returns.png: needs the extra 'video': pip install imageio-ffmpeg matplotlib pillow"
    )
    (tmp_path / "returns.png").write_bytes(b"of an earlier call, which had matplotlib")
    _evaluate(out=tmp_path)
    assert not (tmp_path / "returns.png").exists()


# Killed and called again.


# The command without its plot, which takes longer than the episodes.
_COMMAND = """
import sys
sys.modules["matplotlib.figure"] = None
from limberjack.cli import main
main()
"""


def _call(out: Path, **variables: str) -> "subprocess.CompletedProcess[str]":
    arguments = ["stand", "--policy", "evaluated:Linear", "--seeds", "0:70", "--time-limit", "0.1"]
    command = [sys.executable, "-c", _COMMAND, "evaluate", "humanoid", *arguments]
    inherited = {name: value for name, value in os.environ.items() if "COLOR" not in name}
    return subprocess.run(
        [*command, "--threads", "1", "--out", str(out)],
        cwd=_WHERE,
        env=inherited | variables,
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_a_killed_evaluation_continues_and_equals_one_that_was_not_killed(tmp_path: Path) -> None:
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert _call(whole).returncode == 0
    done = _call(killed, KILL_FROM_SEED="64")
    assert done.returncode == -9, done.stderr
    assert len(_lines(killed)) == 1 + 64
    assert not (killed / "result.json").exists()
    first = (killed / "episodes.jsonl").read_bytes()
    done = _call(killed)
    assert done.returncode == 0, done.stderr
    assert (killed / "episodes.jsonl").read_bytes().startswith(first)
    for name in ("result.json", "episodes.jsonl"):
        assert (killed / name).read_bytes() == (whole / name).read_bytes()


_POLICIES = ["random", "evaluated:linear", "evaluated:Linear", "evaluated:Remembering"]


def _make(seed: int, repeat: int = 1, **kwargs: Any) -> control.Environment:
    """An environment with episodes of ten control steps, which has actions to repeat itself."""
    of_task = {"random": seed, "time_limit": 0.25}
    environment = suite.load("humanoid", "stand", of_task, kwargs)
    environment.action_repeat = repeat
    return environment


def _repeating(seed: int) -> control.Environment:
    return _make(seed, repeat=3)


def _pictured(seed: int) -> control.Environment:
    environment = _make(seed, pixels={"camera": 0, "height": 8, "width": 8, "frame_stack": 2})
    draw_plainly(environment.physics.model)
    return environment


def _by_hand(policy: Any, seed: int, repeat: int) -> tuple[float, int]:
    """The return and the length, in control steps, of an episode with repeated actions."""
    environment = _make(seed)
    time_step = environment.reset()
    act = policies.find(policy).begin_alone(environment, seed)
    rewards: list[float] = []
    while not time_step.last():
        action = act(time_step.observation)
        for _ in range(repeat):
            time_step = environment.step(action)
            rewards.append(time_step.reward)
            if time_step.last():
                break
    return float(np.cumsum(rewards)[-1]), len(rewards)


def _replayed(seed: int, actions: list[np.ndarray], repeat: int) -> tuple[float, int]:
    """The return and the length, in control steps, of an episode with known actions."""
    environment = _make(seed)
    time_step, rewards = environment.reset(), []
    while not time_step.last():
        time_step = environment.step(actions[len(rewards) // repeat])
        rewards.append(time_step.reward)
    return float(np.cumsum(rewards)[-1]), len(rewards)


@pytest.mark.parametrize("policy", _POLICIES)
@pytest.mark.parametrize("repeat", [3, 4])
def test_repeated_actions_score_as_a_loop_that_counts_control_steps(
    policy: str, repeat: int
) -> None:
    evaluation = evaluate(_make, None, policy, range(3), num_threads=1, action_repeat=repeat)
    assert evaluation.as_json()["action_repeat"] == repeat
    for seed, score in enumerate(evaluation.scores[policy]):
        assert (score.total, score.length) == _by_hand(policy, seed, repeat)


@pytest.mark.parametrize("policy", _POLICIES)
def test_the_environments_own_repeat_counts_control_steps_too(policy: str) -> None:
    own = evaluate(_repeating, None, policy, range(3), num_threads=1)
    given = evaluate(_make, None, policy, range(3), num_threads=1, action_repeat=3)
    assert own.scores == given.scores
    assert own.as_json()["action_repeat"] == 3
    other = evaluate(_repeating, None, policy, range(3), num_threads=1, action_repeat=2)
    expected = evaluate(_make, None, policy, range(3), num_threads=1, action_repeat=2)
    assert other.scores == expected.scores


def test_workers_repeat_actions_and_another_repeat_does_not_continue(tmp_path: Path) -> None:
    here = _evaluate("random", action_repeat=3)
    there = _evaluate("random", action_repeat=3, workers=1, out=tmp_path)
    assert there.scores == here.scores
    with pytest.raises(ValueError, match="action_repeat"):
        _evaluate("random", action_repeat=2, out=tmp_path)
    assert _evaluate("random", action_repeat=3, out=tmp_path).scores == here.scores


@pytest.mark.skipif(os.environ.get("MUJOCO_GL") == "disable", reason="rendering is turned off")
def test_stacked_pictures_are_those_of_actions() -> None:
    how: dict[str, Any] = {"num_threads": 1, "action_repeat": 3}
    evaluation = evaluate(_pictured, None, "evaluated:watching", range(2), **how)
    for seed, score in enumerate(evaluation.scores["evaluated:watching"]):
        environment = _pictured(seed)
        environment.action_repeat = 3
        time_step, actions = environment.reset(), []
        while not time_step.last():
            actions.append(evaluated.watching(time_step.observation))
            time_step = environment.step(actions[-1])
        assert (score.total, score.length) == _replayed(seed, actions, 3)


@pytest.mark.parametrize("repeat", [0, -1, 1.5, True, "2"])
def test_a_wrong_repeat_is_refused_before_anything_is_made(repeat: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"action_repeat is .*; expected a whole number"):
        _evaluate("random", action_repeat=repeat, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("domain", ["humanoid", _repeating])
def test_the_planner_acts_at_every_control_step(domain: Any) -> None:
    task = "stand" if domain == "humanoid" else None
    how: dict[str, Any] = {"action_repeat": 2} if task else {}
    with pytest.raises(ValueError, match=r"action_repeat is \d, but policy .planner. acts at"):
        evaluate(domain, task, "planner", range(1), num_threads=1, **how)


def test_an_evaluation_is_not_staggered() -> None:
    with pytest.raises(TypeError, match="stagger"):
        _evaluate("random", stagger=True)


# Environments that a function makes, and tasks that are not built on `suite.base`.


def _of_function(make: Callable[..., Any], **kwargs: Any) -> Evaluation:
    return evaluate(make, **{"policy": "random", "seeds": range(3), "num_threads": 1, **kwargs})


def _slower(seed: int) -> Environment:
    environment = plain_domain.make(seed)
    environment._n_sub_steps = seed + 1
    return environment


def test_an_episode_is_the_first_one_of_make_with_its_seed() -> None:
    evaluation = _of_function(plain_domain.make)
    for score in evaluation.scores["random"]:
        episode = run_episode(plain_domain.make(score.seed), policies.random, score.seed)
        assert (score.total, score.length) == (episode.total, 25)


def test_a_model_that_depends_on_the_seed_is_made_again_for_each_seed() -> None:
    evaluation = _of_function(plain_domain.ticking, seeds=range(70))
    for score in evaluation.scores["random"][::23]:
        episode = run_episode(plain_domain.ticking(score.seed), policies.random, score.seed)
        assert score.total == episode.total


def test_an_environment_of_the_suite_gives_what_its_names_give() -> None:
    def make(seed: int) -> Environment:
        return suite.load("stacker", "stack_2", {"random": seed, "time_limit": 0.1})

    named = evaluate("stacker", "stack_2", "random", range(3), num_threads=1, time_limit=0.1)
    assert _of_function(make).scores == named.scores


@pytest.mark.usefixtures("plotted")
def test_a_result_names_the_function_and_the_hash_of_its_source(tmp_path: Path) -> None:
    evaluation = _of_function(plain_domain.make, out=tmp_path)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["environment"] == "tests.plain_domain:make"
    assert re.fullmatch("[0-9a-f]{64}", result["environment_sha256"])
    assert not {"domain", "task"} & result.keys()
    assert _of_function(plain_domain.make, out=tmp_path) == evaluation
    assert (tmp_path / "returns.png").exists()


def test_the_folder_of_another_function_is_refused(tmp_path: Path) -> None:
    _of_function(plain_domain.make, out=tmp_path)
    with pytest.raises(
        ValueError, match=r"holds an evaluation with environment 'tests\.plain_domain:make'"
    ):
        _of_function(plain_domain.heavier, out=tmp_path)
    with pytest.raises(ValueError, match="holds an evaluation with domain None"):
        evaluate("humanoid", "stand", "random", range(3), out=tmp_path)


class _Maker:
    def __call__(self, seed: int) -> Environment:
        return plain_domain.make(seed)


@pytest.mark.parametrize(
    "make",
    [lambda seed: plain_domain.make(seed), functools.partial(plain_domain.push, 0.5), _Maker()],
    ids=["a lambda", "a partial", "an object"],
)
def test_a_factory_that_its_source_does_not_identify_is_evaluated_but_not_kept(
    make: Callable[[int], Environment], tmp_path: Path
) -> None:
    assert _of_function(make).scores == _of_function(plain_domain.make).scores
    with pytest.raises(ValueError, match="cannot be distinguished from other functions"):
        _of_function(make, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def _no_seed() -> Environment:
    return plain_domain.make(0)


def _no_environment(seed: int) -> dict[str, int]:
    return {"seed": seed}


@pytest.mark.parametrize(
    ("make", "kwargs", "message"),
    [
        (
            plain_domain.make,
            {"task": "random"},
            "task is 'random', but tests.plain_domain:make makes the",
        ),
        (
            plain_domain.make,
            {"time_limit": 1.0},
            "time_limit is 1.0, but tests.plain_domain:make makes",
        ),
        (plain_domain.endless, {}, "has no time limit, .*: give it a time_limit"),
        (_slower, {}, r"_slower makes an environment that differs for seed 1: its episodes have"),
        (_no_seed, {}, r"cannot be called with a seed; expected make\(seed\) -> Environment"),
        (_no_environment, {}, "made a dict; expected a dm_env.Environment"),
        ("humanoid", {}, "domain is 'humanoid' and task is None; expected the name of a task"),
    ],
)
def test_what_cannot_be_evaluated_is_refused_before_anything_is_played(
    make: Any, kwargs: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        _of_function(make, out=tmp_path / "out", **kwargs)
    assert not (tmp_path / "out").exists()


def test_a_seed_that_makes_no_difference_is_refused() -> None:
    def unseeded(seed: int) -> Environment:
        return plain_domain.push()

    with pytest.raises(ValueError, match=r"differs each time it is called with seed 0"):
        _of_function(unseeded)


def test_a_task_that_cannot_be_vectorised_is_played_in_complete_environments() -> None:
    class OneOnly(plain_domain.Push):
        def get_reward(self, physics: Any) -> Any:
            return physics.data.qpos[0]

    def make(seed: int) -> Environment:
        environment = plain_domain.make(seed)
        environment._task = OneOnly(seed)
        return environment

    evaluation = _of_function(make, seeds=range(3))
    for score in evaluation.scores["random"]:
        episode = run_episode(make(score.seed), policies.random, score.seed)
        assert score.total == episode.total


def test_a_task_without_starts_has_no_strata_and_rewards_of_any_size() -> None:
    evaluation = _of_function(plain_domain.make, seeds=range(10))
    assert evaluation.strata() == {}
    returns = [score.total for score in evaluation.scores["random"]]
    assert min(returns) < 0 < max(returns)
    assert evaluation.summary().mean == np.mean(returns)
