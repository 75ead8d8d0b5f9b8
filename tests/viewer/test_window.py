"""The native window: its keys, its text, and a real one, on a display without a screen."""

import dataclasses
import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.viewer import window
from limberjack.viewer.session import Plan, Session, Status


@pytest.fixture
def session() -> Session:
    environment = suite.load("manipulator", "bring_ball", task_kwargs={"random": 0})
    return Session(environment, seed=0)


def test_its_keys_pause_step_and_reset(session: Session) -> None:
    window._do(session, window._SPACE)
    assert session.paused
    window._do(session, window._SPACE)
    assert not session.paused
    window._do(session, window._RIGHT)
    assert session.paused
    assert session.status().step == 1
    window._do(session, window._BACKSPACE)
    assert (session.status().episode, session.status().step) == (2, 0)
    window._do(session, ord("Q"))
    assert (session.status().episode, session.status().step) == (2, 0)


def _shown(status: Status) -> dict[str, str]:
    _, _, names, values = window._text(status)
    return dict(zip(names.split("\n"), values.split("\n"), strict=True))


def test_its_text_has_the_reward_and_its_terms(session: Session) -> None:
    assert _shown(session.status())["reward"] == "-"
    session.step()
    status = session.status()
    shown = _shown(status)
    assert shown["reward"] == f"{status.reward:.3f}"
    assert {name: shown[name] for name in status.terms} == {
        name: f"{value:.3f}" for name, value in status.terms.items()
    }


def test_its_text_has_the_stage_and_the_terms_of_a_plan(session: Session) -> None:
    plan = Plan("grasp", {"reach": 0.25, "reward": 1.0})
    shown = _shown(dataclasses.replace(session.status(), plan=plan))
    assert (
        shown.items() >= {"plan": "grasp", "cost: reach": "0.250", "cost: reward": "1.000"}.items()
    )


def test_an_episode_s_changes_of_the_model_are_copied_to_the_window_s(session: Session) -> None:
    model = session.shown.copy_model()
    session.reset()
    assert not np.array_equal(model.body_pos, session.model.body_pos)
    session.shown.copy_fields(model)
    for name in ("body_pos", "body_quat", "geom_rgba"):
        np.testing.assert_array_equal(getattr(model, name), getattr(session.model, name))
    model.body_pos[:] = 7.0
    assert not (session.model.body_pos == 7.0).all()
    size = mujoco.mj_sizeModel(model)
    assert size == mujoco.mj_sizeModel(session.model)


@pytest.fixture
def display() -> Iterator[str]:
    """A display without a screen."""
    if shutil.which("Xvfb") is None:
        pytest.skip("there is no Xvfb here to open a window on")
    receive, send = os.pipe()
    arguments = ["Xvfb", "-displayfd", str(send), "-screen", "0", "640x480x24"]
    with subprocess.Popen(arguments, pass_fds=(send,), stderr=subprocess.DEVNULL) as server:
        os.close(send)
        with os.fdopen(receive) as number:
            name = number.readline().strip()
        yield f":{name}"
        server.terminate()


def test_it_opens_and_ends_with_ctrl_c(display: str, tmp_path: Path) -> None:
    program = """
        import numpy as np
        from limberjack import suite, viewer

        class Policy:
            steps = 0

            def __call__(self, time_step):
                self.steps += 1
                if self.steps == 10:
                    raise KeyboardInterrupt
                return np.zeros(21)

        policy = Policy()
        viewer.launch(lambda: suite.load("humanoid", "stand"), policy, native=True)
        print(policy.steps)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        env={**os.environ, "DISPLAY": display, "HOME": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (0, "10\n"), done.stderr
