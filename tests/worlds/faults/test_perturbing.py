"""Perturbations: schedules, periods, rows of batches, and what is refused."""

import copy
import pickle
from collections.abc import Iterable, Sequence
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.randomize import scale
from limberjack.worlds.faults import Parameter, Perturber, Range
from limberjack.worlds.faults.settings import Perturbation
from tests.worlds.faults.test_memory import assert_equal

_TASK = ("cartpole", "swingup")


def _edit(root: Element, value: float) -> None:
    root.set("value", repr(value))


class _Recompiler:
    def names(self, edits: Iterable[Any]) -> tuple[str, ...]:
        return ("field",) if list(edits) else ()

    def fields(self, edit: Any, names: Sequence[str]) -> dict[str, np.ndarray]:
        root = Element("mujoco")
        edit(root)
        return {name: np.array(float(root.get("value", "nan"))) for name in names}


_PARAMETERS = {"length": Parameter(_edit, 1.0, Range(0.0, 2.0, 0.5), {"easy": Range(0.5, 1, 0.1)})}


def _perturber(**settings: Any) -> Perturber:
    made = Perturber.of(
        Perturbation(**{"parameter": "length", **settings}), _PARAMETERS, "Task", _Recompiler
    )
    assert made is not None
    return made


def _values(perturber: Perturber, normals: Sequence[float], uniform: float = 0.25) -> list[float]:
    value, falls, found = None, False, []
    for normal in normals:
        value, falls = perturber.next(value, falls, normal, uniform)
        found.append(value)
    return found


@pytest.mark.parametrize(
    ("schedule", "expected"),
    [
        ("constant", [1.0, 1.0, 1.0, 1.0, 1.0]),
        ("random_walk", [1.5, 1.0, 2.0, 1.5, 2.0]),
        ("drift_pos", [1.5, 2.0, 2.0, 2.0, 2.0]),
        ("drift_neg", [0.5, 0.0, 0.0, 0.0, 0.0]),
        ("cyclic_pos", [1.5, 1.0, 1.0, 1.5, 1.0]),
        ("cyclic_neg", [0.5, 1.0, 1.0, 0.5, 1.0]),
        ("uniform", [0.5, 0.5, 0.5, 0.5, 0.5]),
        ("saw_wave", [1.5, 2.0, 0.0, 0.5, 2.0]),
    ],
)
def test_schedules_follow_their_rule_and_stay_in_range(
    schedule: str, expected: list[float]
) -> None:
    # Changes of a half, a half downwards, two, a half downwards, and two.
    assert _values(_perturber(schedule=schedule), [1, -1, 4, -1, 4]) == expected


def test_numbers_that_are_missing_are_the_published_ones() -> None:
    alone = _perturber().perturbation
    assert (alone.start, alone.lowest, alone.highest, alone.std) == (1.0, 0.0, 2.0, 0.5)
    easy = _perturber(parameter="", preset="easy").perturbation
    assert easy.parameter == "length"
    assert (easy.start, easy.lowest, easy.highest, easy.std) == (1.0, 0.5, 1.0, 0.1)
    own = _perturber(lowest=1.5, std=0.0).perturbation
    assert (own.start, own.lowest, own.highest, own.std) == (1.5, 1.5, 2.0, 0.0)


def test_fields_are_those_of_the_value() -> None:
    perturber = _perturber()
    for value in (*np.linspace(0, 2, 50).tolist(), 0.0):
        assert perturber.fields_of(value)["field"] == value


def test_an_episode_without_its_perturbation_has_the_tasks_model_and_its_start() -> None:
    longer = {"parameter": "lower_arm_length", "lowest": 0.2, "highest": 0.24, "start": 0.22}
    env: Any = suite.load(
        "manipulator", "bring_ball", {"random": 0}, faults={"perturbation": longer}
    )
    own = suite.load("manipulator", "bring_ball", {"random": 0}).physics.model.body_pos.copy()
    env.reset()
    model = env.physics.model
    found = env._ours.faults.unperturbed({"body_pos": model.body_pos[None], "time": np.ones(1)})
    target, hand = (model.name2id(name, "body") for name in ("target_ball", "hand"))
    assert (found["body_pos"][0, target] == model.body_pos[target]).all()
    assert (model.body_pos[hand] != own[hand]).any()
    own[target] = model.body_pos[target]
    np.testing.assert_array_equal(found["body_pos"][0], own)
    assert found["time"] == 1
    plain: Any = suite.load("reacher", "easy", faults="easy")
    assert (plain._ours.faults.nominal, plain._ours.faults.unperturbed({"a": own})["a"] is own) == (
        {},
        True,
    )


def test_a_challenge_that_does_not_perturb_a_task_leaves_it() -> None:
    assert Perturber.of(Perturbation(preset="hard"), _PARAMETERS, "Task", _Recompiler) is None
    world: Any = suite.load("reacher", "easy", faults="easy").world
    assert world["faults"]["perturbation"] is None


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"parameter": "lenght"}, "Task has no parameter 'lenght' to perturb; it has length. Did"),
        ({"lowest": 3.0}, "length has lowest 3.0, start .*; expected them in this order"),
        ({"start": 2.5}, "lowest 0.0, start 2.5, highest 2.0"),
    ],
)
def test_what_does_not_fit_the_task_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _perturber(**settings)


def test_a_perturbation_that_changes_nothing_is_refused() -> None:
    class _Idle(_Recompiler):
        def names(self, edits: Iterable[Any]) -> tuple[str, ...]:
            return ()

    with pytest.raises(ValueError, match=r"length from 0\.0 to 2\.0 changes nothing in the model"):
        Perturber.of(Perturbation("length"), _PARAMETERS, "Task", _Idle)


def test_a_range_without_a_valid_model_is_named() -> None:
    faults = {"perturbation": {"parameter": "thigh_length", "lowest": -1.0}}
    with pytest.raises(ValueError, match=r"^thigh_length from -1\.0 to \S+ gives no .*right_thigh"):
        suite.load("walker", "walk", faults=faults)


# In environments.


def _drawn(env: Any, episodes: int) -> list[float]:
    found = []
    for _ in range(episodes):
        env.reset()
        found.append(float(env.randomization["pole_length"]))
    return found


def test_a_value_lasts_for_its_period_and_a_seed_begins_again() -> None:
    faults = {"preset": "hard", "perturbation": {"period": 3}}
    env = suite.load(*_TASK, {"random": 4}, faults=faults)
    found = _drawn(env, 7)
    assert found[0] == found[1] == found[2] != found[3] == found[5] != found[6]
    assert all(0.5 <= value <= 2.3 for value in found)
    env.reseed(4)
    assert _drawn(env, 4) == found[:4]


def test_a_walk_continues_from_episode_to_episode_whether_memory_is_cleared_or_not() -> None:
    walk = {"parameter": "pole_length", "schedule": "drift_pos", "std": 0.01}
    for clears in (True, False):
        faults = {"perturbation": walk, "clear_at_reset": clears}
        found = _drawn(suite.load(*_TASK, {"random": 4}, faults=faults), 5)
        assert found[0] > 1.0
        assert (np.diff(found) > 0).all()


@pytest.mark.parametrize("vectorised", [None, False], ids=["vectorised", "rows"])
@pytest.mark.parametrize(("domain", "task"), [_TASK, ("quadruped", "walk")])
def test_rows_have_models_of_their_own(domain: str, task: str, vectorised: bool | None) -> None:
    how: dict[str, Any] = {"faults": "hard"}
    short = {"time_limit": 0.2}
    batch: Any = suite.load_batch(domain, task, 3, 1, 5, short, vectorised=vectorised, **how)
    assert (batch.why_rows is None) is (vectorised is None)
    singles = [suite.load(domain, task, {"random": 5 + i, **short}, **how) for i in range(3)]
    found, steps = batch.reset(), [one.reset() for one in singles]
    (name,) = singles[0].randomization
    for action in np.random.RandomState(0).uniform(-1, 1, (25, *batch.action_spec().shape)):
        drawn = [one.randomization[name] for one in singles]
        np.testing.assert_array_equal(batch.randomization[name], drawn)
        assert_equal(found, steps)
        found = batch.step(action)
        steps = [one.step(each) for one, each in zip(singles, action, strict=True)]


@pytest.mark.parametrize("vectorised", [None, False], ids=["vectorised", "rows"])
def test_snapshots_copies_and_pickles_have_the_model(vectorised: bool | None) -> None:
    how: dict[str, Any] = {"num_threads": 1, "seed": 5, "faults": "hard", "vectorised": vectorised}

    def load() -> Any:
        return suite.load_batch(*_TASK, 2, **how)

    batch = load()
    batch.reset()
    batch.step(np.zeros((2, 1)))
    saved, drawn = batch.snapshot(), batch.randomization["pole_length"].copy()
    others = [copy.deepcopy(batch), pickle.loads(pickle.dumps(batch)), load()]
    others[-1].restore(saved)
    single = suite.load(*_TASK, faults="hard")
    single.restore(saved.part(1))
    assert single.randomization["pole_length"] == drawn[1]
    for _ in range(3):
        batch.reset()
    assert (batch.randomization["pole_length"] != drawn).all()
    batch.restore(saved)
    for one in (batch, *others):
        np.testing.assert_array_equal(one.randomization["pole_length"], drawn)
    steps = [one.step(np.ones((2, 1))).observation["velocity"] for one in (batch, *others)]
    for step in steps[1:]:
        np.testing.assert_array_equal(step, steps[0])
    np.testing.assert_array_equal(single.step(np.ones(1)).observation["velocity"], steps[0][1])


def test_a_field_that_is_drawn_twice_is_refused() -> None:
    kwargs = {"randomize": {"body_mass": scale(0.9, 1.1)}}
    with pytest.raises(ValueError, match="randomize and the perturbation both set body_mass"):
        suite.load(*_TASK, environment_kwargs=kwargs, faults="easy")


def test_other_fields_may_be_drawn_beside() -> None:
    kwargs = {"randomize": {"opt.gravity": scale(0.5, 0.9)}}
    env = suite.load(*_TASK, {"random": 0}, kwargs, faults="easy")
    env.reset()
    assert list(env.randomization) == ["opt.gravity", "pole_length"]
    mass = float(env.physics.model.body_mass[-1])
    assert mass == env.randomization["pole_length"] / 10
