"""The bundled policies are those of the median runs, and the page has their figures."""

import hashlib
import json
import statistics
from pathlib import Path

import numpy as np
import pytest

from benchmarks import learned
from limberjack import policies
from limberjack.evaluation import evaluate
from limberjack.policies import mlp

_RESULTS = learned.results()
_NAMES = [f"{one['domain']}-{one['task']}" for one in _RESULTS]


def test_each_bundled_policy_has_a_result() -> None:
    assert [f"{one.domain}-{one.task}" for one in policies.bundled()] == _NAMES


@pytest.mark.parametrize(("bundled", "result"), [*zip(policies.bundled(), _RESULTS, strict=True)])
def test_the_policy_of_the_median_run_is_bundled_with_its_scores(
    bundled: policies.Bundled, result: dict
) -> None:
    means = {run["seed"]: run["mean"] for run in result["runs"]}
    assert len(means) >= 3
    assert means[result["bundled"]] == statistics.median(means.values())
    (run,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    assert len(run["returns"]) == len(learned.SEEDS)
    assert run["mean"] == pytest.approx(statistics.fmean(run["returns"]))
    card, scores = bundled.card, bundled.card.scores
    assert scores is not None
    assert (scores.mean, list(scores.interval)) == (run["mean"], run["interval"])
    assert scores.seeds == (learned.SEEDS.start, learned.SEEDS.stop)
    assert (card.seeds, card.steps, card.command) == ((run["seed"],), run["steps"], run["command"])
    assert card.licence


@pytest.mark.parametrize("result", _RESULTS, ids=_NAMES)
def test_a_bundled_policy_plays_as_its_result_says(result: dict) -> None:
    (run,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    where = result["domain"], result["task"]
    played = evaluate(*where, "pretrained", learned.SEEDS[:8], num_threads=1)
    found, kept = [one.total for one in played.scores["pretrained"]], run["returns"][:8]
    # Another processor rounds differently, so that an episode in eight may end otherwise.
    assert np.isclose(found, kept, rtol=0.02).sum() >= 7, (found, kept)


def test_the_page_has_the_table() -> None:
    page = (Path(learned.__file__).parents[1] / "docs" / "policies.md").read_text("utf-8")
    assert learned.section(_RESULTS) in page


def test_three_runs_are_scored_and_the_median_one_is_bundled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learned, "SEEDS", range(40_000, 40_002))
    for seed, torque in enumerate((0.0, 0.9, 0.3)):
        _make_run(tmp_path / f"pendulum-swingup-{seed}", seed, torque)
    _make_run(tmp_path / "walker-walk-0", 0, 0.0)  # too few
    names = learned.bundle(tmp_path, tmp_path / "pretrained", tmp_path / "results")
    assert names == ["pendulum-swingup"]
    (result,) = learned.results(tmp_path / "results")
    means = {run["seed"]: run["mean"] for run in result["runs"]}
    assert means[result["bundled"]] == statistics.median(means.values())
    there = mlp.load(tmp_path / "pretrained" / "pendulum-swingup.safetensors")
    assert there.card.seeds == (result["bundled"],)
    assert there.card.scores is not None
    run = tmp_path / f"pendulum-swingup-{result['bundled']}" / "policy.safetensors"
    (kept,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    assert kept["sha256"] == hashlib.sha256(run.read_bytes()).hexdigest()
    assert "pendulum swingup" in learned.section([result])


def _make_run(folder: Path, seed: int, torque: float) -> None:
    """A folder as `limberjack train` leaves it, of a policy that always acts alike."""
    folder.mkdir()
    card = mlp.Card(
        layout=(("orientation", (2,)), ("velocity", (1,))),
        low=(-1.0,),
        high=(1.0,),
        end="none",
        action_repeat=4,
        domain="pendulum",
        task="swingup",
        seeds=(seed,),
        steps=1000,
    )
    mlp.save(folder / "policy.safetensors", [([[0.0] * 3], [torque])], card)
    (folder / "training.json").write_text(json.dumps({"settings": {"time_limit": None}}))
    (folder / "curve.csv").write_text(
        "control_steps,agent_steps,processor_seconds,mean\n0,0,1.5,2\n"
    )
