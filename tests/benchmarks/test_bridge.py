"""The bridge plays the same episodes on all sides; its page and its figure are of its results."""

import dataclasses
import itertools
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bridge
import bridge_player as player
import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.evaluation import evaluate
from limberjack.policies import mlp
from limberjack.policies.mlp import one_thread
from limberjack.registry import sets

_REPOSITORY = Path(__file__).parents[2]
_BENCHMARKS = _REPOSITORY / "benchmarks"
_SEEDS = range(40_000, 40_002)
_STEPS = 100  # of an episode; those of the suite have 1,000


# The player.


def _policy(folder: Path, **changes: Any) -> Path:
    """A file of a network of random weights for walker walk."""
    stream = np.random.RandomState(0)
    sizes = 24, 16, 8, 6
    pairs = itertools.pairwise(sizes)
    layers = [(stream.randn(b, a) / 4, stream.randn(b)) for a, b in pairs]
    card = mlp.Card(
        layout=(("orientations", (14,)), ("height", ()), ("velocity", (9,))),
        low=(-1.0,) * 6,
        high=(0.5,) * 6,
        action_repeat=2,
    )
    path = folder / "random.safetensors"
    mlp.save(path, layers, dataclasses.replace(card, **changes))
    return path


def _assert_acts_as_the_package(path: Path) -> None:
    """Compares actions at random observations with those of the package, bit for bit."""
    network, reference = player.Network(path), mlp.load(path)
    stream = np.random.RandomState(1)
    for _ in range(5):
        shapes = dict(reference.card.layout)
        observation = {name: 3 * stream.randn(*shape) for name, shape in shapes.items()}
        rows = {name: np.repeat(np.asarray(x)[None], 64, 0) for name, x in observation.items()}
        with one_thread():  # as `bridge.py` starts the player
            action = network.action(observation)
        np.testing.assert_array_equal(action, reference.act_batch(rows)[0])
        assert action.dtype == np.float32


@pytest.mark.parametrize("one", policies.bundled(), ids=lambda one: f"{one.domain}-{one.task}")
def test_a_bundled_policy_acts_in_the_player_as_in_the_package(one: policies.Bundled) -> None:
    _assert_acts_as_the_package(one.path)


@pytest.mark.parametrize("activation", mlp.ACTIVATIONS)
@pytest.mark.parametrize("end", mlp.ENDS)
def test_each_kind_of_network_acts_so_too(tmp_path: Path, activation: str, end: str) -> None:
    _assert_acts_as_the_package(_policy(tmp_path, activation=activation, end=end))


@pytest.mark.parametrize("clip", [None, 0.5])
def test_normalised_observations_do_too(tmp_path: Path, clip: float | None) -> None:
    norm = {"mean": (0.3,) * 24, "scale": (1.7,) * 24, "clip": clip}
    _assert_acts_as_the_package(_policy(tmp_path, **norm))


def test_a_policy_file_needs_nothing_but_numpy_and_safetensors(tmp_path: Path) -> None:
    program = (
        "import sys, bridge_player, numpy\n"
        "before = set(sys.modules)\n"
        f"network = bridge_player.Network({str(_policy(tmp_path))!r})\n"
        "shapes = network.card['layout']\n"
        "network.action({name: numpy.zeros(shape) for name, shape in shapes})\n"
        "print(*{name.partition('.')[0] for name in sys.modules.keys() - before})\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=_BENCHMARKS, capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) <= {"safetensors", *sys.stdlib_module_names}


def test_the_player_plays_the_episodes_of_evaluate() -> None:
    bundled = {(one.domain, one.task): one.path for one in policies.bundled()}
    network = player.Network(bundled["walker", "walk"])
    found = [episode["return"] for episode in _played(suite, "walker", "walk", network)]
    limit = _STEPS * 0.025  # seconds of the walker's control step
    expected = evaluate("walker", "walk", "pretrained", _SEEDS, num_threads=1, time_limit=limit)
    expected = [score.total for score in expected.scores["pretrained"]]
    # The player adds rewards without rounding, `evaluate` with a rounding of 1e-16 each.
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def _played(
    side: Any, domain: str, task: str, network: player.Network | None
) -> list[dict[str, Any]]:
    """The results of short episodes of a suite."""
    found = []
    for environment in player.environments(side, domain, task, _SEEDS):
        environment._step_limit = _STEPS  # the name is dm_control's
        with one_thread():  # as `bridge.py` starts the player
            found.append(player.play(environment, network))
    return found


def _first_steps(environment: Any) -> list[Any]:
    """Observations and rewards of an episode's first steps with random actions."""
    stream, spec = np.random.RandomState(2), environment.action_spec()
    time_steps = [environment.reset()]
    for _ in range(4):
        time_steps.append(environment.step(stream.uniform(spec.minimum, spec.maximum)))
    return [(step.reward, dict(step.observation)) for step in time_steps]


@pytest.mark.parametrize(
    ("domain", "task"), [*sets.tasks_of("dmc28"), ("lqr", "lqr_6_2")], ids=lambda name: name
)
def test_an_environment_that_is_seeded_again_plays_as_a_new_one(domain: str, task: str) -> None:
    seeds = 7, 40_000
    for seed, environment in zip(
        seeds, player.environments(suite, domain, task, seeds), strict=True
    ):
        new = suite.load(domain, task, task_kwargs={"random": seed})
        np.testing.assert_equal(_first_steps(environment), _first_steps(new))


@pytest.mark.oracle
@pytest.mark.parametrize(("domain", "task"), [("walker", "walk"), ("reacher", "hard")])
def test_on_the_same_mujoco_both_sides_play_the_same_episodes(domain: str, task: str) -> None:
    oracle = pytest.importorskip("tests.oracle.oracle", reason="dm_control is not installed")
    bundled = {(one.domain, one.task): one.path for one in policies.bundled()}
    path = bundled.get((domain, task))
    network = None if path is None else player.Network(path)
    here, there = (_played(side, domain, task, network) for side in (suite, oracle.theirs("suite")))
    assert here == there


# The results.


def test_a_shift_is_the_mean_of_the_differences_with_its_interval() -> None:
    stream = np.random.RandomState(0)
    there = stream.uniform(0, 1000, 100)
    differences = stream.normal(5, 10, 100)
    shift = bridge.Shift.of(there + differences, there)
    assert shift.mean == pytest.approx(differences.mean())
    assert shift.largest == pytest.approx(np.abs(differences).max())
    # The normal approximation of the same interval.
    half = 1.96 * differences.std() / 10
    expected = differences.mean() - half, differences.mean() + half
    assert shift.interval == pytest.approx(expected, abs=0.5)
    assert not shift.is_noise
    reversed_ = bridge.Shift.of(there, there + differences)
    assert reversed_.mean == -shift.mean
    assert not reversed_.is_noise


@pytest.mark.parametrize(
    ("interval", "is_noise"),
    [
        ((-3.0, 5.0), True),
        ((0.0, 0.0), True),
        ((0.1, 0.9), True),  # less than published scores are rounded by
        ((-0.9, -0.1), True),
        ((0.1, 1.1), False),
        ((-1.1, -0.1), False),
    ],
)
def test_a_shift_is_noise_if_it_may_be_zero_or_is_smaller_than_one(
    interval: tuple[float, float], is_noise: bool
) -> None:
    assert bridge.Shift(sum(interval) / 2, interval, 9.0).is_noise is is_noise


def test_the_page_has_the_results() -> None:
    page = (_REPOSITORY / "docs" / "bridge.md").read_text("utf-8")
    text = bridge.section(bridge.rows_of())
    assert text
    assert text in page


def test_the_figure_is_of_the_results(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs the extra 'report'")
    rows = bridge.rows_of()
    bridge.draw(rows, tmp_path / "bridge.svg")
    drawn = (tmp_path / "bridge.svg").read_text("utf-8")
    committed = (_REPOSITORY / "docs" / "images" / "bridge.svg").read_text("utf-8")
    (found,) = re.findall(r"results [0-9a-f]{64}", committed)
    assert found in drawn


def test_zero_actions_are_compared_on_the_tasks_of_the_set_or_named_as_missing() -> None:
    rows = bridge.rows_of()
    zero = [(row["domain"], row["task"]) for row in rows if row["policy"] == "zero"]
    missing = [task for task in sets.tasks_of("dmc28") if task not in zero]
    assert zero == [task for task in sets.tasks_of("dmc28") if task in zero]
    if missing:
        named = ", ".join(map(" ".join, missing))
        text = " ".join(bridge.section(rows).split())
        assert f"Not measured with zero actions yet: {named}." in text
    for row in rows:
        sides = len(row["versions"])
        assert [len(side) for side in row["returns"]] == [len(bridge.SEEDS)] * sides
        assert len(row["starts"]) == sides - 1
        assert row["versions"] == rows[0]["versions"]


# Measuring, with a stand-in for the interpreter of the other environment.

_STAND_IN = """#!{python}
import json, pathlib, sys
_, package, domain, task, first, end, *policy = sys.argv[1:]
assert package == "dm_control"
log = pathlib.Path({log!r})
log.write_text(log.read_text() + f"{{domain}} {{task}} {{end}} {{len(policy)}}\\n")
versions = {{"python": "3", "dm_control": "1", "mujoco": {version!r}, "numpy": "2"}}
start = {{"state": [0.0] * {size}, "observation": [0.0] * {numbers}}}
episodes = [{{"return": 500.0, "steps": 1000, **start}} for _ in range(int(first), int(end))]
print(json.dumps({{"versions": versions, "episodes": episodes}}))
"""


@pytest.fixture(name="stand_in")
def _stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], tuple[str, Path]]:
    """Makes an interpreter that reports a version of MuJoCo and plays nothing, and its log."""
    card = mlp.Card(
        layout=(("orientation", (2,)), ("velocity", (1,))), low=(-1.0,), high=(1.0,), end="none"
    )
    path = tmp_path / "still.safetensors"
    mlp.save(path, [([[0.0] * 3], [0.1])], card)
    policy = policies.Bundled("pendulum", "swingup", path, mlp.load(path).card, 1, "a hash")
    monkeypatch.setattr(policies, "bundled", lambda: [policy])
    monkeypatch.setattr(sets, "tasks_of", lambda name: (("pendulum", "swingup"),))

    def make(version: str) -> tuple[str, Path]:
        program, log = tmp_path / f"python-{version}", tmp_path / f"log-{version}"
        program.write_text(
            _STAND_IN.format(
                python=sys.executable, log=str(log), version=version, size=2, numbers=3
            )
        )
        program.chmod(0o755)
        log.touch()
        return str(program), log

    return make


def test_what_is_measured_is_kept_and_not_played_again(
    stand_in: Callable[[str], tuple[str, Path]], tmp_path: Path
) -> None:
    python, log = stand_in("3.0.0")
    file = tmp_path / "bridge.json"
    with pytest.raises(ValueError, match="walker:walk is not compared"):
        bridge.measure([python], file=file, seeds=_SEEDS, only=["walker:walk"])
    bridge.measure([python], file=file, seeds=_SEEDS)
    learned, zero = bridge.rows_of(file)
    assert (learned["policy"], zero["policy"]) == ("pretrained", "zero")
    for row in (learned, zero):
        here, there = row["returns"]
        assert there == [500.0, 500.0]
        assert len(here) == 2
        assert here != there
        assert row["starts"][0]["equal"] == 0
        assert row["starts"][0]["state"] > 0
        assert [versions["mujoco"] for versions in row["versions"]][1:] == ["3.0.0"]
    played = ["pendulum swingup 40002 1", "pendulum swingup 40002 0"]
    asked_for_versions = "pendulum swingup 40000 0"
    assert log.read_text().splitlines() == [asked_for_versions, *played]
    bridge.measure([python], file=file, seeds=_SEEDS, only=["pendulum:swingup"])
    assert log.read_text().splitlines()[3:] == [asked_for_versions]
    other, of_other = stand_in("3.1.0")
    bridge.measure([other], file=file, seeds=_SEEDS)
    assert of_other.read_text().splitlines() == [asked_for_versions, *played]
    text = bridge.section(bridge.rows_of(file))
    assert "| task | repeat | here | MuJoCo 3.1.0 | shift | largest |" in text
    assert text.count("| pendulum swingup | 1 |") == 2


def test_what_was_played_is_kept_if_a_process_fails(
    stand_in: Callable[[str], tuple[str, Path]], tmp_path: Path
) -> None:
    python, _ = stand_in("3.0.0")
    text = Path(python).read_text()
    broken = text.replace("\nversions", '\nassert policy or end == first, "broken"\nversions')
    Path(python).write_text(broken)
    file = tmp_path / "bridge.json"
    with pytest.raises(subprocess.CalledProcessError):
        bridge.measure([python], file=file, seeds=_SEEDS)
    assert [row["policy"] for row in json.loads(file.read_text())["rows"]] == ["pretrained"]
