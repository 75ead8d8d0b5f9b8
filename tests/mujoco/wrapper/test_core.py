"""Callbacks and the timer."""

import ctypes

import mujoco
import pytest

from limberjack.mujoco import wrapper


def test_a_callback_applies_within_its_context_and_is_restored(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    calls = []
    before = mujoco.get_mjcb_control()
    with wrapper.callback_context("mjcb_control", lambda m, d: calls.append("outer")):
        mujoco.mj_forward(model.ptr, data.ptr)
        with wrapper.callback_context("mjcb_control", lambda m, d: calls.append("inner")):
            mujoco.mj_forward(model.ptr, data.ptr)
        mujoco.mj_forward(model.ptr, data.ptr)
    mujoco.mj_forward(model.ptr, data.ptr)
    assert calls == ["outer", "inner", "outer"]
    with pytest.raises(ZeroDivisionError), wrapper.callback_context("mjcb_control", print):
        raise ZeroDivisionError
    assert mujoco.get_mjcb_control() is before
    wrapper.set_callback("mjcb_control", lambda m, d: calls.append("set"))
    mujoco.mj_forward(model.ptr, data.ptr)
    wrapper.set_callback("mjcb_control", None)
    mujoco.mj_forward(model.ptr, data.ptr)
    assert calls[3:] == ["set"]


def test_the_timer_is_switched_on_and_off() -> None:
    before = mujoco.get_mjcb_time()
    try:
        wrapper.enable_timer()
        assert mujoco.get_mjcb_time() is not None
        wrapper.enable_timer(False)
        assert mujoco.get_mjcb_time() is None
    finally:
        mujoco.set_mjcb_time(before)


def test_a_c_function_is_a_callback(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    calls = []
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    function = kind(lambda m, d: calls.append("C"))
    with wrapper.callback_context("mjcb_passive", function):
        mujoco.mj_forward(model.ptr, data.ptr)
    assert calls == ["C"]
