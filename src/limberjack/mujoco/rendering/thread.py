"""The rendering thread: the only place of the process that touches OpenGL.

    picture = call(model, draw, scene, size=(240, 320))    # draw(mjr_context, scene), over there

It starts with the first picture. Any thread may call; calls are made one after the other in a
thread of their own, so that the OpenGL context that is current in the caller's stays so. How OpenGL
is reached is in `backends.py`, what it keeps for a model in `canvases.py`, what a picture is in
`pictures.py`.
"""

import atexit
import contextlib
import ctypes
import operator
import os
import queue
import threading
import time
from collections.abc import Callable
from typing import Any, Generic, TypeVar, cast

import mujoco

from limberjack.mujoco.rendering.backends import Backend, RenderingError
from limberjack.mujoco.rendering.canvases import Canvases

__all__ = ["backend", "call", "use_device"]

# Seconds; how long the first picture after a fork may take before OpenGL is taken to hang.
_FORK_PATIENCE = 30.0
# Seconds; a picture takes far less.
_LONGEST_JOB = 10.0


_T = TypeVar("_T")


class _Job(Generic[_T]):
    """A call for the rendering thread to make."""

    def __init__(self, function: Callable[..., _T], *args: object) -> None:
        self._call: tuple[Callable[..., _T], tuple[object, ...]] | None = (function, args)
        self._value: _T | None = None
        self._error: BaseException | None = None
        self._is_done = False
        # Whoever acquires it runs the job, or cancels it.
        self._claim = threading.Lock()
        self._under_way = threading.Lock()
        self._under_way.acquire()

    def run(self) -> None:
        """Makes the call and keeps what comes of it, unless it was cancelled."""
        if not self._claim.acquire(blocking=False):
            return
        assert self._call is not None
        function, args = self._call
        try:
            self._value = function(*args)
        except BaseException as error:
            self._error = error
        finally:
            self._call = None
            self._is_done = True
            self._under_way.release()

    def wait(self, timeout: float = -1) -> bool:
        """Whether the call has ended, after waiting for it; Ctrl-C interrupts the wait only."""
        # The flag, because Ctrl-C can come between the next two lines and leave the lock acquired.
        if not self._is_done and self._under_way.acquire(timeout=timeout):
            self._under_way.release()
        return self._is_done

    def settle(self) -> None:
        """Sees to it that nothing is under way any more; Ctrl-C does not interrupt this."""
        end = time.monotonic() + _LONGEST_JOB
        is_cancelled = self._claim.acquire(blocking=False)
        while not (is_cancelled or self._is_done) and time.monotonic() < end:
            with contextlib.suppress(KeyboardInterrupt):
                self.wait(_LONGEST_JOB)

    def result(self) -> _T:
        """What the call returned or raised."""
        error, self._error = self._error, None
        try:
            if error is not None:
                raise error
            return cast(_T, self._value)
        finally:
            self._value = error = None  # Else the traceback would keep itself alive.


class _RenderingThread(threading.Thread):
    """Does jobs, one after the other, until it is given None."""

    def __init__(self, canvases: Canvases) -> None:
        # A daemon, because Python waits for all others before it tells anybody that it exits.
        super().__init__(name="limberjack-rendering", daemon=True)
        self.jobs: queue.SimpleQueue[_Job[Any] | None] = queue.SimpleQueue()
        self.busy = threading.RLock()
        self.canvases = canvases

    def run(self) -> None:
        while (job := self.jobs.get()) is not None:
            with self.busy:
                job.run()
            del job  # Else the last picture would be kept alive while this waits.

    def do(self, job: _Job[Any]) -> None:
        """Has the job run here, later; at once if this is the present thread."""
        if threading.current_thread() is self:
            job.run()
        else:
            self.jobs.put(job)

    def do_call(self, function: Callable[..., object], *args: object) -> None:
        """Has a call made here, and does not wait; to be used by destructors, too."""
        self.do(_Job(function, *args))


class _Process:
    """The rendering thread of this process, through forks and until the end."""

    def __init__(self) -> None:
        self._thread: _RenderingThread | None = None
        self._start = threading.Lock()
        self._first_pid = os.getpid()
        self._is_watched = False
        self._is_exiting = False
        self._hung: _RenderingThread | None = None
        self._device: int | None = None
        # What the process that this one was forked from had drawn with.
        self._inherited: Backend | None = None
        self._at_fork = threading.local()

    def call(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        may_have_changed: bool,
        is_private: bool,
        function: Callable[..., _T],
        args: tuple[object, ...],
    ) -> _T:
        """Draws on the thread, which is started if need be."""
        thread = self._thread or self._started_thread()
        if thread is self._hung:
            raise RenderingError(_HUNG)
        may_hang = self._is_forked() and thread.canvases.backend is None
        when_gone = thread.do_call if is_private else None
        what = model, size, may_have_changed, when_gone, function, args
        job: _Job[_T] = _Job(thread.canvases.draw, *what)
        try:
            thread.do(job)
            if not job.wait(_FORK_PATIENCE if may_hang else -1):
                self._hung = thread
                raise RenderingError(_HUNG)
        except BaseException:
            if thread is not self._hung:
                job.settle()
            raise
        return job.result()

    def backend(self) -> Backend | None:
        """What is drawn with; None before the first picture."""
        thread = self._thread
        return None if thread is None else thread.canvases.backend

    def use_device(self, number: int | None) -> None:
        """Chooses the device of the first picture."""
        with self._start:
            if (opened := self.backend()) is not None:
                raise RuntimeError(
                    f"this process draws with {opened.renderer!r} already: choose the device "
                    "before the first picture"
                )
            self._device = number
            if self._thread is not None:
                self._thread.canvases.device = number

    def _started_thread(self) -> _RenderingThread:
        if self._is_exiting:
            if threading.current_thread().daemon:
                threading.Event().wait()  # It ends with the process; an error would be printed.
            raise RenderingError("the interpreter is exiting: nothing is drawn any more")
        with self._start:
            if self._thread is None:
                self._watch()
                canvases = Canvases(self._is_forked(), self._inherited, self._device)
                thread = _RenderingThread(canvases)
                thread.start()
                self._thread = thread
            return self._thread

    def _watch(self) -> None:
        """Has this object told of the process's forks and of its end."""
        if self._is_watched:
            return
        self._is_watched = True
        if self._is_forked():
            _leave_out_exit_handlers()
        atexit.register(self._exit)
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(
                before=self._before_fork,
                after_in_parent=self._after_fork,
                after_in_child=self._after_fork_in_child,
            )

    def _exit(self) -> None:
        """Frees what OpenGL holds and ends the thread: one inside a C call would crash the exit."""
        self._is_exiting = True
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.do_call(thread.canvases.close)
            thread.jobs.put(None)
            thread.join(0 if thread is self._hung else _LONGEST_JOB)

    def _before_fork(self) -> None:
        """Lets the picture under way be finished: the child could not finish it."""
        self._at_fork.busy = None
        if self._thread is not None:
            self._at_fork.busy = self._thread.busy
            self._at_fork.busy.acquire(timeout=_LONGEST_JOB)

    def _after_fork(self) -> None:
        if self._at_fork.busy is not None:
            # It was not acquired, after Ctrl-C or because a picture takes too long.
            with contextlib.suppress(RuntimeError):
                self._at_fork.busy.release()

    def _after_fork_in_child(self) -> None:
        # No other thread lives on here, whatever locks it held.
        self._start = threading.Lock()
        thread, self._thread = self._thread, None
        if thread is not None:
            # Kept for ever: nothing may be freed in whatever OpenGL context is current here.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(thread))
            self._inherited = thread.canvases.backend or self._inherited
            _leave_out_exit_handlers()

    def _is_forked(self) -> bool:
        return os.getpid() != self._first_pid


def _leave_out_exit_handlers() -> None:
    """Ends this process without what libraries do last; in C, after all that Python does.

    Mesa would wait there for the threads of the process that this one was forked from, and for ever
    if other threads have taken their places in memory.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "on_exit"):  # GNU's. Called last first, with the status.
        libc.on_exit(libc._exit, None)
        libc.on_exit(libc.fcloseall, None)


_HUNG = (
    f"OpenGL gave no picture within {_FORK_PATIENCE:.0f} s in this process, which was forked from "
    "one that may have used it. Start processes with multiprocessing's 'spawn' or 'forkserver'"
)

_process = _Process()


def call(
    model: mujoco.MjModel,
    function: Callable[..., _T],
    *args: object,
    size: tuple[int, int] = (0, 0),
    may_have_changed: bool = True,
    is_private: bool = False,
) -> _T:
    """What `function(mjr_context, *args)` returns, called on the rendering thread.

    After Ctrl-C nothing of it is under way any more.

    Args:
      model: the official `mujoco.MjModel` that the context is for.
      function: called with OpenGL ready and the context's off-screen buffer selected.
      args: its further arguments.
      size: height and width, pixels, that the buffer must have at least; the model must allow it.
      may_have_changed: whether to look for changes of the model's height fields, textures and
        meshes since it was last drawn; that takes up to a millisecond.
      is_private: no other model may share the context. For what changes it.

    Raises:
      RenderingError: OpenGL cannot be had.
    """
    return _process.call(model, size, may_have_changed, is_private, function, args)


def backend() -> Backend | None:
    """What this process draws with; None before its first picture."""
    return _process.backend()


def use_device(number: int | None) -> None:
    """Has this process draw with a graphics card of several, before it draws anything.

    Forked processes inherit the choice; others make their own. Whether there is such a device
    turns out with the first picture, which raises `RenderingError` if not.

    Args:
      number: of EGL's device, in the driver's order, as `limberjack doctor` lists them; it comes
        before MUJOCO_EGL_DEVICE_ID. None for what that says, or the first device that works.

    Raises:
      TypeError, ValueError: that is no number of a device.
      RuntimeError: this process has drawn already.
    """
    if number is not None:
        number = operator.index(number)
        if number < 0:
            raise ValueError(f"the device is {number}; expected a number from 0, or None")
    _process.use_device(number)
