"""Recorded steps of a batch read the same as at the time of recording."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.history import History

_MOMENTS = 3


def _batch(num_envs: int = 4) -> Any:
    """A batch of the ball task, each row with a target of its own (a field of the model)."""
    env = suite.load_batch("manipulator", "bring_ball", num_envs, 1, seed=3)
    env.reset()
    return env.physics


def _seen(physics: Any) -> list[np.ndarray]:
    """Quantities of all kinds: state, computed, of the model, of single names, of methods."""
    data = physics.named.data
    return [
        np.array(physics.data.time),
        np.array(data.qpos["ball_x"]),
        np.array(data.xmat["ball", ["xx", "zz"]]),
        np.array(data.site_xpos[["grasp", "ball"]]),
        np.array(physics.named.model.body_pos["target_ball"]),
        physics.position(),
        physics.control(),
        physics.touch(),
    ]


def _played(physics: Any, history: History) -> list[list[np.ndarray]]:
    history.begin()
    live = []
    for step in range(_MOMENTS):
        physics.set_control(np.full((4, 5), 0.3 * step - 0.4))
        physics.simulation.step(5)
        history.record(step)
        live.append(_seen(physics))
    return live


def test_what_was_noted_is_what_was_seen() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    seen = history.read_by(physics)
    _seen(seen)
    assert not history.is_complete
    for _ in range(2):  # a second time with the same arrays
        live = _played(physics, history)
        noted = _seen(seen)
        assert history.is_complete
        assert len(np.unique(noted[0])) == _MOMENTS
        for parts, whole in zip(zip(*live, strict=True), noted, strict=True):
            np.testing.assert_array_equal(whole, np.concatenate(parts))
    assert seen.num_envs == history.num_envs == 4 * _MOMENTS


def test_what_is_asked_for_late_is_the_present_and_said_to_be_missing() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    live = _played(physics, history)
    seen = history.read_by(physics)
    np.testing.assert_array_equal(seen.position(), np.tile(live[-1][5], (_MOMENTS, 1)))
    assert not history.is_complete
    history.begin()
    assert history.is_complete


def test_what_the_rows_have_in_common_is_the_models() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    seen = history.read_by(physics)
    assert seen.named.model.body_mass["ball"].shape == ()
    assert seen.model.nu == 5
    assert history.is_complete


def test_it_cannot_be_stepped() -> None:
    physics = _batch()
    seen = History(physics.simulation, _MOMENTS).read_by(physics)
    with pytest.raises(TypeError, match=r"does not support step\(\)"):
        seen.step(1)
    with pytest.raises(AttributeError, match="can be read, not stepped"):
        seen.simulation.step(1)


def test_of_what_is_read_by_names_no_more_is_noted_than_that() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    named = history.read_by(physics).named.data

    def whole() -> np.ndarray:
        kept = history._kept["data by names", "site_xpos"]
        return np.array(kept.reshape(*kept.shape[:2], -1, 3))

    sites = ["grasp", "ball"]
    first = np.array(named.site_xpos[sites])
    assert not history.is_complete
    before = whole()
    live = _played(physics, history)
    assert history.is_complete
    np.testing.assert_array_equal(named.site_xpos[sites], np.concatenate([one[3] for one in live]))
    assert not np.array_equal(named.site_xpos[sites], first)
    changed = (whole() != before).any(axis=(0, 1))
    asked = [physics.model.name2id(site, "site") for site in sites]
    assert abs(asked[0] - asked[1]) > 3  # too far apart to be noted with what is in between
    assert set(np.flatnonzero(changed.any(axis=-1))) <= set(asked)
    assert changed.any()


def test_another_part_of_a_field_is_said_to_be_missing_until_it_is_noted() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    named = history.read_by(physics).named.data
    named.xmat["ball", "xx"]
    _played(physics, history)
    assert history.is_complete
    for read in (lambda: named.xmat["hand"], lambda: np.array(named.xmat)):
        read()
        assert not history.is_complete
        live = _played(physics, history)
        read()
        assert history.is_complete
        expected = np.concatenate([one[2][:, 0] for one in live])
        np.testing.assert_array_equal(named.xmat["ball", "xx"], expected)
    whole = np.array(named.xmat).reshape(_MOMENTS, 4, -1, 9)
    np.testing.assert_array_equal(whole[-1], physics.data.xmat.reshape(4, -1, 9))
    named.xmat.mean()  # of what is noted already
    assert history.is_complete


def test_all_steps_at_once_are_noted_as_one_after_the_other() -> None:
    physics = _batch()
    one_by_one, at_once = (
        History(physics.simulation, _MOMENTS),
        History(physics.simulation, _MOMENTS),
    )
    seen = [history.read_by(physics) for history in (one_by_one, at_once)]
    for physics_of in seen:
        _seen(physics_of)
    records: dict[str, list[np.ndarray]] = {}
    one_by_one.begin()
    at_once.begin()
    for step in range(_MOMENTS):
        physics.simulation.step(5)
        one_by_one.record(step)
        for field in at_once.fields:
            records.setdefault(field, []).append(np.array(getattr(physics.data, field)))

    def values_of(field: str, columns: slice) -> np.ndarray:
        recorded = np.array(records[field])
        return recorded.reshape(*recorded.shape[:2], -1)[..., columns]

    at_once.record_all(values_of)
    for expected, found in zip(_seen(seen[0]), _seen(seen[1]), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_the_last_step_is_read_by_itself() -> None:
    physics = _batch()
    history = History(physics.simulation, _MOMENTS)
    seen, last = history.read_by(physics), history.last_read_by(physics)
    assert (last.num_envs, seen.num_envs) == (4, 4 * _MOMENTS)
    _seen(last)
    assert not history.is_complete  # what it reads is recorded from now on, too
    for _ in range(2):
        live = _played(physics, history)
        for now, noted in zip(live[-1], _seen(last), strict=True):
            np.testing.assert_array_equal(noted, now)
        assert history.is_complete
    with pytest.raises(AttributeError, match="recorded states have no 'step'"):
        last.simulation.step(1)
