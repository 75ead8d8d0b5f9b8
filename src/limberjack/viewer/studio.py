"""A `Session` in MuJoCo Studio's web viewer.

    run(session, Access(find_address()), "humanoid walk", announce=print)

Studio draws, and sends its user's input; `_Loop` applies it to the session, and sends the session's
state back. Studio's edits of a simulation of its own (joints, controls, options, keyframes, other
models, uploads) are refused, so that the environment stays unchanged. The server answers only
requests that `Access` permits.

The only file that imports mujoco.studio.
"""

import concurrent.futures
import contextlib
import dataclasses
import functools
import logging
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco

from limberjack.utils.log import log
from limberjack.viewer.access import Access
from limberjack.viewer.guard import Guard
from limberjack.viewer.panel import Panel, Weigh, Wish, Worded
from limberjack.viewer.session import Session, Status, ViewerError

try:
    from mujoco.studio import (
        app,
        launch_thread,
        messages,
        plugin,
        sim,  # pyright: ignore[reportAttributeAccessIssue] (compiled)
        sim_history,
        ux,  # pyright: ignore[reportAttributeAccessIssue] (compiled)
        viewer_protocol,
        web_viewer,
    )
    from mujoco.studio.dear_imgui import dear_imgui as imgui
    from mujoco.studio.implot import implot
    from mujoco.studio.web import web_server
except ImportError as error:
    raise ImportError(f"needs MuJoCo Studio, which cannot be imported: {error}") from error

__all__ = ["run"]

_OfStudio = Any  # an object of MuJoCo Studio, which is not typed

_ADDITION = Path(__file__).with_name("addition.html")  # to Studio's page
_BY_SOFTWARE = "/drawn-by-software"  # what it requests where no GPU draws
_BREATH = 0.002  # seconds between two readings of the clock; other threads draw meanwhile
_START_LIMIT = 60.0  # seconds that Studio may take to start
_GUARD_LIMIT = 30.0  # seconds that its server may take to listen; it takes milliseconds
# Functions of Studio that read or write a file of its user.
_SETTINGS = ("load_settings", "load_theme", "reset_config", "save_settings")


def run(
    session: Session,
    access: Access,
    title: str = "limberjack",
    announce: Callable[[str], object] | None = None,
    weigh: Weigh | None = None,
    command: Worded | None = None,
) -> None:
    """Shows a session in browsers until Quit is chosen in one.

    Args:
      session: begun; it is stepped in this thread.
      access: where to listen, and what to answer.
      title: of the panel.
      announce: called with the address and its token, once a browser can open it.
      weigh: changes a weight of the planner's cost, where plans are shown.
      command: returns the command line of a status.

    Raises:
      ViewerError: Studio does not start, or the port is in use.
      KeyboardInterrupt: Ctrl-C was pressed; everything is closed.
      Exception: what the policy, the task or the environment raised.
    """
    panel = _Panel(session, title, weigh, command)
    with _listening(access) as sock, _private_settings(ux):
        shown = app.App(app.Config(show_options=False, show_inspector=False))
        plugins = [shown, panel, _Loop(session), sim_history.SimHistory()]
        reports = {_BY_SOFTWARE: panel.is_drawn_by_software.set}
        with _launch(access, sock, title, plugins, reports) as handle:
            _wait_until(panel.is_ready.is_set, handle)
            if announce is not None:
                announce(access.url)
            _set_model(handle, session)
            while handle.is_running():
                handle.sync()


@contextlib.contextmanager
def _listening(access: Access) -> Iterator[socket.socket]:
    """A socket for the server; `access` then has its port."""
    try:
        made = access.address.listen()
    except OSError as error:
        raise ViewerError(f"port {access.address.port} cannot be used: {error}") from error
    with made:
        access.address = dataclasses.replace(access.address, port=made.getsockname()[1])
        yield made


def _wait_until(is_ready: Callable[[], bool], handle: _OfStudio) -> None:
    """Waits for a part of Studio's start."""
    end = time.monotonic() + _START_LIMIT
    while not is_ready():
        try:
            runs = handle.is_running()
        except RuntimeError as error:
            raise ViewerError(f"MuJoCo Studio did not start: {error}") from error
        if not runs:
            raise ViewerError("MuJoCo Studio closed while it started")
        if time.monotonic() > end:
            raise ViewerError(f"MuJoCo Studio did not start in {_START_LIMIT:g} seconds")
        time.sleep(_BREATH)


def _set_model(handle: _OfStudio, session: Session) -> None:
    """Gives Studio a model and a state of its own; environments may share theirs."""
    model = session.shown.copy_model()
    data = mujoco.MjData(model)
    session.shown.copy_state(model, data)
    handle.set_model(model, data=data)


@dataclasses.dataclass(frozen=True)
class _StatusEvent(messages.Event):
    """The episode's status, for the panel; an event, as a reset may drop snapshots."""

    status: Status


@dataclasses.dataclass(frozen=True)
class _WishEvent(messages.Event):
    """A wish of the person at the panel."""

    wish: Wish


class _Loop(plugin.SimPlugin):
    """Steps the session, in the thread that called `run`."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._model_version = session.shown.version
        self._has_changed = True
        self._reported: Status | None = None

    @messages.handler
    def on_pre_step(self, event: messages.PreStepEvent) -> None:
        """Takes and shows the steps that have become due; called again and again."""
        session = self._session
        self._has_changed |= session.advance()
        if session.shown.version != self._model_version:
            self._model_version = session.shown.version
            _set_model(self.handle, session)
        elif self._has_changed:
            session.shown.copy_state(event.model, event.data)
        if self._has_changed:
            self._report()
        self._has_changed = False
        time.sleep(_BREATH)

    def _report(self) -> None:
        status = self._session.status()
        before = self._reported
        self._reported = status
        self.handle.send_to_viewer(_StatusEvent(status))
        if before is None or (before.paused, before.speed) != (status.paused, status.speed):
            state = sim.PauseState.NORMAL_PAUSED if status.paused else sim.PauseState.UNPAUSED
            speed = 100.0 * status.speed
            self.handle.send_to_viewer(messages.StepControlSnapshot(pause_state=state, speed=speed))

    @messages.handler
    def on_wish(self, event: _WishEvent) -> None:
        """A wish from the panel; one that cannot be granted is logged, and nothing changes."""
        try:
            event.wish(self._session)
        except ValueError as error:
            log.warning("%s", error)
        self._has_changed = True

    @messages.handler
    def on_step_control(self, event: messages.StepControlSnapshot) -> bool:
        """Pause and speed, from Studio's keys and menus; noise on the controls is refused."""
        self._pause(event.pause_state)
        self._session.set_speed(event.speed / 100.0)
        return True

    @messages.handler
    def on_pause(self, event: messages.RequestPauseEvent) -> bool:
        """Pause, from the panel and from looking back in time."""
        self._pause(event.pause_state)
        return True

    def _pause(self, state: _OfStudio) -> None:
        paused = state != sim.PauseState.UNPAUSED
        if paused != self._session.paused:
            self._session.pause(paused)
            # While paused, Studio may show an earlier state, which must not be overwritten.
            self._has_changed |= not paused
            self._report()

    @messages.handler
    def on_single_step(self, event: messages.SingleStepEvent) -> bool:
        """One control step."""
        self._session.step()
        self._has_changed = True
        return True

    @messages.handler
    def on_reset(self, event: messages.ResetEvent) -> None:
        """The next episode; Studio also resets its own copy, which is then overwritten."""
        self._session.reset()
        self._has_changed = True

    @messages.handler
    def on_perturb(self, event: messages.PerturbSnapshot) -> bool:
        """Pushes, from the mouse."""
        forces = event.state.reshape(-1, 6)
        if len(forces) == self._session.model.nbody:  # not of a model that was replaced
            self._session.push(forces)
        return True

    @messages.handler
    def on_state(self, event: messages.StateEvent) -> bool:
        """Joints and controls dragged by hand are refused."""
        self._has_changed = True  # Studio shows the true state again
        return True

    @messages.handler
    def on_options(self, event: messages.MjOptionSnapshot) -> bool:
        """Options of the physics are refused."""
        return True

    @messages.handler
    def on_keyframe(self, event: messages.KeyframeEvent) -> bool:
        """Keyframes are refused."""
        return True

    @messages.handler
    def on_threads(self, event: messages.ThreadPoolEvent) -> bool:
        """Studio does not step, so it needs no threads for it."""
        return True

    @messages.handler
    def on_load(self, event: messages.LoadModelEvent) -> bool:
        """Other models are refused."""
        log.info("the viewer shows one environment; another model cannot be loaded into it")
        return True


class _Panel(plugin.ViewerPlugin):
    """Shows the panel, in Studio's thread."""

    def __init__(
        self, session: Session, title: str, weigh: Weigh | None, command: Worded | None
    ) -> None:
        self.is_ready = threading.Event()
        self.is_drawn_by_software = threading.Event()  # which another thread sets
        self._panel = Panel(title, session, self._send, imgui, implot, weigh, command)

    def _send(self, wish: Wish) -> None:
        """Lets the thread that steps the session apply a wish."""
        self.viewer.send_to_sim(_WishEvent(wish))

    @messages.handler
    def on_init(self, event: plugin.ViewerInitEvent) -> None:
        """Studio has started."""
        self.is_ready.set()

    @messages.handler
    def on_status(self, event: _StatusEvent) -> None:
        """Keeps the status to show."""
        self._panel.show(event.status)

    @messages.handler
    def on_build_gui(self, event: messages.BuildGuiEvent) -> None:
        """Draws the panel, again for each frame."""
        if self.is_drawn_by_software.is_set():
            self.is_drawn_by_software.clear()
            self._send(lambda session: session.shown.drawn_by_software())
        self._panel.draw()


def _launch(
    access: Access,
    sock: socket.socket,
    title: str,
    plugins: list[_OfStudio],
    reports: Mapping[str, Callable[[], object]],
) -> _OfStudio:
    """Starts Studio in a thread of its own; returns its `ViewerHandle`."""
    # It reports each browser that comes and goes on standard output.
    logging.getLogger("WebServer").setLevel(logging.WARNING)
    config = viewer_protocol.ViewerConfig(title, gfx="web", http_port=access.address.port)
    of_viewer, of_loop = plugin.split_plugins(plugins)

    def show(endpoint: _OfStudio) -> None:
        viewer = _WebViewer(access, sock, reports, config, endpoint, plugins=of_viewer)
        viewer_protocol.run_viewer_loop(viewer)

    return launch_thread.launch_thread(show, sim_plugins=of_loop)


class _WebViewer(web_viewer.WebViewer):
    """Studio's web viewer: guarded, on a socket of ours, silent, and closed to files."""

    def __init__(
        self,
        access: Access,
        sock: socket.socket,
        reports: Mapping[str, Callable[[], object]],
        *args: Any,  # of Studio's own class
        **kwargs: Any,
    ) -> None:
        self._access, self._reports = access, reports
        # MuJoCo 4.0 binds to all networks and prints its addresses, and has no options for it.
        with (
            _replaced(web_server, "bind_public_socket", lambda host, port: sock),
            _replaced(web_viewer, "_print_url_banner", lambda host, port: None),
        ):
            super().__init__(*args, **kwargs)
        # An earlier episode's model is never shown again: keep only the present one.
        assert self._web_server is not None
        self._web_server.model_cache_bytes = 0

    def _start_server(self) -> None:
        """Starts the server with the guard in it; without it, the viewer closes."""
        serve, connect = web_server.serve, web_server.ServerConnection
        guard = Guard(self._access, serve, connect, _ADDITION.read_bytes(), self._reports)
        try:
            with _replaced(web_server, "serve", guard.serve):
                super()._start_server()
                guard.wait(_GUARD_LIMIT)
        except (OSError, concurrent.futures.TimeoutError) as error:
            self.close()
            raise ViewerError(
                "this version of MuJoCo Studio does not serve its page with limberjack's access "
                f"checks ({error!r}); expected MuJoCo 4.0"
            ) from error

    @messages.handler(priority=messages.Priority.INTERNAL)
    def _on_post_model(self, event: messages.PostModelEvent) -> None:
        self._update_model()

    def close(self) -> None:
        """Stops serving, and frees Studio's interface for the next viewer of this process.

        A process can have one such interface at a time. The viewer is part of a reference cycle, so
        the interface would be freed too late, and the next viewer would hang.
        """
        super().close()
        vars(self).pop("_headless_ui", None)

    def get_drop_file(self) -> str:
        """No file: the guard refuses uploads."""
        return ""


@contextlib.contextmanager
def _replaced(module: ModuleType, name: str, value: object) -> Iterator[None]:
    """Gives an attribute of a module another value, and its own one back at the end.

    Studio has no options for what the viewer changes in this way.
    """
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


@contextlib.contextmanager
def _private_settings(ux: ModuleType) -> Iterator[None]:
    """Keeps Studio's settings in a temporary file: ~/.mujoco.ini is neither read nor written.

    Args:
      ux: `mujoco.studio.ux`.
    """
    with tempfile.TemporaryDirectory() as directory, contextlib.ExitStack() as patches:
        path = str(Path(directory) / "studio.ini")
        for name in _SETTINGS:
            function = functools.partial(getattr(ux, name), ini_path=path)
            patches.enter_context(_replaced(ux, name, function))
        yield
