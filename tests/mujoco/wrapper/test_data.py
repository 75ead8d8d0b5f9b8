"""Tests of limberjack.mujoco.wrapper.data."""

import copy
import pickle
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import wrapper


def test_data_has_the_official_fields_and_the_model(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    assert data.model is model
    assert data.ptr is data._data
    assert np.shares_memory(data.qpos, data.ptr.qpos)
    data.qpos = np.arange(7.0)
    data.time = 3.0
    np.testing.assert_array_equal(data.ptr.qpos, np.arange(7.0))
    assert data.ptr.time == 3.0
    assert {"qpos", "contact_force", "model"} <= set(dir(data))
    assert not hasattr(data, "nothing")
    assert wrapper.MjData(mujoco.MjData(model.ptr)).model.nbody == 3
    for bad in (None, model.ptr, "data"):
        with pytest.raises(TypeError, match=r"Expected wrapper\.MjModel or mujoco\.MjData"):
            wrapper.MjData(bad)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("way", ["copy", "method", "deepcopy", "pickle"])
def test_a_copy_of_data_is_the_same_and_apart(data: wrapper.MjData, way: str) -> None:
    made: dict[str, Any] = {
        "copy": lambda: copy.copy(data),
        "method": lambda: data.copy(),
        "deepcopy": lambda: copy.deepcopy(data),
        "pickle": lambda: pickle.loads(pickle.dumps(data)),
    }
    other = made[way]()
    assert (other.model is data.model) == (way in ("copy", "method"))
    for name in ("qpos", "xpos", "qacc_warmstart", "sensordata"):
        np.testing.assert_array_equal(getattr(other, name), getattr(data, name))
    other.qpos[:] = 5.0
    assert not np.any(data.qpos == 5.0)


def test_contacts_are_limited_to_the_current_ones(data: wrapper.MjData) -> None:
    assert len(data.contact) == data.ncon == 1
    assert data.contact.geom[0].tolist() == [0, 1]


def test_a_contacts_force_carries_the_weight(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    for _ in range(2000):
        mujoco.mj_step(model.ptr, data.ptr)
    mujoco.mj_step1(model.ptr, data.ptr)
    force, torque = data.contact_force(0)
    # At rest; what the solver leaves over.
    assert force[0] == pytest.approx(2 * 9.81, rel=1e-3)
    assert np.abs([*force[1:], *torque]).max() < 1e-3
    for bad in (-1, 1, 99):
        with pytest.raises(ValueError, match=rf"between 0 and 0 \(inclusive\), got: {bad}"):
            data.contact_force(bad)


def test_an_objects_velocity_is_linear_then_angular(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    data.qvel[:] = [1, 2, 3, 0.1, 0.2, 0.3]
    mujoco.mj_forward(model.ptr, data.ptr)
    velocity = data.object_velocity("ball", "body")
    assert velocity.shape == (2, 3)
    # Rounded on its way through the spatial velocity.
    np.testing.assert_allclose(velocity, [[1, 2, 3], [0.1, 0.2, 0.3]], atol=1e-12)
    np.testing.assert_array_equal(data.object_velocity(1, mujoco.mjtObj.mjOBJ_BODY), velocity)
    turned = np.array([0.0, 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    data.qpos[:] = turned  # a quarter turn about z
    mujoco.mj_forward(model.ptr, data.ptr)
    local = data.object_velocity("ball", "body", local_frame=True)
    np.testing.assert_allclose(local[0], [2, -1, 3], atol=1e-12)
    with pytest.raises(wrapper.Error, match="'bal'"):
        data.object_velocity("bal", "body")


@pytest.mark.parametrize(
    ("kind", "count"), [("body", 3), ("xbody", 3), ("geom", 3), ("site", 1), ("camera", 0)]
)
def test_the_velocity_of_an_object_that_does_not_exist_is_refused(
    data: wrapper.MjData, kind: str, count: int
) -> None:
    for number in range(count):
        assert data.object_velocity(number, kind).shape == (2, 3)
    # MuJoCo itself would read outside its arrays, and crash the process for the large ones.
    for number in (-1, count, 10**7, np.int64(10**12)):
        expected = f"object_id is {number};.*the model has {count} objects of type '{kind}'"
        with pytest.raises(ValueError, match=expected):
            data.object_velocity(number, kind)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("kind", ["joint", "light", "sensor", 0, mujoco.mjtObj.mjOBJ_FRAME, 999])
def test_objects_that_have_no_velocity_are_refused(data: wrapper.MjData, kind: str | int) -> None:
    with pytest.raises(ValueError, match=r"have no velocity; expected 'body', 'xbody'"):
        data.object_velocity(0, kind)


def test_freeing_twice_is_fine(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    for thing in (data, model, wrapper.MjvScene()):
        thing.free()
        thing.free()
