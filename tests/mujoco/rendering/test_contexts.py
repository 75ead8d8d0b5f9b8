"""`physics.contexts` runs MuJoCo's own drawing functions."""

import pytest

from limberjack.mujoco.camera import (
    contexts,
)
from tests.mujoco.furnished import furnished


def test_contexts_run_functions_where_opengl_is() -> None:
    physics = furnished()
    with contexts(physics).gl.make_current() as context:
        assert context.call(lambda a, b: a + b, 1, b=2) == 3
        with pytest.raises(ZeroDivisionError):
            context.call(lambda: 1 / 0)
    first = contexts(physics).mujoco.ptr
    assert (first.offHeight, first.offWidth) == (200, 300)
    assert physics.contexts.mujoco.ptr is first


def test_a_program_may_free_contexts_as_often_as_it_likes() -> None:
    physics = furnished()
    before = physics.render(32, 32)
    for _ in range(2):
        physics.contexts.mujoco.free()
        physics.contexts.gl.free()
    assert (physics.render(32, 32) == before).all()
