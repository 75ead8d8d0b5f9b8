"""MuJoCo Studio's messages and their effects on a session: no window, no browser, no thread."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.viewer.session import Session

studio = pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)
messages = pytest.importorskip("mujoco.studio.messages")
sim = pytest.importorskip("mujoco.studio.sim")
sim_history = pytest.importorskip("mujoco.studio.sim_history")
launch_thread = pytest.importorskip("mujoco.studio.launch_thread")
viewer_handle = pytest.importorskip("mujoco.studio.viewer_handle")
viewer_utils = pytest.importorskip("mujoco.studio.viewer_utils")

_PAUSED = sim.PauseState.NORMAL_PAUSED
_UNPAUSED = sim.PauseState.UNPAUSED


class _Studio:
    """A session and the other end of Studio's channels."""

    def __init__(self, domain: str, task: str) -> None:
        self.now = 0.0
        environment = suite.load(domain, task, task_kwargs={"random": 0, "time_limit": 1.0})
        self.session = Session(environment, seed=0, clock=lambda: self.now)
        self.viewer, of_loop = launch_thread.make_thread_endpoints()
        plugins = [studio._Loop(self.session), sim_history.SimHistory()]
        self.handle = viewer_handle.ViewerHandle(of_loop, sim_plugins=plugins)
        studio._set_model(self.handle, self.session)

    def send(self, message: Any) -> None:
        self.viewer.send_to_sim(message)
        self.handle.sync()

    def step(self) -> None:
        """Lets a control step become due, or a little more."""
        self.now += 1.1 * self.session._environment.control_timestep()
        self.handle.sync()

    def received(self, kind: type) -> list[Any]:
        """The messages of one kind sent to the viewer since the last call; the rest is lost."""
        sent = [*self.viewer.get_sim_events(), *self.viewer.get_sim_snapshots()]
        return [message for message in sent if isinstance(message, kind)]

    def shown(self) -> SimpleNamespace:
        """The state that Studio was last sent, in a model and data of its own."""
        (snapshot,) = self.received(messages.StateSnapshot)
        model = self.session.shown.copy_model()
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, snapshot.state, snapshot.state_sig)
        return SimpleNamespace(qpos=data.qpos, time=data.time)


@pytest.fixture
def humanoid() -> Iterator[_Studio]:
    made = _Studio("humanoid", "stand")
    yield made
    made.handle.close()


def test_steps_are_shown_as_they_become_due(humanoid: _Studio) -> None:
    for steps in (1, 2, 3):
        humanoid.step()
        assert humanoid.session.status().step == steps
        np.testing.assert_array_equal(humanoid.shown().qpos, humanoid.session.data.qpos)


def test_the_panel_gets_the_reward(humanoid: _Studio) -> None:
    humanoid.step()
    told = humanoid.received(studio._StatusEvent)
    assert told[-1].status == humanoid.session.status()
    humanoid.handle.sync()  # nothing is due, so there is nothing to tell
    assert humanoid.received(studio._StatusEvent) == []


def test_pause_and_single_steps_are_the_session_s(humanoid: _Studio) -> None:
    humanoid.send(messages.RequestPauseEvent(_PAUSED))
    humanoid.step()
    assert humanoid.session.status().step == 0
    (settings,) = humanoid.received(messages.StepControlSnapshot)
    assert settings.pause_state == _PAUSED  # Studio's own button follows
    humanoid.send(messages.SingleStepEvent())
    assert humanoid.session.status().step == 1
    np.testing.assert_array_equal(humanoid.shown().qpos, humanoid.session.data.qpos)
    humanoid.send(messages.RequestPauseEvent(_UNPAUSED))
    humanoid.step()
    assert humanoid.session.status().step == 2


def test_speed_is_the_session_s(humanoid: _Studio) -> None:
    humanoid.send(messages.StepControlSnapshot(speed=50.0, noise_scale=1.0))
    assert humanoid.session.speed == 0.5
    humanoid.step()
    assert humanoid.session.status().step == 0


def test_a_speed_given_at_the_start_is_sent_to_studio() -> None:
    made = _Studio("humanoid", "stand")
    made.session.set_speed(2.0)
    made.handle.sync()
    (settings,) = made.received(messages.StepControlSnapshot)
    assert (settings.speed, settings.pause_state) == (200.0, _UNPAUSED)
    made.handle.close()


def test_reset_begins_the_next_episode_and_shows_its_start(humanoid: _Studio) -> None:
    humanoid.step()
    humanoid.received(messages.Message)
    humanoid.send(messages.ResetEvent(key=-1))
    status = humanoid.session.status()
    assert (status.episode, status.step, status.seed) == (2, 0, 1)
    shown = humanoid.shown()
    np.testing.assert_array_equal(shown.qpos, humanoid.session.data.qpos)
    assert shown.time == 0.0


def test_a_push_reaches_the_simulation(humanoid: _Studio) -> None:
    forces = np.zeros((humanoid.session.model.nbody, 6))
    forces[1, 2] = 100.0
    push = messages.PerturbSnapshot(forces.ravel(), int(mujoco.mjtState.mjSTATE_XFRC_APPLIED))
    humanoid.send(push)
    humanoid.step()
    np.testing.assert_array_equal(humanoid.session.data.xfrc_applied, forces)
    humanoid.send(messages.PerturbSnapshot(np.zeros(12), push.state_sig))  # of another model
    humanoid.step()
    np.testing.assert_array_equal(humanoid.session.data.xfrc_applied, forces)
    humanoid.send(messages.PerturbSnapshot(np.zeros(forces.size), push.state_sig))
    humanoid.step()
    assert not humanoid.session.data.xfrc_applied.any()


def test_a_body_dragged_with_the_mouse_is_pulled_that_way(humanoid: _Studio) -> None:
    model = humanoid.session.shown.copy_model()
    data = mujoco.MjData(model)
    humanoid.session.shown.copy_state(model, data)
    mujoco.mj_forward(model, data)
    mouse = mujoco.MjvPerturb()
    mouse.select = 1  # the torso
    mouse.active = int(mujoco.mjtPertBit.mjPERT_TRANSLATE)
    mouse.scale, mouse.localmass = 1.0, model.body_subtreemass[1]
    mouse.refselpos[:] = data.xpos[1] + (0.0, 0.0, 2.0)  # metres; where it was dragged to
    viewer = SimpleNamespace(
        perturb=mouse,
        send_to_sim=humanoid.viewer.send_to_sim,
        send_if_changes=lambda *messages: contextlib.nullcontext(),
    )
    viewer_utils.apply_perturb(viewer, model, data)  # as Studio does for each frame
    humanoid.handle.sync()
    for _ in range(5):
        humanoid.step()
    assert humanoid.session.data.xfrc_applied[1, 2] > 100.0  # N, upwards
    assert not humanoid.session.data.xfrc_applied[2:].any()
    assert humanoid.session.data.cvel[1, 5] > 0.0


def test_what_would_change_the_environment_is_refused(humanoid: _Studio) -> None:
    session = humanoid.session
    session.pause()
    before = session.data.qpos.copy()
    gravity = session.model.opt.gravity.copy()
    options = session.shown.copy_model().opt
    options.gravity[:] = 0.0
    position = int(mujoco.mjtState.mjSTATE_QPOS)
    for message in (
        messages.StateEvent(np.zeros(before.size), position),
        messages.MjOptionSnapshot(options),
        messages.ThreadPoolEvent(2),
        messages.LoadModelEvent(path="/nowhere/at/all.xml"),
    ):
        humanoid.send(message)
        np.testing.assert_array_equal(session.data.qpos, before)
        np.testing.assert_array_equal(humanoid.shown().qpos, before)
        np.testing.assert_array_equal(humanoid.handle.model.opt.gravity, gravity)


def test_looking_back_in_time_does_not_move_the_environment(humanoid: _Studio) -> None:
    for _ in range(4):
        humanoid.step()
    now = humanoid.session.data.qpos.copy()
    humanoid.send(sim_history.SimHistorySnapshot(index=-2))
    assert humanoid.session.paused
    assert humanoid.shown().time < humanoid.session.data.time
    np.testing.assert_array_equal(humanoid.session.data.qpos, now)
    humanoid.send(messages.RequestPauseEvent(_UNPAUSED))
    np.testing.assert_array_equal(humanoid.shown().qpos, now)


def test_studio_has_a_model_of_its_own(humanoid: _Studio) -> None:
    assert humanoid.handle.model is not humanoid.session.model
    humanoid.handle.model.body_mass[:] = 1.0
    assert not (humanoid.session.model.body_mass == 1.0).all()


def test_an_episode_with_another_model_is_shown_with_it() -> None:
    arm = _Studio("manipulator", "bring_ball")
    arm.step()
    arm.received(messages.Message)
    arm.send(messages.ResetEvent(key=-1))
    (sent,) = arm.received(messages.ModelEvent)
    target = arm.session.model.body("target_ball").id
    np.testing.assert_array_equal(sent.model.body_pos[target], arm.session.model.body_pos[target])
    np.testing.assert_array_equal(arm.handle.data.qpos, arm.session.data.qpos)
    arm.handle.close()


def test_a_module_has_its_own_value_again_after_an_error() -> None:
    module = ModuleType("module")
    module.__dict__["value"] = 1
    seen: list[int] = []

    def fail() -> None:
        seen.append(module.value)
        raise KeyError

    with pytest.raises(KeyError), studio._replaced(module, "value", 2):
        fail()
    assert (seen, module.value) == ([2], 1)


def test_a_name_that_the_module_lacks_is_an_error() -> None:
    with (
        pytest.raises(AttributeError, match="serve"),
        studio._replaced(ModuleType("module"), "serve", 2),
    ):
        pass


def test_settings_are_saved_and_loaded_in_a_file_of_their_own() -> None:
    used: list[str] = []
    ux = ModuleType("ux")  # `cli/test_view.py` has the real one
    names = ("load_settings", "load_theme", "reset_config", "save_settings")
    for name in names:
        ux.__dict__[name] = lambda *arguments, ini_path="": used.append(ini_path)
    with studio._private_settings(ux):
        for name in names:
            getattr(ux, name)()
        assert len(set(used)) == 1
        path = Path(used[0])
        assert path.parent.is_dir()
        assert path.parent != Path.home()
    assert not path.parent.exists()
    ux.save_settings()
    assert used[-1] == ""  # Studio's own function again


def test_a_wish_from_the_panel_is_applied_paused_or_not(humanoid: _Studio) -> None:
    humanoid.send(studio._WishEvent(lambda session: session.pause()))
    assert humanoid.session.paused
    humanoid.send(studio._WishEvent(lambda session: session.begin(9)))
    assert humanoid.received(studio._StatusEvent)[-1].status.seed == 9
    np.testing.assert_array_equal(humanoid.session.data.qpos, humanoid.handle.data.qpos)


def test_a_wish_that_cannot_be_granted_ends_nothing(
    humanoid: _Studio, caplog: pytest.LogCaptureFixture
) -> None:
    humanoid.send(studio._WishEvent(lambda session: session.choose("nobody")))
    assert "no policy is 'nobody'" in caplog.text
    humanoid.step()
    assert humanoid.session.status().step == 1
