"""A `Session` in a window of MuJoCo's own viewer: on this machine's display.

    run(session)

It is MuJoCo's classic viewer: the window of MuJoCo Studio 4.0.0 does not open on Linux.
Space pauses, backspace begins the next episode, the right arrow takes a step; the mouse pushes.

The only file that imports mujoco.viewer.
"""

import contextlib
import os
import queue
import sys
import threading
import time
from collections.abc import Iterator

import mujoco

from limberjack.viewer.session import Session, Status, ViewerError

__all__ = ["run"]

_FRAME = 1 / 60  # seconds from one picture to the next, at least
_CLOSE_LIMIT = 5.0  # seconds that the window may take to close
_SPACE, _BACKSPACE, _RIGHT = 32, 259, 262  # GLFW's numbers of keys


def run(session: Session) -> None:
    """Shows a session until its window is closed.

    Raises:
      ViewerError: there is no display, or no window opens on it.
      KeyboardInterrupt: Ctrl-C was pressed; the window is closed.
      Exception: what the policy, the task or the environment raised.
    """
    _check_display()
    from mujoco import viewer  # it looks for a window system when it is imported

    model = session.shown.copy_model()
    data = mujoco.MjData(model)
    keys: queue.SimpleQueue[int] = queue.SimpleQueue()
    session.shown.copy_state(model, data)
    earlier = set(threading.enumerate())
    try:
        window = viewer.launch_passive(
            model, data, key_callback=keys.put, show_left_ui=False, show_right_ui=False
        )
    except RuntimeError as error:  # on macOS, where it wants the interpreter mjpython
        raise ViewerError(f"there can be no window: {error}") from error
    with _joined(set(threading.enumerate()) - earlier), window:
        while window.is_running():
            begun = time.perf_counter()
            while not keys.empty():
                _do(session, keys.get())
            session.advance()
            with window.lock():
                changed = session.shown.copy_fields(model)
                session.shown.copy_state(model, data)
                mujoco.mj_forward(model, data)
                mujoco.mjv_applyPerturbForce(model, data, window.perturb)
                session.push(data.xfrc_applied)
            for texture in range(model.ntex) if "tex_data" in changed else ():
                window.update_texture(texture)
            window.set_texts(_text(session.status()))
            window.sync()
            time.sleep(max(0.0, begun + _FRAME - time.perf_counter()))


@contextlib.contextmanager
def _joined(threads: set[threading.Thread]) -> Iterator[None]:
    """Waits at the end for the threads that draw: a program must not exit while they run."""
    try:
        yield
    finally:
        for thread in threads:
            thread.join(_CLOSE_LIMIT)


def _check_display() -> None:
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys():
        raise ViewerError(
            "there is no display for a window: neither DISPLAY nor WAYLAND_DISPLAY is set; the web "
            "viewer needs none"
        )


def _do(session: Session, key: int) -> None:
    if key == _SPACE:
        session.pause(not session.paused)
    elif key == _BACKSPACE:
        session.reset()
    elif key == _RIGHT:
        session.pause()
        session.step()


def _text(status: Status) -> tuple[None, mujoco.mjtGridPos, str, str]:
    """The reward and its terms, as the viewer takes them: font, position, two columns."""
    rows = {"episode": f"{status.episode}", "step": f"{status.step}"}
    if status.seed is not None:
        rows["seed"] = f"{status.seed}"
    rows["time"] = f"{status.time:.2f} s" + (" paused" if status.paused else "")
    rows["return"] = f"{status.total:.2f}"
    rows["reward"] = "-" if status.reward is None else f"{status.reward:.3f}"
    rows.update({name: f"{value:.3f}" for name, value in status.terms.items()})
    if status.plan is not None:
        rows["plan"] = status.plan.stage or "-"
        rows.update({f"cost: {name}": f"{value:.3f}" for name, value in status.plan.terms.items()})
    if status.note:
        rows["note"] = status.note
    return None, mujoco.mjtGridPos.mjGRID_TOPLEFT, "\n".join(rows), "\n".join(rows.values())
