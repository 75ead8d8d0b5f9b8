"""The scores of runs on a set of tasks, by the protocol of papers."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.evaluation import evaluate, protocol, statistics
from limberjack.evaluation.protocol import TaskScores, episodes_of, evaluate_set
from limberjack.policies import PolicyError, mlp
from limberjack.registry.sets import TaskSet
from limberjack.workers import State
from limberjack.worlds.appearance import Appearance
from limberjack.worlds.faults import Faults

from . import brief

_FAST = TaskSet("fast", (("brief", "balance"), ("brief", "swingup")), "this test")


@pytest.fixture(scope="module", autouse=True)
def _registered() -> Iterator[None]:
    suite.register("brief", brief)
    yield
    suite.unregister("brief")


@pytest.fixture(autouse=True)
def _few_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(protocol, "_SEEDS", range(30_000, 30_002))


def test_a_score_is_the_mean_return_that_evaluate_measures() -> None:
    found = evaluate_set(_FAST, ["zero", "random"], num_threads=1)
    assert found.runs == ("zero", "random")
    assert [(one.domain, one.task) for one in found.tasks] == list(_FAST.tasks)
    for run, policy in enumerate(found.runs):
        for one in found.tasks:
            alone = evaluate(
                one.domain, one.task, policy, range(30_000, 30_002), action_repeat=2, num_threads=1
            )
            assert one.returns[run] == alone.summary().mean
            assert one.floors["random"] == alone.summary("random").mean
    assert found.scores.shape == (2, 2)
    assert found.scores[0, 1] == found.tasks[1].returns[0] / 1000
    assert found.interquartile_mean == statistics.interquartile_mean(found.scores)
    assert found.interval == statistics.stratified_interval(found.scores)
    assert found.percentiles == statistics.percentiles(found.scores)
    assert found.missing == {}


def test_actions_are_repeated_twice_and_a_task_without_a_limit_has_a_thousand_steps() -> None:
    actions: list[int] = []

    def counting(observation: object) -> np.ndarray:
        actions.append(1)
        return np.zeros(1)

    found = evaluate_set(TaskSet("one", (("lqr", "lqr_2_1"),), "here"), counting, num_threads=1)
    (one,) = found.tasks
    assert (one.control_steps, one.action_repeats, one.agent_steps) == (1000, (2,), (500,))
    assert len(actions) == 2 * 500  # of two episodes
    assert found.interval is None  # one run has no spread


def test_a_policy_that_demands_a_number_of_repeats_is_played_with_it() -> None:
    plans, _ = protocol._planned(_FAST, ["planner", "zero"])
    assert plans["brief", "swingup"].action_repeats == (None, 2)  # the planner demands 1
    scores = TaskScores("walker", "walk", (1.0, 2.0), (1, 2), 1000, {})
    assert scores.agent_steps == (1000, 500)


def test_policies_in_files_play_at_their_own_repeat_where_there_is_one(tmp_path: Path) -> None:
    card = mlp.Card(
        layout=(("orientation", (2,)), ("velocity", (1,))),
        low=(-1.0,),
        high=(1.0,),
        activation="relu",
        end="none",
        action_repeat=4,
    )
    layer = np.ones((1, 3), np.float32), np.zeros(1, np.float32)
    mlp.save(tmp_path / "brief-swingup.safetensors", [layer], card)
    run = f"mlp:{tmp_path}/{{domain}}-{{task}}.safetensors"
    found = evaluate_set(_FAST, [run, "zero"], num_threads=1)
    (one,) = found.tasks
    assert (one.domain, one.action_repeats, one.agent_steps) == ("brief", (4, 2), (13, 25))
    policy = run.format(domain="brief", task="swingup")
    alone = evaluate("brief", "swingup", policy, protocol._SEEDS)
    assert one.returns[0] == alone.summary().mean
    assert found.runs == (run, "zero")
    ((task, reason),) = found.missing.items()
    assert task == ("brief", "balance")
    assert "brief-balance.safetensors" in reason


def test_every_task_of_the_suite_with_a_time_limit_has_the_steps_of_the_protocol() -> None:
    tasks = TaskSet("two", (("walker", "walk"), ("manipulator", "bring_ball")), "here")
    plans, _ = protocol._planned(tasks, ["zero"])
    assert [plan.time_limit for plan in plans.values()] == [None, None]
    with suite.load("lqr", "lqr_6_2") as environment:
        limit = 1000 * environment.control_timestep()
    endless = TaskSet("endless", (("lqr", "lqr_6_2"),), "here")
    plans, _ = protocol._planned(endless, ["zero"])
    assert plans["lqr", "lqr_6_2"].time_limit == limit


def test_tasks_without_a_policy_are_listed_with_the_reason(tmp_path: Path) -> None:
    tasks = TaskSet("two", (("pendulum", "swingup"), ("cartpole", "two_poles")), "here")
    by_task = {("pendulum", "swingup"): "zero"}
    found = evaluate_set(tasks, [by_task, "random"], out=tmp_path / "out", num_threads=1)
    assert [(one.domain, one.task) for one in found.tasks] == [("pendulum", "swingup")]
    assert found.missing == {("cartpole", "two_poles"): "zero has no policy for it"}
    made = json.loads((tmp_path / "out" / "set.json").read_text(encoding="utf-8"))
    assert made["missing"] == [
        {"domain": "cartpole", "task": "two_poles", "reason": "zero has no policy for it"}
    ]
    assert made["summary"]["tasks"] == 1
    assert made["of_tasks"] == [list(task) for task in tasks.tasks]


def test_a_policy_that_does_not_fit_a_task_is_missing_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tasks = TaskSet("two", (("acrobot", "swingup_sparse"), ("pendulum", "swingup")), "here")
    find = policies.find

    def strict(policy: object, environment: object = None, **kwargs: object) -> object:
        if policy == "fits:pendulum-swingup":
            return find("zero")
        raise PolicyError(f"policy {policy!r} is for other tasks")

    monkeypatch.setattr(policies, "find", strict)
    plans, reasons = protocol._planned(tasks, ["fits:{domain}-{task}"])
    assert list(plans) == [("pendulum", "swingup")]
    assert reasons == {
        ("acrobot", "swingup_sparse"): "policy 'fits:acrobot-swingup_sparse' is for other tasks"
    }


def test_a_run_without_any_policy_is_refused_with_its_reason(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match=r"no task .* brief balance: .*Did you mean 'random'"):
        evaluate_set(_FAST, ["zero", "radnom"], out=tmp_path / "out")
    assert not (tmp_path / "out").exists()  # so that the same folder serves for the right name
    with pytest.raises(ValueError, match="there are no runs; expected at least one policy"):
        evaluate_set(_FAST, [])
    with pytest.raises(ValueError, match="no set of tasks 'dmc29'"):
        evaluate_set("dmc29", "zero")


def test_a_run_that_was_killed_is_continued(tmp_path: Path) -> None:
    out = tmp_path / "out"
    calls: list[tuple[str, int]] = []

    def stop(what: str, finished: int, part: float = 0.0) -> None:
        calls.append((what, finished))
        if finished >= episodes_of(_FAST, "zero") // 2 + 1:  # in the second task
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_set(_FAST, "zero", out=out, num_threads=1, on_progress=stop)
    first = (out / "run-1" / "brief-balance" / "episodes.jsonl").read_bytes()
    found = evaluate_set(_FAST, "zero", out=out, num_threads=1)
    assert (out / "run-1" / "brief-balance" / "episodes.jsonl").read_bytes() == first
    assert found.files == (out / "set.json",)
    undisturbed = evaluate_set(_FAST, "zero", num_threads=1)
    assert found.tasks == undisturbed.tasks
    assert json.loads((out / "set.json").read_text())["tasks"][0]["scores"] == list(
        undisturbed.tasks[0].scores
    )


def test_progress_ends_at_the_number_of_episodes() -> None:
    calls: list[int] = []
    evaluate_set(
        _FAST,
        ["random", "zero"],
        num_threads=1,
        on_progress=lambda what, done, part: calls.append(done),
    )
    assert calls == sorted(calls)
    assert calls[-1] == episodes_of(_FAST, ["random", "zero"]) == 2 * 2 * 2 * 2
    assert episodes_of("dmc28", {("walker", "walk"): "zero"}) == 28 * 2 * 2


def test_the_state_of_workers_is_reported() -> None:
    states: list[State] = []
    evaluate_set([("pendulum", "swingup")], "zero", workers=1, on_state=states.append)
    assert {state.workers for state in states} == {1}


def test_a_folder_of_other_results_is_refused_and_left_alone(tmp_path: Path) -> None:
    out = tmp_path / "out"
    evaluate_set(_FAST, "zero", out=out, num_threads=1)
    before = (out / "set.json").read_bytes()
    with pytest.raises(ValueError, match=r"runs \['zero'\], and this one has \['random'\]"):
        evaluate_set(_FAST, "random", out=out)
    with pytest.raises(ValueError, match="set 'fast', and this one has 'dmc-sparse'"):
        evaluate_set("dmc-sparse", "zero", out=out)
    assert (out / "set.json").read_bytes() == before
    (out / "set.json").write_text("{")
    with pytest.raises(ValueError, match=r"set\.json is no result of this command"):
        evaluate_set(_FAST, "zero", out=out)
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"holds other files and no set\.json"):
        evaluate_set(_FAST, "zero", out=other)
    assert [path.name for path in other.iterdir()] == ["notes.txt"]
    (other / "notes.txt").rename(other / ".set.0123456789abcdef.json")  # as a kill may leave it
    assert evaluate_set(_FAST, "zero", out=other, num_threads=1).files == (other / "set.json",)


def test_a_url_is_no_folder_of_results() -> None:
    with pytest.raises(ValueError, match="s3://bucket/set is a URL; expected the path of a folder"):
        evaluate_set(_FAST, "zero", out="s3://bucket/set")


def test_a_run_that_is_given_twice_is_refused() -> None:
    with pytest.raises(ValueError, match="run 'zero' occurs twice; expected each once"):
        evaluate_set(_FAST, ["zero", "random", "zero"])
    with pytest.raises(ValueError, match="run 'zero' occurs twice; expected each once"):
        episodes_of(_FAST, ["zero", "random", "zero"])
    by_task = {("brief", "balance"): "zero"}
    with pytest.raises(ValueError, match="occurs twice; expected each once"):
        evaluate_set(_FAST, [by_task, by_task])


def test_an_error_while_playing_is_no_missing_policy() -> None:
    def broken(observation: object) -> np.ndarray:
        return np.full(1, np.nan)

    with pytest.raises(PolicyError, match="seed 30000") as caught:
        evaluate_set(_FAST, broken, num_threads=1)
    assert caught.value.__notes__ == ["brief balance"]  # which the seed does not say


def test_a_world_is_that_of_all_tasks_and_part_of_the_results(tmp_path: Path) -> None:
    tasks, out = TaskSet("one", (("brief", "balance"),), "this test"), tmp_path / "out"
    world = {"appearance": "color_hard"}
    found = evaluate_set(tasks, "zero", out=out, num_threads=1, world=world)
    assert found.as_json()["world"] == {"appearance": {"palette": 0.2}}
    facts = json.loads((out / "run-1" / "brief-balance" / "result.json").read_text())
    assert facts["world"] == {"appearance": {"palette": 0.2}}
    for other in (None, {"appearance": "color_easy"}):
        with pytest.raises(ValueError, match=r"world .*, and this one has"):
            evaluate_set(tasks, "zero", out=out, num_threads=1, world=other)


@pytest.mark.parametrize(
    ("one", "another"),
    [
        ({"faults": "easy"}, {"faults": Faults.of("easy")}),
        ({"faults": {"dummies": 3}}, {"faults": Faults(dummies=3), "appearance": None}),
        (
            {"appearance": {"colors": 0.1, "dynamic": ("camera", "colors")}},
            {"appearance": Appearance.of({"colors": "easy", "dynamic": ["camera", "colors"]})},
        ),
    ],
    ids=["an object", "None", "a tuple"],
)
def test_a_world_is_the_same_in_any_form(
    one: dict[str, object], another: dict[str, object], tmp_path: Path
) -> None:
    tasks = TaskSet("one", (("brief", "balance"),), "this test")
    found = [evaluate_set(tasks, "zero", out=tmp_path, world=world) for world in (one, another)]
    assert found[0] == found[1]
    assert json.loads((tmp_path / "set.json").read_text())["world"] == found[0].world


def test_the_steps_of_an_episode_are_those_of_the_longest_one_of_all_runs() -> None:
    runs = [
        evaluate("cartpole", "balance", "zero", [0], time_limit=seconds, num_threads=1)
        for seconds in (0.1, 0.3, 0.2)
    ]
    scores = protocol._scores_of("cartpole", "balance", runs)
    assert (scores.control_steps, scores.agent_steps) == (30, (30, 30, 30))


def test_the_policies_of_a_set_must_fit_its_world() -> None:
    tasks, world = TaskSet("one", (("cartpole", "swingup"),), "here"), {"faults": {"dummies": 3}}
    seen: list[int] = []

    def counting(observation: dict[str, object]) -> np.ndarray:
        seen.append(len(observation))
        return np.zeros(1)

    found = evaluate_set(tasks, counting, num_threads=1, world=world)
    assert set(seen) == {2 + 3}
    plans, _ = protocol._planned(tasks, [counting], world)
    assert list(plans) == [(found.tasks[0].domain, found.tasks[0].task)]
