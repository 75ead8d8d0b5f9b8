"""`Run`: episodes that are played, kept and shown. The commands are in cli/test_run.py."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import data, policies, suite
from limberjack.episodes.running import Run
from limberjack.mujoco.fingerprint import fingerprint
from limberjack.policies import PolicyError
from limberjack.rl.control import Environment
from limberjack.see.report import Recorder
from limberjack.workers import Scale
from tests import plain_domain
from tests.rollouts import run_episode

_TASK = ("pendulum", "swingup")
_SECONDS = 0.1  # 5 steps


@pytest.fixture(autouse=True)
def _no_films(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the films, which take longer than the episodes."""

    def missing(*arguments: object) -> None:
        raise ImportError("no film in this test")

    monkeypatch.setattr("limberjack.see.report.recorder.Film", missing)


def _run(out: Path | None = None, policy: object = "random", **how: Any) -> Run:
    arguments = {"seeds": range(3, 6), "time_limit": _SECONDS, "scale": Scale(num_threads=1), **how}
    return Run(*_TASK, policy, out=out, **arguments)


def _result(out: Path) -> dict[str, Any]:
    return json.loads((out / "result.json").read_text(encoding="utf-8"))


def test_episodes_are_those_of_their_seeds_and_nothing_is_written_without_a_folder() -> None:
    run = _run()
    assert (run.count, run.keeps, run.episodes) == (3, False, [])
    run.play()
    run.write()
    assert (run.written, run.left_out) == ([], [])
    for episode in run.episodes:
        environment = suite.load(*_TASK, {"random": episode.seed, "time_limit": _SECONDS})
        single = run_episode(environment, policies.find("random"), episode.seed)
        np.testing.assert_array_equal(episode.rewards, single.rewards)
    assert [episode.seed for episode in run.episodes] == [3, 4, 5]


def test_a_folder_has_the_result_and_the_steps(tmp_path: Path) -> None:
    run = _run(tmp_path)
    assert run.keeps
    shown: list[tuple[str, int, float]] = []
    run.play(lambda *now: shown.append(now))
    run.write()
    names = ["result.json", "return.png", "report.html", "episodes"]
    assert [path.name for path in run.written] == names
    assert run.left_out == ["no video.mp4: no film in this test"]
    assert shown[0] == ("random", 0, 0.0)
    assert shown[-1][:2] == ("random", 3)
    result, dataset = _result(tmp_path), data.load(tmp_path)
    environment = suite.load(*_TASK)
    assert result["fingerprint"] == fingerprint(environment.physics.model._official)
    assert (result["time_limit"], result["episodes_asked_for"]) == (_SECONDS, 3)
    for one, listed, kept in zip(run.episodes, result["episodes"], dataset, strict=True):
        assert (one.seed, one.total) == (listed["seed"], listed["return"])
        np.testing.assert_array_equal(one.rewards, kept.rewards)
        assert kept.states is not None


def test_the_time_limit_is_the_tasks_own_if_none_is_given(tmp_path: Path) -> None:
    run = _run(tmp_path, time_limit=None)
    run.write()
    assert _result(tmp_path)["time_limit"] == 20.0


def test_the_same_run_plays_only_what_is_missing(tmp_path: Path) -> None:
    _run(tmp_path, seeds=[3, 4]).play()
    begun: list[int] = []

    class Counting(Run):
        def _watch(self, step: Any) -> None:
            if step.actions is None:
                begun.extend(step.seeds[step.rows].tolist())
            super()._watch(step)

    again = Counting(*_TASK, "random", range(3, 6), out=tmp_path, time_limit=_SECONDS)
    again.play()
    assert begun == [5]
    assert [episode.seed for episode in again.episodes] == [3, 4, 5]


@pytest.mark.parametrize("replaces", [False, True])
def test_another_recipe_replaces_the_steps_of_an_earlier_run_if_asked(
    replaces: bool, tmp_path: Path
) -> None:
    first = _run(tmp_path, seeds=[3, 4])
    first.play()
    other = _run(tmp_path, time_limit=0.06, replaces=True)
    with pytest.raises(ValueError, match=r"belongs to another dataset .* whose time_limit is"):
        other.play()  # without a result they are not those of a run
    first.write()
    (tmp_path / "README.md").write_text("a user's own")
    other = _run(tmp_path, time_limit=0.06, replaces=replaces)
    if not replaces:
        with pytest.raises(ValueError, match=r"belongs to another dataset .* whose time_limit is"):
            other.play()
        assert list(data.load(tmp_path).seeds) == [3, 4]
        assert other.episodes == []  # those that are there are not its own
        return
    other.play()
    assert [episode.length for episode in data.load(tmp_path)] == [3, 3, 3]
    assert (tmp_path / "README.md").read_text() == "a user's own"


def test_shards_keep_steps_only_and_the_run_without_one_joins_them(tmp_path: Path) -> None:
    seeds = range(63, 66)
    for number in (1, 2):
        shard = _run(tmp_path, seeds=seeds, shard=(number, 2))
        shard.play()
        shard.write()
        assert (shard.count, shard.written) == (number, [])
    assert not (tmp_path / "result.json").exists()
    whole = _run(tmp_path, seeds=seeds)
    whole.play()
    whole.write()
    assert [episode["seed"] for episode in _result(tmp_path)["episodes"]] == list(seeds)


# Those that write files: see tests/cli/test_solve.py.
def test_workers_play_the_same_episodes() -> None:
    runs, shown = [], list[tuple[str, int, float]]()
    for scale in (Scale(num_threads=1), Scale(workers=2)):
        runs.append(_run(None, seeds=range(62, 66), scale=scale))
        runs[-1].play(lambda *now: shown.append(now))
        assert shown[-1] == ("random", 4, 0.0)
    assert min(part for _, _, part in shown) == 0.0
    for one, other in zip(runs[0].episodes, runs[1].episodes, strict=True):
        assert (one.seed, one.start) == (other.seed, other.start)
        np.testing.assert_array_equal(one.rewards, other.rewards)


class _Failing:
    """Fails in the second episode."""

    episodes = 0

    def reset(self) -> None:
        self.episodes += 1

    def act(self, observation: object) -> np.ndarray:
        return np.zeros(1 if self.episodes < 2 else 2)


@pytest.mark.parametrize("keeps", [False, True])
def test_what_ended_before_an_error_is_there(keeps: bool, tmp_path: Path) -> None:
    run = _run(tmp_path if keeps else None, _Failing)
    with pytest.raises(PolicyError):
        run.play()
    run.write()
    assert [episode.seed for episode in run.episodes] == [3]
    if keeps:
        assert [episode["seed"] for episode in _result(tmp_path)["episodes"]] == [3]
    assert all(path.exists() for path in run.written)


def test_an_actor_acts_in_the_place_of_the_policy_and_its_plans_are_charted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []  # stages of plans, and steps

    class Noting(Recorder):
        def add_plan(self, stage: str, terms: Any) -> None:
            drawn.append(stage)
            super().add_plan(stage, terms)

        def add_step(self, step: Any) -> None:
            drawn.append(f"step {step.number}")
            super().add_step(step)

    monkeypatch.setattr("limberjack.see.report.Recorder", Noting)
    actor = policies.find("zero")
    run = _run(tmp_path, "random", actor=actor, seeds=[3])
    run.play()
    assert not run.episodes[0].actions.any()
    for number, stage in enumerate(["swing up", "brake", "balance"]):
        run.add_plan(0.02 * number, stage, {"height": 1.5})
    run.write()
    steps = "step 0, swing up, step 1, brake, step 2, balance, step 3, step 4, step 5"
    assert drawn == steps.split(", ")
    assert "swing up" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_film_of_another_episode_is_dropped(
    tmp_path: Path,
) -> None:
    run = _run(tmp_path, seeds=[3])
    run.play()
    (episode,) = run.episodes
    rewards = episode.rewards.copy()
    rewards[2] += 1.0
    run._end(dataclasses.replace(episode, rewards=rewards))  # as on another processor
    run.write()
    (line,) = [line for line in run.left_out if "seed 3" in line]
    assert line.startswith("the film is not that of seed 3: its return differs by 1 here")


class _Undefined(plain_domain.Push):
    def get_reward(self, physics: Any) -> Any:
        return np.nan * physics.data.qpos[..., 0]


def _undefined(seed: int) -> Environment:
    physics = plain_domain.push().physics
    return Environment(physics, _Undefined(seed), time_limit=_SECONDS, control_timestep=0.02)


def test_a_film_of_an_episode_whose_rewards_are_no_numbers_is_that_of_the_episode(
    tmp_path: Path,
) -> None:
    run = Run(_undefined, policy="random", out=tmp_path, scale=Scale(num_threads=1))
    run.play()
    run.write()
    assert np.isnan(run.episodes[0].rewards).all()
    assert run.left_out == ["no video.mp4: no film in this test"]


def test_without_pyarrow_all_but_the_steps_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(run: Run) -> bool:
        run.left_out.append("no episodes: needs the extra 'data': pip install fsspec pyarrow")
        return False

    monkeypatch.setattr(Run, "_can_keep", missing)
    run = _run(tmp_path)
    run.play()
    run.write()
    assert not run.keeps
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"result.json", "return.png", "report.html"}
    assert "no episodes: needs the extra 'data'" in run.left_out[0]


@pytest.mark.parametrize("repeat", [None, 2])
def test_actions_are_repeated_as_the_environment_does_or_as_asked(
    repeat: int | None, tmp_path: Path
) -> None:
    run = Run(_repeating, None, "random", out=tmp_path, action_repeat=repeat)
    run.play()
    (episode,) = run.episodes
    assert episode.length == 25
    changes = np.flatnonzero(np.diff(episode.actions[:, 0])) + 1
    assert changes.tolist() == list(range(repeat or 3, 25, repeat or 3))
    run.write()
    assert _result(tmp_path)["action_repeat"] == (repeat or 3)


def _repeating(seed: int) -> Any:
    return plain_domain.push(random=seed, environment_kwargs={"action_repeat": 3})


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"seeds": [-1]}, "seed is -1"),
        ({"seeds": []}, "there are no seeds; expected at least one, such as range"),
        ({"seeds": [4, 3]}, "seed 3 follows 4; expected increasing seeds"),
        ({"policy": "radnom"}, "Did you mean 'random'"),
        ({"time_limit": 0.0}, "time_limit is 0.0; expected a positive number"),
        ({"time_limit": float("inf")}, "pendulum swingup has no time limit"),
        ({"action_repeat": 0}, "action_repeat is 0"),
        ({"shard": (3, 2)}, "shard is 3/2; expected K/N"),
    ],
)
def test_arguments_are_checked_before_anything_is_played_or_written(
    how: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        _run(tmp_path / "out", **how)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_other_results_is_refused_at_once(tmp_path: Path) -> None:
    _run(tmp_path).write()
    with pytest.raises(ValueError, match="holds results with policy 'random', and these have 'zer"):
        _run(tmp_path, "zero")


class _Still:
    """Episodes of it are played one by one, each a file of its own."""

    def reset(self) -> None: ...

    def act(self, observation: object) -> np.ndarray:
        return np.zeros(1)


def test_an_interrupted_run_shows_what_earlier_calls_have_kept(tmp_path: Path) -> None:
    def interrupt_after(count: int) -> Any:
        def show(what: str, finished: int, part: float = 0.0) -> None:
            if finished >= count:
                raise KeyboardInterrupt

        return show

    shown = []
    for count in (1, 0):
        run = _run(tmp_path, _Still, replaces=True)
        with pytest.raises(KeyboardInterrupt):
            run.play(interrupt_after(count))
        run.write()
        shown.append([episode["seed"] for episode in _result(tmp_path)["episodes"]])
    assert shown[1] == shown[0]
    assert 0 < len(shown[0]) < 3
