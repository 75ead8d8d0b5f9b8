"""The bundled policies are those of the median runs, and the page has their figures."""

import dataclasses
import hashlib
import json
import re
import statistics
from pathlib import Path

import learned
import numpy as np
import numpy.typing as npt
import pytest

from limberjack import policies, suite
from limberjack.episodes.player import play_unit
from limberjack.evaluation import Evaluation
from limberjack.policies import learning, mlp
from limberjack.suite import lqr_solver
from limberjack.training import Settings
from limberjack.workers.setup import prepare

_RESULTS = learned.results()
_NAMES = [f"{one['domain']}-{one['task']}" for one in _RESULTS]
# Of each kind: a law of control, a chaotic chain, one of few contacts, and one that walks.
_PLAYED = {"lqr-lqr_2_1", "cartpole-three_poles", "ball_in_cup-catch", "walker-walk"}


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scores policies on two seeds."""
    monkeypatch.setattr(learned, "SEEDS", range(40_000, 40_002))


def test_each_bundled_policy_has_a_result() -> None:
    assert [f"{one.domain}-{one.task}" for one in policies.bundled()] == _NAMES


@pytest.mark.parametrize(("bundled", "result"), [*zip(policies.bundled(), _RESULTS, strict=True)])
def test_the_policy_of_the_median_run_is_bundled_with_its_scores(
    bundled: policies.Bundled, result: dict
) -> None:
    means = {run["seed"]: run["mean"] for run in result["runs"]}
    assert means[result["bundled"]] == statistics.median_low(means.values())
    (run,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    assert len(means) >= (1 if run["steps"] == 1_000_000 else 3)  # a run of a million takes an hour
    assert len(run["returns"]) == len(learned.SEEDS)
    assert run["mean"] == pytest.approx(statistics.fmean(run["returns"]))
    card, scores = bundled.card, bundled.card.scores
    assert scores is not None
    assert (scores.mean, list(scores.interval)) == (run["mean"], run["interval"])
    assert scores.seeds == (learned.SEEDS.start, learned.SEEDS.stop)
    assert (card.seeds, card.steps, card.command) == ((run["seed"],), run["steps"], run["command"])
    assert card.licence


@pytest.mark.parametrize(
    "result",
    [
        pytest.param(result, id=name, marks=() if name in _PLAYED else pytest.mark.slow)
        for name, result in zip(_NAMES, _RESULTS, strict=True)
    ],
)
def test_a_bundled_policy_plays_as_its_result_says(result: dict) -> None:
    (run,) = (one for one in result["runs"] if one["seed"] == result["bundled"])
    where = result["domain"], result["task"]
    limit = learned._time_limit(*where)
    setup = prepare(*where, "pretrained", time_limit=limit, num_threads=1)
    found = [one.total for one in play_unit(setup, learned.SEEDS[:8])]
    kept = run["returns"][:8]
    # Another processor rounds differently: one without AVX-512 differs by up to 7 % where motion is
    # chaotic (three poles, fish), and an episode in eight may end otherwise.
    assert np.isclose(found, kept, rtol=0.1).sum() >= 7, (found, kept)


def test_the_page_has_the_table() -> None:
    page = (Path(learned.__file__).parents[1] / "docs" / "policies.md").read_text("utf-8")
    assert learned.section(_RESULTS) in page


def test_the_page_of_training_begins_with_the_recipe_as_it_was_run() -> None:
    page = (Path(learned.__file__).parents[1] / "docs" / "training.md").read_text("utf-8")
    assert learned.recipe(_RESULTS) in page
    domain, _, task = learned.RECIPE.partition("-")
    assert page.index(f"    limberjack train {domain} {task} --out") < page.index(
        "With the seeds 0"
    )


def test_changed_settings_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    (result,) = (one for one in _RESULTS if f"{one['domain']}-{one['task']}" == learned.RECIPE)
    used = {**dataclasses.asdict(Settings()), **result["settings"]}
    table = Settings(**{**used, "actor": tuple(used["actor"]), "critic": tuple(used["critic"])})
    now = {"same": table, "other": dataclasses.replace(table, discount=0.5)}
    sentences = (
        "The settings of these tasks have changed since their runs: cartpole swingup.",
        "The settings have changed since these runs.",
    )
    for name, settings in now.items():
        monkeypatch.setattr(learned, "settings_for", lambda *task, found=settings: found)
        assert learned.is_outdated(result) is (name == "other")
        for sentence, text in zip(
            sentences, (learned.section([result]), learned.recipe([result])), strict=True
        ):
            assert (sentence in " ".join(text.split())) is (name == "other")


def test_the_package_has_the_curves_of_the_results() -> None:
    assert learning.FILE.read_text("utf-8") == learned.known_curves(_RESULTS)


def test_the_figure_is_of_these_curves() -> None:
    text = learned.PICTURE.read_text("utf-8")
    digest = hashlib.sha256(learning.FILE.read_bytes()).hexdigest()
    (found,) = re.findall(r"<dc:description>\s*(\w+)\s*</dc:description>", text)
    assert found == digest, "draw it again: python benchmarks/learned.py"
    for name in _NAMES:
        assert text.count(f">{name.replace('-', ' ')}<") == 2  # over steps and over minutes


def test_curves_and_figure_are_written_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learned, "results", lambda: _RESULTS[:1])
    file, picture = tmp_path / "curves.json", tmp_path / "curves.svg"
    learned.write_curves(file, picture)
    assert list(json.loads(file.read_text())) == _NAMES[:1]
    text = picture.read_text()
    assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    assert _NAMES[0].replace("-", " ") in text
    assert _NAMES[1].replace("-", " ") not in text


@pytest.mark.usefixtures("few")
def test_three_runs_are_scored_and_the_median_one_is_bundled(tmp_path: Path) -> None:
    for seed, torque in enumerate((0.0, 0.9, 0.3)):
        _make_run(tmp_path / f"pendulum-swingup-{seed}", seed, torque)
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


@pytest.mark.usefixtures("few")
def test_later_runs_join_those_that_were_scored_with_the_same_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundled, out = tmp_path / "pretrained", tmp_path / "results"
    scored, means = learned._scored, [500.0, 400.0, 600.0]  # of the seeds

    def with_a_mean(folder: Path) -> tuple[dict, Evaluation]:
        run, evaluation = scored(folder)
        return {**run, "mean": means[run["seed"]]}, evaluation

    monkeypatch.setattr(learned, "_scored", with_a_mean)

    def added(seed: int) -> tuple[list[int], int]:
        trained = tmp_path / str(seed)
        trained.mkdir()
        _make_run(trained / f"pendulum-swingup-{seed}", seed, 0.0)
        learned.bundle(trained, bundled, out)
        (result,) = learned.results(out)
        assert mlp.load(bundled / "pendulum-swingup.safetensors").card.seeds == (result["bundled"],)
        return [run["seed"] for run in result["runs"]], result["bundled"]

    assert added(0) == ([0], 0)
    assert added(1) == ([0, 1], 1)
    with pytest.raises(ValueError, match="seed 0, whose policy is neither in"):
        added(2)
    (tmp_path / "0" / "pendulum-swingup-0").rename(tmp_path / "2" / "pendulum-swingup-0")
    learned.bundle(tmp_path / "2", bundled, out)
    assert mlp.load(bundled / "pendulum-swingup.safetensors").card.seeds == (0,)


@pytest.mark.usefixtures("few")
def test_runs_of_another_program_have_its_command(tmp_path: Path) -> None:
    for seed, torque in enumerate((0.0, 0.9, 0.3)):
        folder = tmp_path / f"pendulum-swingup-{seed}"
        _make_run(folder, seed, torque)
        (folder / "training.json").unlink()
        policy = mlp.load(folder / "policy.safetensors")
        card = dataclasses.replace(policy.card, command=f"python mine/own.py --seed {seed}")
        mlp.save(folder / "policy.safetensors", policy.layers, card)
    learned.bundle(tmp_path, tmp_path / "pretrained", tmp_path / "results")
    (result,) = learned.results(tmp_path / "results")
    assert [run["command"] for run in result["runs"]] == [
        f"python mine/own.py --seed {seed}" for seed in range(3)
    ]
    assert not learned.is_outdated(result)
    text = " ".join(learned.section([result]).split())
    assert "by `limberjack train`, pendulum swingup by `mine/own.py`. The policy" in text


def test_runs_that_differ_in_more_than_their_seeds_are_not_bundled(tmp_path: Path) -> None:
    folders = [tmp_path / f"pendulum-swingup-{seed}" for seed in range(3)]
    for seed, folder in enumerate(folders):
        _make_run(folder, min(seed, 1), 0.0)

    def refused(message: str) -> None:
        with pytest.raises(ValueError, match=re.escape(message)):
            learned.bundle(tmp_path, tmp_path / "pretrained", tmp_path / "results")

    refused(f"{folders[2]} has the seed of another run, 1: move it")
    facts = {"settings": dataclasses.asdict(Settings(steps=7))}
    (folders[2] / "training.json").write_text(json.dumps(facts))
    refused(f"{folders[2]} has other settings than {folders[0]}: train one of them")
    for seed, folder in enumerate(folders):
        folder.rename(tmp_path / f"walker-walk-{seed}")
    refused(f"{tmp_path / 'walker-walk-0'} is of pendulum swingup: name its folder so")


@pytest.mark.usefixtures("few")
def test_lqr_is_compared_with_the_optimal_policy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Seconds after which both balls are at rest, where 1,000 control steps take 30.
    monkeypatch.setattr(learned, "_time_limit", lambda *_: 45.0)
    costs, gain = [], np.zeros((1, 4))
    for seed in learned.SEEDS:
        with suite.load("lqr", "lqr_2_1", task_kwargs={"random": seed}) as environment:
            values, gain, _ = lqr_solver.solve(environment)
            environment.reset()
            state = environment.physics.state()
            first = state[:2] @ state[:2] / 2  # of the start, which no step pays
            costs.append(state @ values @ state / 2 - first)
    for seed, weights in enumerate((gain, np.multiply(gain, 1.5), np.multiply(gain, 0.6))):
        _make_linear(tmp_path / f"lqr-lqr_2_1-{seed}", seed, weights)
    learned.bundle(tmp_path, tmp_path / "pretrained", tmp_path / "results")
    (result,) = learned.results(tmp_path / "results")
    assert result["optimal"] == pytest.approx(statistics.fmean(costs), rel=1e-3)
    near, *others = (run["cost"] / result["optimal"] for run in result["runs"])
    assert 1 < near < 1.02  # the springs of one seed are stiffer than those of the other
    assert min(others) > 1.02
    assert f"| {min(others):.3f} of the optimal policy's cost |" in learned.section([result])


def _make_run(folder: Path, seed: int, torque: float) -> None:
    """A folder as `limberjack train` leaves it, of a policy that always acts alike."""
    layout = (("orientation", (2,)), ("velocity", (1,)))
    card = mlp.Card(layout, (-1.0,), (1.0,), "relu", "none", 4, "pendulum", "swingup")
    _write(folder, card, seed, [[0.0] * 3], [torque])


def _make_linear(folder: Path, seed: int, gain: np.ndarray) -> None:
    """The same of a policy whose action is gain @ state."""
    layout = (("position", (2,)), ("velocity", (2,)))
    card = mlp.Card(layout, (-10.0,), (10.0,), "relu", "none", 1, "lqr", "lqr_2_1")
    _write(folder, card, seed, gain, [0.0])


def _write(
    folder: Path,
    card: mlp.Card,
    seed: int,
    weights: npt.ArrayLike,
    offset: npt.ArrayLike,
) -> None:
    folder.mkdir()
    card = dataclasses.replace(card, seeds=(seed,), steps=1000)
    mlp.save(folder / "policy.safetensors", [(weights, offset)], card)
    facts = {"settings": dataclasses.asdict(Settings())}
    (folder / "training.json").write_text(json.dumps(facts))
    (folder / "curve.csv").write_text(
        "control_steps,agent_steps,processor_seconds,mean\n0,0,1.5,2\n"
    )
