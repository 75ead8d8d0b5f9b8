"""Copies of an environment's model and state for a viewer to draw, in each quality."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite, viewer
from limberjack.mujoco import Physics
from limberjack.rl import control
from limberjack.suite import base
from limberjack.viewer.session import Session

_FLAG = "<custom><numeric name='filament.ao.enabled' data='1'/></custom>"
_PENDULUM = "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
_LOOKS = ("mat_rgba", "tex_data", "cam_pos", "cam_poscom0", "cam_quat")


def test_the_state_is_copied_to_a_viewer_s_own_model_and_data() -> None:
    environment = suite.load("manipulator", "bring_ball", {"random": 0})
    session = Session(environment, {"policy": viewer.begin_with("random")}, seed=0)
    model = session.shown.copy_model()
    data = mujoco.MjData(model)
    session.push(np.ones((model.nbody, 6)))
    for _ in range(3):
        session.step()
    session.shown.copy_state(model, data)
    mujoco.mj_forward(model, data)
    physics = environment.physics.copy()
    physics.forward()
    np.testing.assert_array_equal(data.geom_xpos, physics.data.geom_xpos)
    assert data.time == session.data.time
    assert not data.xfrc_applied.any()  # the viewer knows its own pushes
    model.body_pos[:] = 7.0
    assert not (session.model.body_pos == 7.0).all()


def test_a_start_that_changes_the_model_is_noticed() -> None:
    arm = Session(
        suite.load("manipulator", "bring_ball", {"random": 0}), seed=0
    )  # its target is part of the model
    humanoid = Session(suite.load("humanoid", "stand", {"random": 0}), seed=0)
    for session, grows in ((arm, True), (humanoid, False)):
        before = session.shown.version
        session.step()
        assert session.shown.version == before
        session.reset()
        assert (session.shown.version > before) == grows


def test_each_episode_of_an_appearance_gives_the_viewer_another_model() -> None:
    look = {"colors": 0.3, "camera": 0.3, "background": "noise"}
    environment = suite.load("walker", "walk", {"random": 0}, appearance=look)
    session = Session(environment, seed=0)
    own, model = environment.physics.model._official, session.shown.copy_model()
    before, version = own.mat_rgba.copy(), session.shown.version
    assert 0.1 < abs(model.mat_rgba - before)[:, :3].max() <= 0.3 + 1e-6
    first = {name: np.copy(getattr(model, name)) for name in _LOOKS}
    assert session.shown.copy_fields(model) == []
    session.reset()
    assert session.shown.version > version
    assert {*_LOOKS} <= {*session.shown.copy_fields(model)}
    for name, value in first.items():
        assert not np.array_equal(getattr(model, name), value)
        np.testing.assert_array_equal(
            getattr(session.shown.copy_model(), name), getattr(model, name)
        )
    assert (own.mat_rgba == before).all()


def test_a_fast_view_has_no_shadows_and_leaves_the_model_as_it_is() -> None:
    environment = suite.load("stacker", "stack_2", {"random": 0})
    own = environment.physics.model._official
    session = Session(environment, quality="fast")
    model = session.shown.copy_model()
    assert own.light_castshadow.any()
    assert own.mat_reflectance.any()
    assert not model.light_castshadow.any()
    assert not model.mat_reflectance.any()
    assert (model.vis.quality.shadowsize, model.vis.quality.offsamples) == (0, 0)
    assert own.vis.quality.shadowsize > 0
    place = environment.physics.model.name2id("target", "body")
    before = model.body_pos[place].copy()
    session.reset()
    assert session.shown.copy_fields(model) == ["body_pos"]
    assert (model.body_pos[place] != before).any()
    assert not model.light_castshadow.any()


def test_a_fast_view_tells_studio_to_leave_the_darker_corners_away() -> None:
    environment = suite.load("quadruped", "escape", {"random": 0})
    session = Session(environment, quality="fast")
    model, own = session.shown.copy_model(), session.model
    assert own.nnumeric == 0
    assert model.numeric("filament.ao.enabled").data == [0.0]
    np.testing.assert_array_equal(model.hfield_data, own.hfield_data)
    for kind, number in (("geom", own.ngeom), ("sensor", own.nsensor), ("material", own.nmat)):
        for i in range(number):
            assert getattr(model, kind)(i).name == getattr(own, kind)(i).name
    session.reset()
    assert "hfield_data" in session.shown.copy_fields(model)
    np.testing.assert_array_equal(model.hfield_data, session.model.hfield_data)


def test_a_fast_view_of_a_model_that_cannot_be_compiled_again_has_no_shadows() -> None:
    environment = suite.load("cartpole", "swingup", {"random": 0})
    session = Session(environment, quality="fast")
    environment.physics.reload_from_xml_string(_PENDULUM)  # of other sizes
    model = session.shown.copy_model()
    assert (model.nnumeric, model.nq) == (0, 1)
    assert not model.light_castshadow.any()
    assert model.vis.quality.shadowsize == 0


class _Still(base.Task):
    def get_observation(self, physics: Physics) -> dict[str, Any]:
        return {"position": physics.position()}

    def get_reward(self, physics: Physics) -> float:
        return 1.0


@pytest.mark.parametrize(
    ("physics", "flags"),
    [
        (Physics.from_xml_string(_PENDULUM), 1),
        (Physics.from_xml_string(_PENDULUM.replace("<worldbody>", f"{_FLAG}<worldbody>")), 1),
        (Physics.from_byte_string(Physics.from_xml_string(_PENDULUM).model.to_bytes()), 0),
    ],
)
def test_a_fast_view_of_a_users_task_has_its_model(physics: Physics, flags: int) -> None:
    physics.model.geom_rgba[0, 0] = 0.25
    environment = control.Environment(physics, _Still(0), control_timestep=0.02)
    model = Session(environment, quality="fast").shown.copy_model()
    assert model.nnumeric == flags
    assert model.geom_rgba[0, 0] == 0.25
    assert model.vis.quality.shadowsize == 0


def test_a_browser_that_draws_by_software_is_shown_the_fast_view_unless_another_is_asked_for() -> (
    None
):
    session = Session(suite.load("cartpole", "swingup", {"random": 0}))
    shadows = session.model.vis.quality.shadowsize
    assert (session.status().quality, _shadows(session)) == ("auto", shadows)
    before = session.shown.version
    session.shown.drawn_by_software()
    assert session.shown.version > before  # so that it is drawn now
    assert (session.status().quality, _shadows(session)) == ("auto", 0)
    assert session.shown.copy_model().numeric("filament.ao.enabled").data == [0.0]
    before = session.shown.version
    session.shown.drawn_by_software()  # as each page says that is opened
    session.shown.set_quality("fast")
    assert session.shown.version == before  # nothing is sent again
    session.shown.set_quality("full")
    session.shown.drawn_by_software()
    assert (session.status().quality, _shadows(session)) == ("full", shadows)
    assert session.shown.copy_model().nnumeric == 0
    session.shown.set_quality("fast")
    assert _shadows(session) == 0
    session.shown.set_quality("full")
    session.shown.set_quality("auto")
    assert _shadows(session) == 0  # it still draws by software


def _shadows(session: Session) -> int:
    return session.shown.copy_model().vis.quality.shadowsize


def test_an_unknown_quality_is_refused_by_name_and_changes_nothing() -> None:
    refusal = "quality is 'quick'; expected auto, full, fast"
    with pytest.raises(ValueError, match=refusal):
        Session(suite.load("cartpole", "swingup"), quality="quick")
    session = Session(suite.load("cartpole", "swingup"), quality="fast")
    before = session.shown.version
    with pytest.raises(ValueError, match=refusal):
        session.shown.set_quality("quick")
    assert (session.status().quality, session.shown.version) == ("fast", before)
