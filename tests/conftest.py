"""The renderer that all tests use: off-screen, chosen before anything imports OpenGL."""

import ctypes.util
import os
import sys

# dm_control reads this when it is imported, and fails where its first choice, a window, cannot be
# opened. Without EGL it still simulates, and the tests that draw skip.
if sys.platform == "linux" and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if ctypes.util.find_library("EGL") else "disable"
