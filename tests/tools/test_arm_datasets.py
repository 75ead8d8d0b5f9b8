"""The cards of datasets, and the hashes that they list."""

import json
from pathlib import Path
from typing import Any

import arm_datasets
import pytest
import typer

from limberjack import data

_RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Collects short episodes of random actions in the place of the planner's."""
    collect = data.collect

    def short(domain: str, task: str, policy: str, seeds: range, **kwargs: object) -> None:
        assert policy == "planner"
        out = str(kwargs["out"])
        collect(domain, task, "random", seeds, out=out, time_limit=0.05, num_threads=1)

    monkeypatch.setattr(data, "collect", short)
    monkeypatch.setattr(arm_datasets, "evaluate", lambda *asked, **kwargs: None)


@pytest.mark.usefixtures("quick")
def test_a_second_run_reproduces_the_hashes_of_the_cards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tasks = ["bring_ball", "stack_2"]
    one = tmp_path / "one"
    arm_datasets.main(one, tasks, episodes=2)
    for domain, task in zip(("manipulator", "stacker"), tasks, strict=True):
        text = (one / f"{task}.md").read_text(encoding="utf-8")
        files = data.inform(data.load(one / task)).files
        assert arm_datasets.hashes_in(text) == files
        command = f"limberjack collect {domain} {task} --policy planner --seeds 20000:20002"
        for part in ("licence | Apache", "| all | 2 |", command, "mujoco "):
            assert part in text
    arm_datasets.main(tmp_path / "two", tasks, episodes=2, compare=one)
    with pytest.raises(SystemExit) as caught:
        arm_datasets.main(tmp_path / "three", ["stack_2"], episodes=1, compare=one)
    assert caught.value.code == 1
    assert f"other hashes than in {one}: stack_2/seeds-" in capsys.readouterr().err


def test_the_episodes_of_a_dataset_are_evaluated_and_only_the_baselines_are_played(
    tmp_path: Path, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def evaluated(domain: str, task: str, policy: str, seeds: range, **kwargs: Any) -> None:
        lines = (kwargs["out"] / "episodes.jsonl").read_text(encoding="utf-8").splitlines()
        asked.append((domain, task, policy, seeds, [json.loads(line) for line in lines[1:]]))

    monkeypatch.setattr(arm_datasets, "evaluate", evaluated)
    for _ in range(2):  # as a run that was killed after it
        arm_datasets.main(tmp_path, ["stack_4"], episodes=2)
        *command, scores = asked.pop()
        assert command == ["stacker", "stack_4", "planner", range(20_000, 20_002)]
        episodes = list(data.load(tmp_path / "stack_4"))
        assert [score["seed"] for score in scores] == [20_000, 20_001]
        assert [score["total"] for score in scores] == [episode.total for episode in episodes]
        assert {score["policy"] for score in scores} == {"planner"}


def test_an_unknown_task_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(typer.BadParameter, match="no task bring_box; expected bring_ball, "):
        arm_datasets.main(tmp_path / "out", ["bring_ball", "bring_box"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("task", "domain"), arm_datasets._ARM.items())
def test_a_committed_card_tells_the_scores_of_the_same_episodes(task: str, domain: str) -> None:
    card = (_RESULTS / "arm_datasets" / f"{task}.md").read_text(encoding="utf-8")
    path = _RESULTS / "scores" / f"{domain}-{task}-planner.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    summary = result["summary"]["planner"]
    for start, part in [("all", summary), *summary["strata"].items()]:
        figures = f"{part['mean']:.1f} | {part['median']:.1f} | {part['successes']}"
        assert f"| {start} | {part['episodes']} | {figures} |" in card
    seeds = [episode["seed"] for episode in result["episodes"]]
    assert f"--seeds {seeds[0]}:{seeds[-1] + 1} " in card
    assert f"| policy | `{result['policy_sha256']}` |" in card
