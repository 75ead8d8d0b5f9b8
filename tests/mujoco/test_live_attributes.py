"""Attributes of a `Physics` that show its simulation do not go to copies and batches."""

import copy
import pickle
from typing import Any

import mujoco as official
import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.rl import batch_of, control
from limberjack.suite import cartpole

_XML = (
    '<mujoco><worldbody><body name="b" pos="0 0 1"><freejoint/><geom size=".1"/></body>'
    "</worldbody></mujoco>"
)
_COPIES = {
    "copy": lambda physics: physics.copy(),
    "shared": lambda physics: physics.copy(share_model=True),
    "deepcopy": copy.deepcopy,
    "pickle": lambda physics: pickle.loads(pickle.dumps(physics)),
}
_SHOWN = {
    "array": lambda physics: physics.data.xpos,
    "element": lambda physics: [{"x": physics.data.xpos[1:, 2]}],
    "data": lambda physics: physics.data,
    "official": lambda physics: physics.data._data,
    "named": lambda physics: physics.named.data.xpos,
    "struct": lambda physics: physics.named.data,
    "model": lambda physics: physics.model,
}


class Keeping(cartpole.Physics):
    """Keeps something of its simulation."""

    kind = "array"

    def __init__(self, data: Any) -> None:
        super().__init__(data)
        self.kept = _SHOWN[self.kind](self)
        self.own = [1, 2]


class Binding(mujoco.Physics):
    """Binds arrays where dm_control tells a subclass to."""

    def _reload_from_data(self, data: Any) -> None:
        super()._reload_from_data(data)
        self.place = self.named.data.xpos
        self.qpos = self.data.qpos


@pytest.mark.parametrize("kind", _SHOWN)
@pytest.mark.parametrize("how", _COPIES)
def test_a_copy_lacks_what_shows_the_original_and_has_the_rest(
    kind: str, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Keeping, "kind", kind)
    physics = Keeping.from_xml_string(*cartpole.get_model_and_assets())
    other = _COPIES[how](physics)
    assert other.own == [1, 2]
    with pytest.raises(AttributeError, match="no attribute 'kept'"):
        _ = other.kept


@pytest.mark.parametrize("kind", ["array", "named", "data"])
def test_a_batch_has_the_rewards_of_single_environments(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Task(cartpole.Balance):
        def get_reward(self, physics: Any) -> Any:
            kept = physics.kept
            return (kept.xpos if kind == "data" else kept)[2, 0]

    def make(seed: int) -> control.Environment:
        physics = Keeping.from_xml_string(*cartpole.get_model_and_assets())
        return control.Environment(physics, Task(swing_up=True, sparse=False, random=seed))

    monkeypatch.setattr(Keeping, "kind", kind)
    batch = batch_of(make, 2, seed=3)
    batch.reset()
    alone = [make(3), make(4)]
    for env in alone:
        env.reset()
    for _ in range(3):
        found = batch.step(np.ones((2, 1))).reward
        np.testing.assert_array_equal(found, [env.step(np.ones(1)).reward for env in alone])
    assert batch.why_rows


@pytest.mark.parametrize("how", _COPIES)
def test_copies_bind_arrays_in_the_hook_that_reloads(how: str) -> None:
    physics = Binding.from_xml_string(_XML)
    physics.step(7)
    before = physics.get_state(official.mjtState.mjSTATE_INTEGRATION.value)
    other = _COPIES[how](physics)
    other.step(50)
    assert float(other.place["b", "z"]) == float(other.named.data.xpos["b", "z"])
    assert float(other.place["b", "z"]) < float(physics.place["b", "z"])
    np.testing.assert_array_equal(other.qpos, other.data.qpos)
    after = physics.get_state(official.mjtState.mjSTATE_INTEGRATION.value)
    np.testing.assert_array_equal(after, before)


def test_an_exact_copy_keeps_every_quantity_beside_that_hook() -> None:
    physics = Binding.from_xml_string(_XML)
    physics.step(7)
    other = Binding.__new__(Binding)
    state: Any = copy.deepcopy(physics.__getstate__())
    other.become(state)
    for name in ("qacc_warmstart", "qacc", "xpos", "cvel", "time"):
        np.testing.assert_array_equal(getattr(other.data, name), getattr(physics.data, name))


def test_the_error_within_a_property_is_shown() -> None:
    class Misspelt(mujoco.Physics):
        @property
        def tip(self) -> Any:
            return self.named.data.xpso["b"]

    with pytest.raises(AttributeError, match="xpso"):
        _ = Misspelt.from_xml_string(_XML).tip


def test_no_part_of_the_model_is_changed_through_a_batch() -> None:
    batch = suite.load_batch("cartpole", "swingup", num_envs=2, seed=0)
    vis = batch.physics.model.vis
    znear, ambient = vis.map.znear, vis.headlight.ambient.copy()
    with pytest.raises(ValueError, match=r"vis\.map\.znear is shared by all rows"):
        vis.map.znear = 0.5
    with pytest.raises(ValueError, match="read-only"):
        vis.headlight.ambient[:] = 9
    new = suite.load("cartpole", "swingup").physics.model.vis
    assert new.map.znear == znear
    np.testing.assert_array_equal(new.headlight.ambient, ambient)


def test_the_model_behind_official_data_is_simulated_with_nowhere() -> None:
    env = suite.load("pendulum", "swingup", {"random": 0})
    gravity = env.physics.data.ptr.model.opt.gravity
    gravity[:] = 0
    batch = suite.load_batch("pendulum", "swingup", num_envs=2, seed=0)
    for physics in (batch.physics, env.physics, suite.load("pendulum", "swingup").physics):
        assert physics.model.opt.gravity[2] == -9.81


def test_a_batchs_model_is_disabled_nowhere_and_pickled_as_a_model() -> None:
    batch = suite.load_batch("pendulum", "swingup", num_envs=2, seed=0)
    with (
        pytest.raises(TypeError, match="a batch cannot disable gravity"),
        batch.physics.model.disable("gravity"),
    ):
        pass
    assert pickle.loads(pickle.dumps(batch.physics.model)).nq == 1


def test_after_a_reset_rows_have_no_actuation_beside_a_forward_of_its_own() -> None:
    class Physics(cartpole.Physics):
        def forward(self) -> None:
            super().forward()

    physics = Physics.from_xml_string(*cartpole.get_model_and_assets())
    rows = physics.replicate(2, 1).physics
    for one in (rows, physics):
        one.data.ctrl[:] = 1
        one.after_reset()
        assert not one.data.qfrc_actuator.any()
