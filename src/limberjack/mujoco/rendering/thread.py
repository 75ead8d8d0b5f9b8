"""The rendering threads, the only threads of the process that call OpenGL.

    picture = call(model, draw, scene, size=(240, 320))    # runs draw(mjr_context, scene) there
    pending = prepare(model, draw, scene, size=(240, 320), thread=1)
    pending.start()
    picture = pending.result()

The first one starts with the first picture, and draws all but the rows of a batch, which two may
draw at once. Any thread may call; the calls of a rendering thread run one after the other, so an
OpenGL context that is current in the caller's thread stays current. Each rendering thread has its
own canvases and its own backend. `backends.py` opens OpenGL, `canvases.py` manages the resources
of models, and `pictures.py` draws pictures.
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
from typing import Generic, TypeVar

import mujoco

from limberjack.mujoco import exit_guard
from limberjack.mujoco.rendering.backends import Backend, RenderingError
from limberjack.mujoco.rendering.canvases import Canvases
from limberjack.utils.cores import usable_cores

__all__ = ["Pending", "backend", "call", "num_threads", "prepare", "use_device"]

# Seconds that the first picture after a fork may take before OpenGL is considered hung.
_FORK_PATIENCE = 30.0
# Seconds; a picture takes far less.
_LONGEST_JOB = 10.0


_T = TypeVar("_T")


class _Job(Generic[_T]):
    """A call to run on the rendering thread."""

    def __init__(self, function: Callable[..., _T], *args: object) -> None:
        self._call: tuple[Callable[..., _T], tuple[object, ...]] | None = (function, args)
        self._values: list[_T] = []  # empty, or the result
        self._error: BaseException | None = None
        self._is_done = False
        # Acquired once, either to run the job or to cancel it.
        self._claim = threading.Lock()
        self._under_way = threading.Lock()
        self._under_way.acquire()

    def run(self) -> None:
        """Makes the call and stores its outcome, unless the job was cancelled."""
        if not self._claim.acquire(blocking=False):
            return
        assert self._call is not None
        function, args = self._call
        try:
            self._values.append(function(*args))
        except BaseException as error:
            self._error = error
        finally:
            self._call = None
            self._is_done = True
            self._under_way.release()

    def wait(self, timeout: float = -1) -> bool:
        """Waits for the call; returns whether it has ended. Ctrl-C interrupts only the wait."""
        # The flag is needed because Ctrl-C between the next two lines leaves the lock acquired.
        if not self._is_done and self._under_way.acquire(timeout=timeout):
            self._under_way.release()
        return self._is_done

    def settle(self) -> None:
        """Cancels the job or waits until it has ended; Ctrl-C does not interrupt this."""
        end = time.monotonic() + _LONGEST_JOB
        is_cancelled = self._claim.acquire(blocking=False)
        while not (is_cancelled or self._is_done) and time.monotonic() < end:
            with contextlib.suppress(KeyboardInterrupt):
                self.wait(_LONGEST_JOB)

    def result(self) -> _T:
        """The call's result; raises its exception."""
        error, self._error = self._error, None
        try:
            if error is not None:
                raise error
            return self._values.pop()
        finally:
            error = None  # otherwise the traceback would keep itself alive


class _RenderingThread(threading.Thread):
    """Runs jobs one after the other until it receives None."""

    def __init__(self, canvases: Canvases) -> None:
        # A daemon, because Python joins all other threads before it runs exit handlers.
        super().__init__(name="limberjack-rendering", daemon=True)
        self.jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self.busy = threading.RLock()
        self.canvases = canvases
        self.is_hung = False  # it did not end a call after a fork

    def run(self) -> None:
        while (job := self.jobs.get()) is not None:
            with self.busy:
                job()
            del job  # otherwise the last picture would stay alive during the wait

    def do(self, job: Callable[[], None]) -> None:
        """Queues the job; runs it immediately if called on this thread."""
        if threading.current_thread() is self:
            job()
        else:
            self.jobs.put(job)

    def do_call(self, function: Callable[..., object], *args: object) -> None:
        """Queues a call without waiting for it; safe in destructors."""
        self.do(_Job(function, *args).run)


class Pending(Generic[_T]):
    """A call of a drawing function that a rendering thread is to make.

    Args:
      job: the call.
      thread: the rendering thread.
      patience: seconds after which it is considered hung; -1 for never.
    """

    def __init__(self, job: _Job[_T], thread: _RenderingThread, patience: float) -> None:
        self._job, self._thread, self._patience = job, thread, patience
        self._is_started = False

    def start(self) -> None:
        """Queues the call, unless it has been queued."""
        if not self._is_started:
            self._is_started = True
            self._thread.do(self._job.run)

    def result(self) -> _T:
        """The call's result, as soon as there is one; raises its exception."""
        try:
            self.start()
            if not self._job.wait(self._patience):
                self._thread.is_hung = True
                raise RenderingError(_HUNG)
        except BaseException:
            self.settle()
            raise
        return self._job.result()

    def settle(self) -> None:
        """Cancels the call or waits until it has ended; Ctrl-C does not interrupt this."""
        if not self._thread.is_hung:
            self._job.settle()


class _Process:
    """The rendering threads of this process, managed across forks and at exit."""

    def __init__(self) -> None:
        self._threads: list[_RenderingThread] = []
        self._start = threading.Lock()
        self._first_pid = os.getpid()
        self._is_watched = False
        self._is_exiting = False
        self._device: int | None = None
        # The backend of the process from which this one was forked.
        self._inherited: Backend | None = None
        # Of the second thread; None if there is none, or if it was not asked for.
        self._second: Backend | None = None
        self._is_second_sought = False
        self._at_fork = threading.local()

    def prepared(
        self,
        number: int,
        model: mujoco.MjModel,
        size: tuple[int, int],
        may_have_changed: bool,
        is_private: bool,
        function: Callable[..., _T],
        args: tuple[object, ...],
    ) -> Pending[_T]:
        """A drawing function to run on a rendering thread, which is started if necessary."""
        threads = self._threads
        thread = threads[number] if number < len(threads) else self._started_thread(number)
        if thread.is_hung:
            raise RenderingError(_HUNG)
        may_hang = self._is_forked() and thread.canvases.backend is None
        when_gone = thread.do_call if is_private else None
        what = model, size, may_have_changed, when_gone, function, args
        job: _Job[_T] = _Job(thread.canvases.draw, *what)
        return Pending(job, thread, _FORK_PATIENCE if may_hang else -1)

    def backend(self) -> Backend | None:
        """The backend in use; None before the first picture."""
        threads = self._threads
        return threads[0].canvases.backend if threads else None

    def num_threads(self) -> int:
        """The number of threads that draw at the same time; 1 before the first picture."""
        if self.backend() is None:
            return 1
        if not self._is_second_sought:
            job: _Job[Backend | None] = _Job(self._threads[0].canvases.another_backend)
            self._second = Pending(job, self._threads[0], -1).result()
            self._is_second_sought = True
        return 1 if self._second is None else 2

    def use_device(self, number: int | None) -> None:
        """Selects the device, before the first picture."""
        with self._start:
            if (opened := self.backend()) is not None:
                raise RuntimeError(
                    f"this process already renders with {opened.renderer!r}: select the device "
                    "before the first picture"
                )
            self._device = number
            for thread in self._threads:
                thread.canvases.device = number

    def _started_thread(self, number: int) -> _RenderingThread:
        if self._is_exiting:
            if threading.current_thread().daemon:
                exit_guard.wait_forever()  # an error would be printed
            raise RenderingError("the interpreter is exiting: nothing can be rendered any more")
        with self._start:
            while len(self._threads) <= number:
                self._watch()
                canvases = Canvases(self._is_forked(), self._inherited, self._device)
                canvases.backend = self._second if self._threads else None
                thread = _RenderingThread(canvases)
                thread.start()
                self._threads.append(thread)
            return self._threads[number]

    def _watch(self) -> None:
        """Registers handlers for forks and for the exit of the process."""
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
        """Frees OpenGL's resources and ends the threads, which would crash the exit inside C."""
        self._is_exiting = True
        threads, self._threads = self._threads, []
        for thread in threads:
            thread.do_call(thread.canvases.close)
            thread.jobs.put(None)
        for thread in threads:
            thread.join(0 if thread.is_hung else _LONGEST_JOB)

    def _before_fork(self) -> None:
        """Waits for the pictures in progress, which the child could not finish."""
        self._at_fork.busy = [thread.busy for thread in self._threads]
        for busy in self._at_fork.busy:
            busy.acquire(timeout=_LONGEST_JOB)

    def _after_fork(self) -> None:
        for busy in self._at_fork.busy:
            # Not acquired, because of Ctrl-C or because a picture takes too long.
            with contextlib.suppress(RuntimeError):
                busy.release()

    def _after_fork_in_child(self) -> None:
        # No other thread exists in the child, whatever locks it held.
        self._start = threading.Lock()
        self._inherited = self.backend() or self._inherited
        self._second, self._is_second_sought = None, False
        threads, self._threads = self._threads, []
        for thread in threads:
            # Never freed: freeing would act on whatever OpenGL context is current here.
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(thread))
        if threads:
            _leave_out_exit_handlers()

    def _is_forked(self) -> bool:
        return os.getpid() != self._first_pid


def _leave_out_exit_handlers() -> None:
    """Makes this process skip the libraries' exit handlers, after Python's own cleanup.

    Mesa's handler would wait for the threads of the parent process, forever if other threads now
    occupy their memory.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "on_exit"):  # GNU; handlers run in reverse order, with the exit status
        libc.on_exit(libc._exit, None)
        libc.on_exit(libc.fcloseall, None)


_HUNG = (
    f"OpenGL produced no picture within {_FORK_PATIENCE:.0f} s in this process, which was forked "
    "from one that may have used it. Start processes with multiprocessing's 'spawn' or 'forkserver'"
)

_process = _Process()


def prepare(
    model: mujoco.MjModel,
    function: Callable[..., _T],
    *args: object,
    size: tuple[int, int] = (0, 0),
    may_have_changed: bool = True,
    is_private: bool = False,
    thread: int = 0,
) -> Pending[_T]:
    """The call `function(mjr_context, *args)`, to be made on a rendering thread.

    Until it has ended, or `settle` has, nothing that it uses may be changed.

    Args:
      model: the official `mujoco.MjModel` to draw.
      function: called with the context current and its off-screen buffer selected.
      args: its further arguments.
      size: minimum height and width of the buffer, pixels; the model must allow them.
      may_have_changed: whether to look for changes of the model's height fields, textures and
        meshes since it was last drawn; this takes up to a millisecond.
      is_private: whether to give the model its own context; for functions that change it.
      thread: number of the rendering thread, below `num_threads()`.

    Raises:
      RenderingError: OpenGL is not available.
    """
    return _process.prepared(thread, model, size, may_have_changed, is_private, function, args)


def call(
    model: mujoco.MjModel,
    function: Callable[..., _T],
    *args: object,
    size: tuple[int, int] = (0, 0),
    may_have_changed: bool = True,
    is_private: bool = False,
) -> _T:
    """The result of `function(mjr_context, *args)`, called on the first rendering thread.

    If Ctrl-C interrupts the call, the function has finished or was never started. Arguments and
    errors are those of `prepare`.
    """
    how = size, may_have_changed, is_private
    return _process.prepared(0, model, *how, function, args).result()


def num_threads() -> int:
    """The number of rendering threads that draw several pictures faster than one does.

    That is 2 if Mesa's software renderer draws through EGL on two cores or more, after the first
    picture; otherwise 1. Mesa's own limit of its threads, LP_NUM_THREADS, is a limit here too.
    """
    is_limited = os.environ.get("LP_NUM_THREADS") in ("0", "1")
    return 1 if is_limited or usable_cores() < 2 else _process.num_threads()


def backend() -> Backend | None:
    """The backend of this process; None before its first picture."""
    return _process.backend()


def use_device(number: int | None) -> None:
    """Selects the GPU on which this process renders; must precede the first picture.

    Forked processes inherit the choice, others do not. If there is no such device, the first
    picture raises `RenderingError`.

    Args:
      number: number of the EGL device, in the driver's order, as listed by `limberjack doctor`; it
        overrides MUJOCO_EGL_DEVICE_ID. None for that variable's device, or the first that works.

    Raises:
      TypeError, ValueError: the number is not a non-negative integer.
      RuntimeError: this process has already rendered.
    """
    if number is not None:
        number = operator.index(number)
        if number < 0:
            raise ValueError(f"the device is {number}; expected a number from 0, or None")
    _process.use_device(number)
