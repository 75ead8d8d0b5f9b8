"""Limberjack: the DeepMind Control Suite on MuJoCo 4.0.

    from limberjack import suite

    env = suite.load("humanoid", "walk", task_kwargs={"random": 0})
    time_step = env.reset()
    while not time_step.last():
        time_step = env.step(env.action_spec().generate_value())

The same seed and actions give dm_control's numbers, bit for bit. Programs written for dm_control
run unchanged after `limberjack.install_as_dm_control()`. In a notebook, `limberjack.show(frames)`
displays pictures and films. Importing this package registers Gymnasium ids such as
`limberjack/humanoid-walk-v0` but does not import MuJoCo: import `limberjack.suite`,
`limberjack.mujoco` and `limberjack.rl` explicitly.
"""

import os
import signal
import sys
from types import FrameType

__all__ = ["__version__", "install_as_dm_control", "show"]

__version__ = "0.2.0"

_INTERRUPTED = 130  # exit status, as shells report what Ctrl-C ended


def _importer() -> FrameType | None:
    """The frame of the program or module that imports this package first."""
    frame = sys._getframe(1)
    while frame is not None:
        module = str(frame.f_globals.get("__name__"))
        if module != __name__ and "importlib" not in module:
            return frame
        frame = frame.f_back
    return None


def _is_command() -> bool:
    """Whether the importing program is the command `limberjack`, or `python -m limberjack`."""
    importer = _importer()
    if importer is None:
        return False
    module = importer.f_globals.get("__name__")
    if module == "runpy":
        options = sys.orig_argv[: len(sys.orig_argv) - len(sys.argv) + 1]  # before the arguments
        return "".join(options).endswith(f"-m{__name__}")
    script, _ = os.path.splitext(os.path.basename(sys.argv[0] if sys.argv else ""))
    is_script = script.removesuffix("-script") == __name__
    return is_script and module == "__main__" and f"{__name__}.cli" in importer.f_code.co_names


# The command's imports take a second, and Ctrl-C would show their traceback. `cli.process` handles
# it later. A program that imports the package handles it as it likes.
if _is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, lambda *_: os._exit(_INTERRUPTED))


def install_as_dm_control() -> None:
    """Makes `import dm_control`, and its submodules, resolve to Limberjack's modules.

    Call this before anything imports dm_control, at the top of the program:

        import limberjack
        limberjack.install_as_dm_control()
        from dm_control import suite  # limberjack.suite

    Each module is one object under both names, whichever is imported first, and keeps its own
    `__name__`, so pickles made here can be read without this call. An installed dm_control is
    never imported. The parts that Limberjack does not implement (composer, locomotion,
    manipulation, mjcf, ...) can be imported and used in annotations; any other use raises
    NotImplementedError. Unknown names raise ModuleNotFoundError.

    Further calls, from any thread, have no effect. The alias applies to this process and to
    processes forked from it; a spawned process (`multiprocessing` with "spawn" or "forkserver")
    must call this function itself.

    Raises:
      RuntimeError: the real dm_control is already imported; nothing was changed.
    """
    from limberjack import _compat

    _compat.install()


def show(frames: object, fps: float = 30.0) -> object:
    """A picture or film displayed inline in a notebook; see `limberjack.see.notebook.show`.

    limberjack.show(env.physics.render())
    limberjack.show(list_of_pictures, fps=40)
    """
    from limberjack.see import notebook

    return notebook.show(frames, fps)


def _is_imported_by_hook() -> bool:
    """Whether a .pth file is importing this package while Python starts."""
    importer = _importer()
    return importer is not None and importer.f_globals.get("__name__") == "site"


if not _is_imported_by_hook():  # see `_gymnasium_plugin`
    from limberjack import gym as gym
