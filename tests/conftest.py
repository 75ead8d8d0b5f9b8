"""What all tests use: an off-screen renderer, chosen before anything imports OpenGL, and Ctrl-C.

And fixtures of more than one folder.
"""

import ctypes.util
import os
import signal
import sys

import pytest

# dm_control reads this when it is imported, and fails where its first choice, a window, cannot be
# opened. Without EGL it still simulates, and the tests that draw skip.
if sys.platform == "linux" and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "disable"

# A shell that runs the tests in the background lets them, and what they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(params=["own", "shared"])
def share(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets each row have an `MjData` of its own, as in a small batch, or not, as in a large one."""
    from limberjack.mujoco import lazy_batch  # after the renderer is chosen

    monkeypatch.setattr(lazy_batch, "_A_FEW", {"own": 1_000, "shared": 0}[request.param])
