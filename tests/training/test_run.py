"""Runs that are killed and continued, refused, or reported."""

import dataclasses
import importlib
import json
import logging
import math
import pickle
import random
import resource
import shutil
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, cast

import dm_env
import numpy as np
import pytest

from limberjack import data, gym, policies, suite
from limberjack.evaluation import evaluate
from limberjack.policies import Learning, learning_of, mlp
from limberjack.training import TABLE, Run, Settings, TrainingError, train
from limberjack.training import run as run_module
from limberjack.workers.factories import Make
from limberjack.worlds.faults import Faults
from tests.training.small import (
    SMALL,
    blind,
    keeping,
    make,
    moving,
    of_one_array,
    of_one_number,
    of_whole_numbers,
    remembering,
    repeating,
    tiring,
    unseen,
    worthless,
)

_REASON = "needs the extra 'train'"
pytest.importorskip("sbx", reason=_REASON)


class _KilledError(Exception):
    """Raised in the place of a kill."""


def _pendulum(out: Path, **kwargs: Any) -> Run:
    given = {"domain": "pendulum", "task": "swingup", "out": out, "settings": SMALL, **kwargs}
    return train(**given)


def _killed_at(step: int) -> Callable[[int, int, float], None]:
    def kill(control_steps: int, steps: int, mean: float) -> None:
        if control_steps >= step:
            raise _KilledError

    return kill


def _without_times(run: Run) -> list[tuple[int, int, tuple[float, ...]]]:
    return [(one.control_steps, one.agent_steps, one.returns) for one in run.curve]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return _pendulum(tmp_path_factory.mktemp("undisturbed"), command="limberjack train")


def test_a_run_leaves_one_policy_its_curve_and_events(undisturbed: Run) -> None:
    folder = undisturbed.policy.parent
    assert sorted(path.name for path in folder.iterdir()) == [
        *("curve.csv", "curve.png", "policy.safetensors", "tensorboard", "training.json"),
    ]
    assert undisturbed.picture == folder / "curve.png"
    assert undisturbed.left_out is None
    assert list((folder / "tensorboard").iterdir())
    first, *_, last = undisturbed.curve
    assert (first.control_steps, last.control_steps) == (0, 1200)
    assert len(undisturbed.curve) == 21
    assert undisturbed.settings == SMALL
    lines = (folder / "curve.csv").read_text().splitlines()
    assert lines[0].startswith("control_steps,agent_steps,processor_seconds,mean,return_1,")
    assert len(lines) == 22


def test_the_card_says_where_a_policy_comes_from(undisturbed: Run) -> None:
    card = mlp.load(undisturbed.policy).card
    assert (card.domain, card.task, card.action_repeat) == ("pendulum", "swingup", 2)
    assert (card.algorithm, card.seeds, card.steps) == ("CrossQ", (0,), 1200)
    assert card.command == "limberjack train"
    assert card.sizes == (3, 16, 16, 1)
    assert card.layout == (("orientation", (2,)), ("velocity", (1,)))
    assert (card.low, card.high) == ((-1.0,), (1.0,))
    written = json.loads((undisturbed.policy.parent / "training.json").read_text())
    assert written["fingerprint"] == card.fingerprint
    assert written["settings"]["actor"] == [16, 16]


def test_the_last_evaluation_is_of_the_policy_in_the_file(undisturbed: Run) -> None:
    policy = mlp.load(undisturbed.policy)
    total = 0.0
    env = suite.load("pendulum", "swingup", {"random": run_module._EVALUATED[0]})
    time_step = env.reset()
    while not time_step.last():
        observation = {name: x[np.newaxis] for name, x in time_step.observation.items()}
        action = policy.act_batch(observation)[0]
        for _ in range(2):
            time_step = env.step(action)
            total += time_step.reward
    # The policy in the file rounds differently, by its folded layers.
    assert undisturbed.curve[-1].returns[0] == pytest.approx(total, rel=1e-3, abs=1e-3)


def test_a_killed_run_continues_bit_for_bit(
    undisturbed: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_module, "_PATIENCE", 0.05)  # checkpoints between evaluations too
    monkeypatch.setattr(run_module, "_SHARE", 1)
    kills = sorted(np.random.RandomState(0).randint(6, 1200, size=10).tolist())
    for step in kills:
        with pytest.raises(_KilledError):
            _pendulum(tmp_path, on_progress=_killed_at(step), command="limberjack train")
        assert not list(tmp_path.glob("*.safetensors"))
    run = _pendulum(tmp_path, command="limberjack train")
    assert not run.was_finished
    assert _without_times(run) == _without_times(undisturbed)
    assert run.policy.read_bytes() == undisturbed.policy.read_bytes()
    seconds = [one.processor_seconds for one in run.curve]
    assert seconds == sorted(seconds)


def test_a_killed_run_whose_task_remembers_something_continues_bit_for_bit(tmp_path: Path) -> None:
    # So few steps that each one is evaluated.
    settings = dataclasses.replace(SMALL, steps=96, random_steps=12, time_limit=None)
    whole = train(tiring, out=tmp_path / "whole", settings=settings)
    for step in (48, 78):  # where a row's episode is longer than its staggered one
        with pytest.raises(_KilledError):
            train(tiring, out=tmp_path / "run", settings=settings, on_progress=_killed_at(step))
    run = train(tiring, out=tmp_path / "run", settings=settings)
    assert _without_times(run) == _without_times(whole)
    assert run.policy.read_bytes() == whole.policy.read_bytes()


def test_a_killed_run_continues_with_the_same_demonstrations_alone(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow", reason="needs the extra 'data'")
    folder, how = tmp_path / "shown", dict[str, Any](steps=300)
    data.collect("pendulum", "swingup", "random", range(3), out=folder, time_limit=0.4)
    shown = data.load(folder)
    whole = _pendulum(tmp_path / "whole", demonstrations=shown, **how)
    alone = _pendulum(tmp_path / "alone", **how)
    assert whole.policy.read_bytes() != alone.policy.read_bytes()
    assert mlp.load(whole.policy).card.algorithm == "CrossQ with demonstrations"
    how["on_progress"] = _killed_at(200)
    with pytest.raises(_KilledError):
        _pendulum(tmp_path / "run", demonstrations=shown, **how)
    del how["on_progress"]
    with pytest.raises(
        ValueError, match="a run whose algorithm is 'CrossQ with demonstrations', not"
    ):
        _pendulum(tmp_path / "run", **how)
    with pytest.raises(ValueError, match=r"demonstrations\.episodes is 3, not 1: choose"):
        _pendulum(tmp_path / "run", demonstrations=shown.part(0, 2), **how)
    run = _pendulum(tmp_path / "run", demonstrations=data.load(folder), **how)
    assert _without_times(run) == _without_times(whole)
    assert run.policy.read_bytes() == whole.policy.read_bytes()


def test_a_finished_run_is_reported_without_the_packages(
    undisturbed: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "sbx", None)
    monkeypatch.delitem(sys.modules, "limberjack.training.learner")
    run = _pendulum(undisturbed.policy.parent)
    assert run == dataclasses.replace(undisturbed, was_finished=True)


def test_another_seed_is_another_run(undisturbed: Run, tmp_path: Path) -> None:
    _pendulum(tmp_path, seed=1, steps=180)
    weights = [
        mlp.load(folder / "policy.safetensors").layers[0][0]
        for folder in (tmp_path, undisturbed.policy.parent)
    ]
    assert not np.array_equal(weights[0], weights[1])
    with pytest.raises(ValueError, match="whose seed is 0, not 1"):
        _pendulum(undisturbed.policy.parent, seed=1)


def test_a_run_with_faults_is_trained_and_evaluated_with_them_and_no_other_continues_it(
    tmp_path: Path,
) -> None:
    world = {"faults": {"delay": {"rewards": 2}, "dummies": 2}}
    run = _pendulum(tmp_path, steps=180, world=world)
    card = mlp.load(run.policy).card
    assert card.world == {"faults": Faults.of(world["faults"]).as_json()}
    assert card.layout[-2:] == (("dummy-0", ()), ("dummy-1", ()))
    task = ("pendulum", "swingup", f"mlp:{run.policy}", run_module._EVALUATED)
    played = evaluate(*task, world=world)
    found = [score.total for score in played.scores[played.policy]]
    # A matrix product of another number of rows may round differently.
    assert found == pytest.approx(run.curve[-1].returns, rel=1e-3, abs=1e-3)
    late = {"faults": {"delay": {"rewards": 3}, "dummies": 2}}
    with pytest.raises(ValueError, match=r"whose world.faults.delay.rewards is 2, not 3: choose"):
        _pendulum(tmp_path, steps=180, world=late)
    with pytest.raises(ValueError, match=r"a run whose world is {.*}, not None: choose another"):
        _pendulum(tmp_path, steps=180)


def _drawn_tasks(monkeypatch: pytest.MonkeyPatch) -> list[Learning]:
    """The tasks that are drawn from now on."""
    drawn: list[Learning] = []

    def draw(path: Path, tasks: list[Learning]) -> None:
        drawn.extend(tasks)
        path.write_bytes(b"a picture")

    monkeypatch.setattr(run_module, "write_learning_plot", draw)
    return drawn


def test_the_picture_has_the_run_beside_those_that_the_package_knows(
    undisturbed: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = _drawn_tasks(monkeypatch)
    known = Learning("pendulum swingup", learning_of("cartpole", "swingup").runs)
    monkeypatch.setattr(run_module, "learning_of", lambda *task: known)
    shutil.copytree(undisturbed.policy.parent, tmp_path / "run")
    assert _pendulum(tmp_path / "run", command="limberjack train").picture is not None
    assert drawn == []  # there is one
    (tmp_path / "run" / "curve.png").unlink()
    run = _pendulum(tmp_path / "run", command="limberjack train")
    assert (run.was_finished, run.picture) == (True, tmp_path / "run" / "curve.png")
    (task,) = drawn
    assert (task.title, task.runs) == ("pendulum swingup", known.runs)
    assert task.own is not None
    assert task.own.name == "this run, seed 0"
    assert task.own.steps.tolist() == [one.control_steps for one in run.curve]
    assert task.own.seconds.tolist() == [one.processor_seconds for one in run.curve]
    assert task.own.returns.tolist() == [one.mean for one in run.curve]


def test_the_picture_says_that_a_run_had_faults_which_others_had_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = _drawn_tasks(monkeypatch)
    _pendulum(tmp_path, steps=180, world={"faults": {"dummies": 2}})
    (task,) = drawn
    assert task.own is not None
    assert task.own.name == "this run, seed 0, with faults"


def test_without_matplotlib_a_run_finishes_and_says_why_there_is_no_picture(
    undisturbed: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    shutil.copytree(undisturbed.policy.parent, tmp_path / "run")
    (tmp_path / "run" / "curve.png").unlink()
    run = _pendulum(tmp_path / "run", command="limberjack train")
    assert run.picture is None
    assert run.left_out is not None
    assert run.left_out.startswith("no curve.png: needs the extra 'video': pip install")
    assert not (tmp_path / "run" / "curve.png").exists()


def test_the_callers_random_stream_goes_on(tmp_path: Path) -> None:
    torch: Any = pytest.importorskip("torch", reason=_REASON)
    np.random.seed(3)
    expected = np.random.RandomState(3).uniform(size=4)
    of_python, of_torch = random.getstate(), torch.get_rng_state()
    with pytest.raises(_KilledError):
        _pendulum(tmp_path, on_progress=_killed_at(60))
    np.testing.assert_array_equal(np.random.uniform(size=4), expected)
    assert random.getstate() == of_python
    assert torch.equal(torch.get_rng_state(), of_torch)


def test_packages_that_draw_as_they_are_imported_do_not_change_the_callers_stream(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imported = importlib.import_module

    def drawing(name: str, package: str | None = None) -> ModuleType:
        np.random.seed(random.randrange(9))
        return imported(name, package)

    before = np.random.get_state(legacy=False), random.getstate()
    _caught(monkeypatch)
    monkeypatch.setattr(importlib, "import_module", drawing)
    with pytest.raises(_KilledError):
        _pendulum(tmp_path)
    np.testing.assert_equal((np.random.get_state(legacy=False), random.getstate()), before)


def test_two_threads_do_not_train_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused: list[str] = []

    def other() -> None:
        with pytest.raises(RuntimeError, match="another thread of this process trains") as caught:
            _pendulum(tmp_path / "other")
        refused.append(str(caught.value))

    def training(*arguments: object) -> None:
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        raise _KilledError

    monkeypatch.setattr(run_module, "_Training", training)
    with pytest.raises(_KilledError):
        _pendulum(tmp_path / "run")
    assert refused
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("change", [lambda state: {"other": 1}, lambda state: {**state, "rows": 1}])
def test_a_checkpoint_of_another_form_is_damaged(change: Any, tmp_path: Path) -> None:
    with pytest.raises(_KilledError):
        _pendulum(tmp_path, on_progress=_killed_at(60))
    path = tmp_path / "checkpoint.pickle"
    path.write_bytes(pickle.dumps(change(pickle.loads(path.read_bytes()))))
    threads = threading.active_count()
    with pytest.raises(ValueError, match=r"checkpoint\.pickle is damaged .*: remove it to begin"):
        _pendulum(tmp_path)
    assert threading.active_count() == threads


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("", "it has no evaluations"),
        ("\n", "could not convert string to float"),
        ("1,2,3,4\n", "expected 14 finite numbers in each line"),
        ("inf" + ",0" * 13 + "\n", "expected 14 finite numbers in each line"),
        ("0" + ",0" * 12 + ",nan\n", "expected 14 finite numbers in each line"),
        ("0" + ",0" * 13 + "\n1,2\n", "inhomogeneous"),
    ],
)
def test_a_curve_with_other_lines_is_damaged(
    lines: str, message: str, undisturbed: Run, tmp_path: Path
) -> None:
    shutil.copytree(undisturbed.policy.parent, tmp_path / "run")
    curve = tmp_path / "run" / "curve.csv"
    curve.write_text(f"{curve.read_text().splitlines()[0]}\n{lines}")
    with pytest.raises(ValueError, match=rf"curve\.csv is damaged \(.*{message}"):
        _pendulum(tmp_path / "run", command="limberjack train")


def test_a_run_of_random_actions_only_is_refused(undisturbed: Run, tmp_path: Path) -> None:
    message = r"steps is 120, which are 60 actions, and random_steps = 60 come before learning"
    with pytest.raises(ValueError, match=message):
        _pendulum(tmp_path / "run", steps=120)
    assert not (tmp_path / "run").exists()


def test_a_return_that_is_no_number_stops_the_run(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, time_limit=None)
    message = r"the return of the evaluated episode with seed 2100000000 is nan after 0 control"
    with pytest.raises(TrainingError, match=message):
        train(worthless, out=tmp_path, settings=settings)


@pytest.mark.parametrize(
    ("make_other", "message"),
    [
        (unseen, r"no number \(policy 'learned', step 0 .*: returned nan .* checkpoint is kept"),
        (keeping, r"cannot be saved in a checkpoint \(.*lambda.*\); expected one that pickle"),
    ],
)
def test_an_environment_that_cannot_be_evaluated_or_saved_stops_the_run(
    make_other: Make, message: str, tmp_path: Path
) -> None:
    settings = dataclasses.replace(SMALL, time_limit=None)
    with pytest.raises(TrainingError, match=message):
        train(make_other, out=tmp_path, settings=settings)


def test_an_environment_that_observes_one_array_trains(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, steps=180, time_limit=None)
    run = train(of_one_array, out=tmp_path, settings=settings)
    assert math.isfinite(run.curve[-1].mean)


def test_losses_that_are_no_numbers_stop_the_run(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, learning_rate=1e30)
    with pytest.raises(TrainingError, match=r"loss is nan after \d+ control steps"):
        _pendulum(tmp_path, settings=settings)
    assert (tmp_path / "checkpoint.pickle").exists()
    assert not list(tmp_path.glob("*.safetensors"))


def test_weights_that_are_no_numbers_stop_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layers = [(np.full((1, 3), np.inf), np.zeros(1))]
    monkeypatch.setattr("limberjack.training.learner.Learner.layers", lambda one: layers)
    with pytest.raises(TrainingError, match=r"no policy .*not finite.* after 0 control steps"):
        _pendulum(tmp_path)
    assert not list(tmp_path.glob("*.safetensors"))


def test_a_full_disk_keeps_the_last_checkpoint(undisturbed: Run, tmp_path: Path) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    def fill(control_steps: int, steps: int, mean: float) -> None:
        if control_steps >= 300:
            resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))

    try:
        with pytest.raises(OSError, match=r"checkpoint\.pickle"):
            _pendulum(tmp_path, on_progress=fill, command="limberjack train")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    run = _pendulum(tmp_path, command="limberjack train")
    assert run.policy.read_bytes() == undisturbed.policy.read_bytes()


def test_a_function_that_makes_environments_trains(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, steps=180, time_limit=None)
    run = train(make, out=tmp_path, settings=settings)
    assert mlp.load(run.policy).card.title == ""
    assert policies.find(f"mlp:{run.policy}", make(0)).name == f"mlp:{run.policy}"


def test_environments_of_another_class_train_in_rows(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    settings = dataclasses.replace(SMALL, steps=180, time_limit=None)
    with caplog.at_level(logging.INFO, "limberjack"):
        run = train(remembering, out=tmp_path, settings=settings)
    assert any("not vectorised" in record.getMessage() for record in caplog.records)
    assert math.isfinite(run.curve[-1].mean)


def test_evaluations_are_as_long_as_the_task_whatever_was_trained(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, steps=180)
    run = train("cartpole", "balance", out=tmp_path, settings=settings)
    assert settings.time_limit == 0.4  # 40 control steps, each with a reward of at most 1
    assert min(run.curve[-1].returns) > 80
    played = evaluate("cartpole", "balance", f"mlp:{run.policy}", run_module._EVALUATED)
    found = [score.total for score in played.scores[played.policy]]
    assert found == list(run.curve[-1].returns)


def test_actions_without_bounds_are_drawn_and_learned_within_those_of_the_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[np.ndarray] = []
    step = gym.VectorEnv.step

    def noted(envs: gym.VectorEnv, actions: np.ndarray) -> Any:
        taken.append(np.array(actions))
        return step(envs, actions)

    monkeypatch.setattr(gym.VectorEnv, "step", noted)
    settings = dataclasses.replace(SMALL, steps=180, action_bound=6.0)
    card = mlp.load(train("lqr", "lqr_2_1", out=tmp_path, settings=settings).policy).card
    assert (card.low, card.high) == ((-6.0,), (6.0,))
    largest = max(np.abs(actions).max() for actions in taken)
    assert 3.0 < largest <= 6.0

    card = mlp.load(_pendulum(tmp_path / "bounded").policy).card
    assert (card.low, card.high) == ((-1.0,), (1.0,))


def test_each_row_of_the_table_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    used: list[Settings] = []

    def caught(folder: object, factory: object, settings: Settings, *more: object):
        used.append(settings)
        raise _KilledError

    monkeypatch.setattr(run_module, "_Training", caught)
    for name in TABLE:
        domain, _, task = name.partition(":")
        task = task or suite.TASKS_BY_DOMAIN[domain][0]
        with pytest.raises(_KilledError):
            train(domain, task, out=tmp_path / name)
    assert used == [*TABLE.values()]


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"domain": make, "task": None}, "time_limit is 0.4, but a function makes"),
        ({"seed": 1_000_000}, "seed is 1000000; expected a whole number below 1000000"),
        ({"steps": 0}, "steps is 0; expected a whole number of at least 1"),
    ],
)
def test_bad_numbers_are_refused(kwargs: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        _pendulum(tmp_path / "run", **kwargs)
    assert not list(tmp_path.iterdir())


def test_a_task_without_a_time_limit_is_refused(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, time_limit=None)
    with pytest.raises(ValueError, match=r"no time limit.*time_limit = SECONDS"):
        train("lqr", "lqr_2_1", out=tmp_path / "run", settings=settings)
    assert not list(tmp_path.iterdir())


def _seeing(seed: int) -> dm_env.Environment:
    return suite.load(
        "pendulum",
        "swingup",
        task_kwargs={"random": seed},
        environment_kwargs={"pixels": {"height": 8, "width": 8}},
    )


def test_an_environment_that_observes_pictures_is_refused(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, time_limit=None)
    with pytest.raises(ValueError, match="observes pictures; expected numbers only"):
        train(_seeing, out=tmp_path / "run", settings=settings)
    assert not list(tmp_path.iterdir())


def _caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets runs end as they begin, with `_KilledError`."""

    def caught(*arguments: object) -> None:
        raise _KilledError

    monkeypatch.setattr(run_module, "_Training", caught)


@pytest.mark.parametrize(
    ("make_other", "message"),
    [
        (blind, "observes nothing; expected at least one number"),
        (of_one_number, r"has actions of shape \(\) and type float64; expected one axis"),
        (of_whole_numbers, r"shape \(1,\) and type int64; expected .* of floating-point numbers"),
        (repeating, "repeats each action for 4 control steps, and the settings for 2: set action_"),
    ],
)
def test_an_environment_that_no_network_can_be_trained_in_is_refused(
    make_other: Make, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = dataclasses.replace(SMALL, time_limit=None)
    with pytest.raises(ValueError, match=message):
        train(make_other, out=tmp_path / "run", settings=settings)
    assert not list(tmp_path.iterdir())
    _caught(monkeypatch)
    with pytest.raises(_KilledError):
        train(repeating, out=tmp_path, settings=dataclasses.replace(settings, action_repeat=4))


def test_a_seed_of_numpy_and_a_function_that_changes_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _caught(monkeypatch)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ELSEWHERE", str(tmp_path / "elsewhere"))
    settings = dataclasses.replace(SMALL, time_limit=None)
    with pytest.raises(_KilledError):
        train(moving, out="run", settings=settings, seed=cast(int, np.int64(3)))
    written = json.loads((tmp_path / "run" / "training.json").read_text())
    assert written["seed"] == 3
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_function_that_cannot_be_named_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"define make\(seed\) at the top level of a module"):
        train(lambda seed: make(seed), out=tmp_path / "run")
    assert not list(tmp_path.iterdir())
