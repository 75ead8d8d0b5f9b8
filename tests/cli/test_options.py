"""Arguments and options that several commands have: tasks, environments, seeds, and their words."""

import json
import os
import re
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.models import OptionInfo

from limberjack import data
from limberjack.cli import app
from limberjack.cli.options import (
    chosen_seeds,
    function_named,
    named_environment,
    named_task,
    shard_named,
    world_named,
)
from limberjack.utils import png
from limberjack.utils.seeds import SEEDS
from tests.cli.conftest import call, invoke

from . import environments

# Options of one name that differ between commands, and why.
_DIFFERENT = {
    ("bench", "--threads"): "several numbers, each of which it measures",
    ("bench", "--seconds"): "of a measurement; those of record are simulated",
    ("evaluate", "--policy"): "is given once for each run with --set",
    ("convert", "--out"): "a folder of Minari's, which holds many datasets",
    ("collect", "--out"): "may be a URL",
    ("record", "--out"): "one file",
    ("info", "--json"): "has more than doctor's and list's",
    ("list", "--json"): "is a list of tasks",
    ("policies", "--json"): "is a list of policies",
    ("train", "--seed"): "of a run, not of an episode",
    ("export", "--action-repeat"): "that of the training, which the model does not know",
    ("view", "--policy"): "may be repeated, to choose from several on the page",
    ("view", "--explain"): "is shown live, and not printed after an episode",
}


@pytest.fixture(autouse=True)
def _empty_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plots, which take longer to draw than these episodes to play, are empty files."""
    if figure := sys.modules.get("matplotlib.figure"):
        monkeypatch.setattr(figure.Figure, "savefig", lambda _, path, **__: Path(path).touch())


@pytest.mark.parametrize("arguments", [("humanoid", "walk"), ("humanoid/walk", None)])
def test_a_task_is_named_by_two_words_or_one(arguments: tuple[str, str | None]) -> None:
    assert named_task(*arguments) == ("humanoid", "walk")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("humanoid", None),
            "got humanoid without a task; choose one of: run, run_pure_state, sta",
        ),
        (
            ("humanod", None),
            "got humanod without a task; expected DOMAIN TASK or DOMAIN/TASK. Did ",
        ),
        (("humanoid/walk", "walk"), "got humanoid/walk and walk; expected DOMAIN TASK or DOMAIN/T"),
    ],
)
def test_a_task_named_by_none_or_both_is_refused(
    arguments: tuple[str, str | None], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        named_task(*arguments)


@pytest.mark.parametrize(
    ("seeds", "episodes", "expected"),
    [
        (None, None, range(7)),
        (None, 3, range(3)),
        ("5", None, range(5, 6)),
        ("3:13", None, range(3, 13)),
        ("3:13", 4, range(3, 7)),
        (f"{SEEDS - 1}", 1, range(SEEDS - 1, SEEDS)),
    ],
)
def test_seeds_are_given_by_their_range_their_number_or_both(
    seeds: str | None, episodes: int | None, expected: range
) -> None:
    assert chosen_seeds(seeds, episodes, 7) == expected


@pytest.mark.parametrize(
    ("seeds", "episodes", "message"),
    [
        ("a", None, "--seeds is 'a'; expected A:B, such as 0:100"),
        ("-1:5", None, "--seeds is '-1:5'; expected A:B"),
        ("5:", None, "--seeds is '5:'; expected A:B"),
        ("5:5", None, "--seeds is 5:5, which holds no seed; expected A:B with A below B"),
        (f"0:{SEEDS + 1}", None, f"expected numbers up to {SEEDS - 1}"),
        (f"{SEEDS}", None, f"expected numbers up to {SEEDS - 1}"),
        ("0:4", 5, "--episodes is 5, but --seeds 0:4 holds 4: give more seeds"),
        ("4", 2, "--episodes is 2, but --seeds 4 holds 1: give more seeds"),
    ],
)
def test_seeds_that_are_no_range_or_too_few_are_refused(
    seeds: str, episodes: int | None, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        chosen_seeds(seeds, episodes, 7)


def test_an_environment_is_a_task_or_a_function(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))  # the working directory is added
    assert named_environment("humanoid/walk", None, None) == ("humanoid", "walk")
    own = "tests.cli.environments:plain"
    assert named_environment(None, None, own) == (environments.plain, None)
    with pytest.raises(ValueError, match="got no task; expected DOMAIN TASK, or --env MODULE:FUN"):
        named_environment(None, None, None)
    with pytest.raises(ValueError, match=f"got humanoid and --env {own}; expected one of them"):
        named_environment("humanoid", "walk", own)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("tests.cli.environments:plian", "Did you mean 'plain'?"),
        ("tests.cli.environments:not_a_function", "is a int; expected a function make(seed)"),
        ("no_module:make", "there is no module 'no_module'"),
        ("plain", "--env is 'plain'; expected MODULE:NAME"),
    ],
)
def test_a_function_that_does_not_exist_is_refused(
    name: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    with pytest.raises(ValueError, match="--env") as caught:
        function_named(name)
    assert message in str(caught.value)


def test_a_shard_is_named_by_its_number_and_that_of_all() -> None:
    assert shard_named("3/8", "out") == (3, 8)
    assert shard_named(None, None) is None


@pytest.mark.parametrize("shard", ["0/8", "9/8", "3", "3/", "a/b", "3/8/9", "-1/8"])
def test_a_shard_that_does_not_exist_is_refused(shard: str) -> None:
    with pytest.raises(ValueError, match="expected K/N with K from 1 to N, such as 3/8"):
        shard_named(shard, "out")


def test_a_shard_needs_a_folder() -> None:
    with pytest.raises(ValueError, match="--shard 3/8 needs --out DIR"):
        shard_named("3/8", None)


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["run"], "humanoid/wlak"),
        (["run"], "humanoid/"),
        (["run"], "/walk"),
        (["solve"], "humanoid/wlak"),
        (["view"], "humanoid/wlak"),
        (["bench", "--num-envs", "2"], "humanoid/wlak"),
        (["evaluate", "--seeds", "0:2"], "humanoid/wlak"),
        (["record", "--out", "film.mp4"], "humanoid/wlak"),
    ],
)
def test_every_command_that_takes_a_task_takes_one_word(
    command: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*command, name)
    assert result.exit_code == 2
    expected = "Choose one of: run, run_pure_state, stand, walk." if "humanoid" in name else "''"
    assert expected in result.stderr
    assert result.stderr.count("\n") == 1
    assert invoke(*command, "humanoid").stderr.startswith("limberjack: got humanoid without a task")
    assert list(tmp_path.iterdir()) == []


def _options() -> Iterator[tuple[str, str, tuple[object, ...]]]:
    """Each command with each of its options, and everything that the help page says of it."""
    for command in app.registered_commands:
        assert command.name is not None
        assert command.callback is not None
        for name, hint in typing.get_type_hints(command.callback, include_extras=True).items():
            (info,) = getattr(hint, "__metadata__", [None])
            if isinstance(info, OptionInfo):
                kind = typing.get_args(hint)[0]
                of_value = {kind} if kind in (str, int, float, bool, Path) else {
                    one for one in typing.get_args(kind) if one is not type(None)
                }  # fmt: skip
                declared = (info.param_decls or [f"--{name.replace('_', '-')}"])[0]
                described = info.min, info.max, info.metavar, info.help
                yield command.name, declared, (frozenset(of_value), *described)


def test_an_option_of_one_name_is_the_same_in_all_commands() -> None:
    by_name: dict[str, dict[tuple[object, ...], list[str]]] = {}
    for command, name, described in _options():
        if (command, name) not in _DIFFERENT:
            by_name.setdefault(name, {}).setdefault(described, []).append(command)
    assert {name: list(kinds.items()) for name, kinds in by_name.items() if len(kinds) > 1} == {}
    shared = {
        "--seeds", "--episodes", "--time-limit", "--action-repeat", "--workers", "--out",
        "--threads", "--policy", "--env", "--shard", "--ray", "--any-processor", "--seed",
    }  # fmt: skip
    for name in shared:
        ((_, commands),) = by_name[name].items()
        assert len(commands) > 1, name


def test_the_options_that_differ_exist() -> None:
    assert _DIFFERENT.keys() <= {(command, name) for command, name, _ in _options()}


def test_every_command_that_plays_takes_a_users_environment() -> None:
    takes = {command for command, name, _ in _options() if name == "--env"}
    assert takes == {"collect", "evaluate", "record", "replay", "run", "solve", "train", "view"}


_OWN = ["plain", "bare", "remembering", "delayed", "nested"]
_VECTORISED = ("plain", "bare")


def _env(name: str) -> list[str]:
    return ["--env", f"tests.cli.environments:{name}"]


@pytest.mark.usefixtures("no_films")
@pytest.mark.parametrize("name", _OWN)
def test_a_users_environment_is_evaluated_collected_run_and_replayed(
    name: str, tmp_path: Path
) -> None:
    options = [*_env(name), "--policy", "random", "--seeds", "3:5", "--threads", "1"]
    returns: dict[str, dict[int, float]] = {}
    for command in ("evaluate", "collect", "run"):
        out = tmp_path / command
        result = invoke(command, *options, "--out", str(out))
        assert result.exit_code == 0, result.output
        assert ("limberjack: not vectorised: " in result.stderr) == (name not in _VECTORISED)
        if command != "collect":
            listed = json.loads((out / "result.json").read_text())["episodes"]
            returns[command] = {one["seed"]: one["return"] for one in listed}
        if command != "evaluate":
            kept = {episode.seed: episode.total for episode in data.load(out)}
            assert returns.setdefault(command, kept) == kept
            replayed = invoke("replay", str(out), *_env(name))
            assert replayed.exit_code == 0, replayed.output
            assert replayed.stdout.endswith(", every bit the same\n")
    assert returns["evaluate"] == returns["collect"] == returns["run"]
    assert list(returns["run"]) == [3, 4]


@pytest.mark.parametrize("command", ["collect", "evaluate", "run"])
def test_a_kind_of_batch_may_be_asked_for_and_changes_no_number(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.see.video.Film.add", lambda film, physics: None)  # takes long
    play = [command, "--policy", "random", "--seeds", "0:2", "--threads", "1", "--out"]
    returns = []
    for kind in ("--vectorised", "--no-vectorised"):
        out = tmp_path / kind
        result = invoke(*play, str(out), *_env("plain"), kind)
        assert result.exit_code == 0, result.output
        name = "dataset.json" if command == "collect" else "result.json"
        returns.append((out / name).read_bytes())
    assert returns[0] == returns[1]
    refused = invoke(*play, str(tmp_path / "out"), *_env("remembering"), "--vectorised")
    assert refused.exit_code == 2
    assert refused.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert "task LastAction sets self.last" in refused.stderr


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize("name", _OWN)
def test_a_users_environment_is_filmed_from_its_start_and_from_a_dataset(
    name: str, tmp_path: Path
) -> None:
    size = ["--height", "32", "--width", "48"]
    for rows in ("1", "2"):
        film = tmp_path / f"{rows}.gif"
        result = invoke("record", *_env(name), *size, "--rows", rows, "--out", str(film))
        assert (result.exit_code, result.stdout) == (0, f"{film}\n"), result.output
    out = tmp_path / "out"
    assert invoke("collect", *_env(name), "--seeds", "3", "--out", str(out)).exit_code == 0
    film = ["record", "--from", str(out), *size, "--seed", "3", "--out", str(tmp_path / "3.gif")]
    assert invoke(*film, *_env(name)).exit_code == 0
    without = invoke(*film)
    assert without.exit_code == 2
    assert f"{getattr(environments, name).__name__} makes: give that function" in without.stderr


@pytest.mark.parametrize("name", ["plain", "bare", "remembering", "delayed"])
def test_a_users_environment_is_viewed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(
        "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
    )
    from limberjack import viewer

    heights: list[float] = []

    def show(session: Any) -> None:
        session.step()
        heights.append(float(session.data.qpos[0]))

    monkeypatch.setattr(viewer, "in_window", lambda: show)
    result = invoke("view", *_env(name), "--native", "--seed", "5", "--policy", "zero")
    assert result.exit_code == 0, result.output
    single = getattr(environments, name)(5)
    single.reset()
    single.step([0.0])
    assert heights == [single.physics.data.qpos[0]]


def test_a_wrapper_without_a_simulation_of_its_own_is_not_viewed() -> None:
    result = invoke("view", *_env("nested"), "--native")
    assert result.exit_code == 2
    assert "a Repeating has no physics, which a viewer needs" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_task_of_the_suite_is_solved_the_same_under_another_name(tmp_path: Path) -> None:
    own = invoke("solve", *_env("arm"), "--threads", "1", "--out", str(tmp_path))
    assert own.exit_code == 0, own.output
    arm = ["manipulator", "bring_ball", "--time-limit", "0.05"]
    named = invoke("solve", *arm, "--threads", "1")
    assert own.stdout.splitlines()[:3] == named.stdout.splitlines()
    (episode,) = data.load(tmp_path)
    assert data.load(tmp_path).recipe.facts["environment"] == "tests.cli.environments:arm"
    assert f" {episode.total:.3f} " in named.stdout


def test_an_environment_repeats_actions_as_it_says_unless_it_is_asked_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.see.video.Film.add", lambda film, physics: None)  # takes long
    for command in ("run", "collect", "evaluate"):
        for options, repeat in (([], 3), (["--action-repeat", "2"], 2)):
            out = tmp_path / f"{command}-{repeat}"
            play = [*_env("repeating"), "--policy", "random", "--seeds", "0", "--out", str(out)]
            result = invoke(command, *play, *options)
            assert result.exit_code == 0, result.output
            recorded = "result.json" if command != "collect" else "dataset.json"
            assert f'"action_repeat": {repeat}' in (out / recorded).read_text()
            if command != "evaluate":
                actions = data.load(out).episode(0).actions[:, 0].tolist()
                assert len(set(actions)) == -(-25 // repeat)
                assert invoke("replay", str(out), *_env("repeating")).exit_code == 0


_NOT_MADE = [
    (["humanoid", "walk", *_env("plain")], "got humanoid and --env tests.cli.environments:pl"),
    (_env("plian"), "Did you mean 'plain'?"),
    (_env("not_a_function"), "expected a function make(seed)"),
    (_env("nothing"), "made a NoneType; expected a dm_env.Environment"),
    (_env("failing"), "ZeroDivisionError: "),
]


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [
        *(("run", *one) for one in _NOT_MADE),
        *((command, *_NOT_MADE[0]) for command in ("collect", "evaluate", "record", "solve")),
        *((command, *_NOT_MADE[-1]) for command in ("collect", "evaluate", "record", "solve")),
        *(("view", *one) for one in _NOT_MADE),
    ],
)
def test_an_environment_that_cannot_be_made_is_one_line_and_status_2(
    command: str, arguments: list[str], message: str, tmp_path: Path
) -> None:
    out = {"record": ["--out", str(tmp_path / "film.gif")], "view": ["--native"]}
    options = out.get(command, ["--out", str(tmp_path / "out"), "--seeds", "0:2"])
    result = invoke(command, *arguments, *options)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert result.stderr.startswith("limberjack: ")
    assert result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["collect", "evaluate", "run"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (_env("endless"), "has no time limit, so an episode might never end"),
        (_env("different"), "makes an environment that differs each time it is called with seed 0"),
        (_env("divided"), "environment 'tests.cli.environments:divided': TypeError: action_spec"),
        (
            [*_env("plain"), "--time-limit", "1"],
            "--time-limit is 1.0, but --env tests.cli.environments:plain makes",
        ),
    ],
)
def test_an_environment_that_cannot_be_kept_is_one_line_and_status_2(
    command: str, arguments: list[str], message: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    result = invoke(command, *arguments, "--seeds", "0:2", "--out", str(out))
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
    assert not out.exists()


_MODULE = """
from limberjack import suite

def make(seed):
    return suite.load("pendulum", "swingup", {"random": seed, "time_limit": 0.1})
"""


def test_a_function_is_found_in_the_working_directory(tmp_path: Path) -> None:
    (tmp_path / "my_package.py").write_text(_MODULE)
    (tmp_path / "matplotlib.py").write_text("raise SystemExit('the stray one')")
    own = ["--env", "my_package:make"]
    options = [*own, "--workers", "1", "--seeds", "0:2", "--out", "out"]
    done = call("collect", *options, directory=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(data.load(tmp_path / "out")) == 2
    again = call("replay", "out", *own, directory=tmp_path)
    assert again.stdout == "out: 2 episodes, 10 steps, every bit the same\n"


_TASK = ["pendulum", "swingup"]


@pytest.mark.parametrize(
    "command",
    [
        ["evaluate", *_TASK],
        ["evaluate", "--set", "pendulum:swingup"],
        ["run", *_TASK],
        ["solve", *_TASK],
        ["train", *_TASK],
        ["convert", "walk", "--to", "lerobot"],
    ],
)
def test_results_other_than_datasets_are_not_written_to_a_url(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(*command, "--out", "s3://bucket/scores")
    assert result.exit_code == 2, result.output
    assert "s3://bucket/scores is a URL; expected a folder" in " ".join(result.stderr.split())
    assert list(tmp_path.iterdir()) == []


def test_faults_are_a_name_a_mapping_or_a_file(tmp_path: Path) -> None:
    assert world_named() is None
    assert world_named(faults="easy") == {"faults": "easy"}
    expected = {"faults": {"delay": {"actions": 3}}}
    assert world_named(faults='{"delay": {"actions": 3}}') == expected
    for name, text in (("a.toml", "delay.actions = 3"), ("a.json", '{"delay": {"actions": 3}}')):
        (tmp_path / name).write_text(text)
        assert world_named(faults=str(tmp_path / name)) == expected


@pytest.mark.parametrize(
    ("faults", "env", "message"),
    [
        ("eesy", None, "there are no faults 'eesy'.*Did you mean 'easy'"),
        ('{"dealy": {}}', None, "faults has no 'dealy'. Did you mean 'delay'"),
        ("{", None, "--faults { is no mapping"),
        ("no.toml", None, "--faults no.toml cannot be read"),
        ("easy", "module:make", "got --faults and --env module:make, which makes the environment"),
    ],
)
def test_faults_that_do_not_exist_are_refused(faults: str, env: str | None, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        world_named(env, faults)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_faults_in_a_pipe_are_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "faults.json")
    with pytest.raises(ValueError, match=r"cannot be read: .* is a pipe; expected a regular file"):
        world_named(faults=str(tmp_path / "faults.json"))


def test_an_unknown_fault_is_one_line_and_status_2_in_every_command(tmp_path: Path) -> None:
    task = ("reacher", "easy", "--faults", "eesy")
    commands = [(name,) for name in ("run", "evaluate", "view", "solve")]
    commands += [("collect", "--out", str(tmp_path)), ("record", "--out", str(tmp_path / "a.gif"))]
    for name, *more in commands:
        result = invoke(name, *task, *more)
        assert result.exit_code == 2, (name, result.output)
        assert "there are no faults 'eesy'" in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_faults_are_evaluated_and_collected_and_replayed_as_part_of_the_identity(
    tmp_path: Path,
) -> None:
    task = ("reacher", "easy", "--time-limit", "0.1", "--seeds", "0:2", "--threads", "1")
    folder = ("--out", str(tmp_path / "scores"))
    assert invoke("evaluate", *task, *folder, "--faults", "hard").exit_code == 0
    found = json.loads((tmp_path / "scores" / "result.json").read_text())
    assert found["world"]["faults"]["dummies"] == 50
    other = invoke("evaluate", *task, *folder)
    assert other.exit_code == 2
    assert "world" in other.stderr
    kept = ("--out", str(tmp_path / "data"), "--policy", "random", "--states")
    assert invoke("collect", *task, *kept, "--faults", '{"delay": {"rewards": 2}}').exit_code == 0
    dataset = data.load(tmp_path / "data")
    world: Any = dataset.recipe.facts["world"]
    assert world["faults"]["delay"]["rewards"] == 2
    assert data.replay(dataset, num_threads=1) is None
    assert invoke("collect", *task, *kept).exit_code == 2


def test_an_appearance_is_a_preset_a_mapping_or_a_file(tmp_path: Path) -> None:
    assert world_named(appearance="color_hard") == {"appearance": "color_hard"}
    expected = {"appearance": {"colors": "hard"}}
    assert world_named(appearance='{"colors": "hard"}') == expected
    (tmp_path / "a.toml").write_text('colors = "hard"', encoding="utf-8")
    assert world_named(appearance=str(tmp_path / "a.toml")) == expected
    both = world_named(faults="easy", appearance="color_hard")
    assert both == {"faults": "easy", "appearance": "color_hard"}


@pytest.mark.parametrize(
    ("command", "appearance", "message"),
    [
        ("run", "color_hrad", "no preset 'color_hrad'. Did you mean 'color_hard'"),
        ("collect", "distracting_cs:0.7", "no intensity '0.7'; expected one of 0.025"),
        ("evaluate", '{"color": 1}', "no option 'color'. Did you mean 'colors'"),
        (
            "run",
            '{"background": "images:EMPTY"}',
            "EMPTY, which has no picture",
        ),
        (
            "evaluate",
            '{"background": "video:EMPTY/x.mp4"}',
            "EMPTY/x.mp4 cannot be read: ",
        ),
    ],
)
def test_an_appearance_that_cannot_be_shown_is_one_line_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, appearance: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "EMPTY").mkdir()
    (tmp_path / "EMPTY" / "x.mp4").write_text("no video", encoding="utf-8")
    result = invoke(command, "reacher", "easy", "--out", "new", "--appearance", appearance)
    assert result.exit_code == 2, result.output
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["EMPTY"]


def test_an_appearance_is_part_of_the_identity_of_results_and_of_the_recipe_of_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "somewhere" / "photos"
    folder.mkdir(parents=True)
    (folder / "one.png").write_bytes(png.encode(np.full((4, 4, 3), 9, np.uint8)))
    task = ("reacher", "easy", "--time-limit", "0.1", "--seeds", "0:2")
    scores = ("--out", str(tmp_path / "scores"), "--threads", "1")
    assert invoke("evaluate", *task, *scores, "--appearance", "color_hard").exit_code == 0
    found = json.loads((tmp_path / "scores" / "result.json").read_text())
    assert found["world"] == {"appearance": {"palette": 0.2}}
    other = invoke("evaluate", *task, *scores, "--appearance", "color_easy")
    assert other.exit_code == 2
    assert "world" in other.stderr
    kept = ("--out", str(tmp_path / "data"), "--policy", "random", "--states", "--threads", "1")
    shown = ("--appearance", json.dumps({"background": f"images:{folder}"}))
    assert invoke("collect", *task, *kept, *shown).exit_code == 0
    dataset = data.load(tmp_path / "data")
    world: Any = dataset.recipe.facts["world"]
    assert world["appearance"]["background"] == "images:photos"
    assert len(world["appearance"]["files"]) == 64
    assert str(tmp_path) not in dataset.recipe.text(range(2))
    missing = rf"images:{re.escape(str(tmp_path / 'photos'))}, which does not exist; .* run this "
    with pytest.raises(ValueError, match=missing + "where the folder is"):
        data.replay(dataset, num_threads=1)
    monkeypatch.chdir(folder.parent)
    assert data.replay(dataset, num_threads=1) is None
    (folder / "one.png").write_bytes(png.encode(np.full((4, 4, 3), 8, np.uint8)))
    with pytest.raises(ValueError, match="has other files than those"):
        data.replay(dataset, num_threads=1)


def test_a_function_that_makes_other_models_for_other_seeds_is_viewed_from_its_seed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip(
        "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
    )
    from limberjack import viewer

    (tmp_path / "by_seed.py").write_text(_BY_SEED)
    monkeypatch.chdir(tmp_path)
    shown: list[Any] = []

    def show(session: Any) -> None:
        shown.append((float(session.model.body_mass[1]), session.status().seed))

    monkeypatch.setattr(viewer, "in_window", lambda: show)
    result = invoke("view", "--env", "by_seed:make", "--native", "--seed", "3")
    assert result.exit_code == 0, result.output
    assert shown == [(4.0, None)]
    assert "makes another environment for each seed" in result.stderr


_BY_SEED = """
from limberjack.rl import control
from limberjack.suite import pendulum

def make(seed):
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    physics.model.body_mass[1] = 1.0 + seed
    return control.Environment(physics, pendulum.SwingUp(random=seed), time_limit=0.2)

def of_no_seed():
    return make(0)
"""


def test_a_function_of_no_seed_and_an_endless_nesting_are_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "without_seed.py").write_text(_BY_SEED)
    monkeypatch.chdir(tmp_path)
    result = invoke("evaluate", "--env", "without_seed:of_no_seed", "--policy", "zero")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "without_seed:of_no_seed takes no seed; expected a function make(seed)" in result.stderr
    nested = '{"a": ' + "[" * 100_000
    with pytest.raises(ValueError, match="is no mapping"):
        world_named(faults=nested)
    repeat = ["--action-repeat", str(10**20)]
    assert invoke("evaluate", "pendulum", "swingup", "--policy", "zero", *repeat).exit_code == 2
