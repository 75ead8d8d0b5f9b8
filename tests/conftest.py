"""What all tests use: an off-screen renderer, chosen before anything imports OpenGL, and Ctrl-C."""

import ctypes.util
import os
import signal
import sys

# dm_control reads this when it is imported, and fails where its first choice, a window, cannot be
# opened. Without EGL it still simulates, and the tests that draw skip.
if sys.platform == "linux" and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "disable"

# A shell that runs the tests in the background lets them, and what they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
