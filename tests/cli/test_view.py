"""`limberjack view` and `viewer.launch` without a browser: addresses, errors and ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

from limberjack import suite, viewer
from limberjack.cli import app
from limberjack.viewer.session import ViewerError
from tests.programs import INSTALL, run

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)

_VIEW = ("view", "humanoid", "stand")


def _invoke(*arguments: str) -> Any:
    return typer.testing.CliRunner().invoke(app, list(arguments))


def _program(directory: Path, *arguments: str) -> "subprocess.Popen[str]":
    # Studio keeps its settings in the home directory.
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=directory,
        env={**os.environ, "HOME": str(directory)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def running(tmp_path: Path) -> "Iterator[subprocess.Popen[str]]":
    """The command, serving browsers."""
    process = _program(tmp_path, "-m", "limberjack", *_VIEW)
    yield process
    process.kill()
    process.communicate()


def _port_of(process: "subprocess.Popen[str]") -> int:
    """The port that the command announces."""
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.match(r"http://127\.0\.0\.1:(\d+)/ ", line)
    assert found, (line, process.communicate())
    return int(found[1])


def _status(address: str) -> int:
    with urllib.request.urlopen(address, timeout=60) as response:
        response.read()
        return response.status


def _reaches(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=5).close()
    except OSError:
        return False
    return True


def test_the_command_serves_this_machine_until_ctrl_c(running: Any) -> None:
    port = _port_of(running)
    assert _status(f"http://127.0.0.1:{port}/") == 200
    assert _status(f"http://127.0.0.1:{port}/web_client.wasm") == 200
    assert not _reaches("127.0.0.2", port)  # where it would be, listening on all networks
    taken = _invoke(*_VIEW, "--port", str(port))
    assert taken.exit_code == 2
    message = rf"limberjack: port {port} is in use; port \d+ is free\n"
    assert re.fullmatch(message, taken.stderr)
    running.send_signal(signal.SIGINT)
    rest, errors = running.communicate(timeout=60)
    assert (rest, errors, running.returncode) == ("", "", 130)
    assert not _reaches("127.0.0.1", port)


def test_launch_takes_a_function_and_returns_after_ctrl_c(tmp_path: Path) -> None:
    program = """
        from limberjack import suite, viewer

        def load():
            global env
            env = suite.load("humanoid", "stand", task_kwargs={"random": 0})
            return env

        viewer.launch(load, policy="random", title="a title", announce=lambda url: print(url, ""))
        try:
            env.reset()
        except RuntimeError as error:
            print(error)
    """
    process = _program(tmp_path, "-c", textwrap.dedent(program))
    try:
        _port_of(process)
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert (errors, process.returncode) == ("", 0)
    assert "this environment is closed" in rest  # launch made it, so launch closed it


def test_a_process_may_launch_one_viewer_after_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    program = """
        import gc, threading, time
        from limberjack import suite, viewer

        gc.disable()  # what it would free happens to be freed in time
        env = suite.load("humanoid", "stand", task_kwargs={"random": 0})
        for _ in range(2):
            left = iter(range(20))

            def act(time_step):
                if next(left, None) is None:
                    raise KeyboardInterrupt
                return env.action_spec().generate_value()

            viewer.launch(env, act, announce=lambda url: None)
            print([thread.name for thread in threading.enumerate() if "run" in thread.name])
        time.sleep(1.0)  # where a viewer that hangs would crash
    """
    # Studio leaves sockets to the garbage collector.
    assert run(program, warnings="ignore") == "[]\n[]\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("view", "humanoid", "wlak"), "did you mean 'walk'"),
        ((*_VIEW, "--policy", "zeor"), "did you mean 'zero'"),
        ((*_VIEW, "--host", "192.0.2.1"), "is not an address of this machine"),
        ((*_VIEW, "--port", "0"), "port is 0"),
        ((*_VIEW, "--speed", "0"), "speed is 0.0; expected a positive number"),
        ((*_VIEW, "--time-limit", "inf"), "--time-limit is inf"),
    ],
)
def test_mistakes_are_one_line_and_start_nothing(arguments: tuple[str, ...], message: str) -> None:
    result = _invoke(*arguments)
    assert result.exit_code == 2
    assert message.lower() in result.stderr.lower()
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a display is always there")
def test_without_a_display_there_is_no_window(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    result = _invoke(*_VIEW, "--native")
    assert result.exit_code == 1
    assert result.stderr.startswith("limberjack: there is no display for a window")
    with pytest.raises(ViewerError, match="there is no display"):
        viewer.launch(suite.load("humanoid", "stand"), native=True)


def test_launch_refuses_what_it_cannot_show() -> None:
    with pytest.raises(TypeError, match="has no MuJoCo simulation"):
        viewer.launch(suite.load_batch("humanoid", "stand", num_envs=2, seed=0))
    with pytest.raises(TypeError, match="expected a function from a TimeStep"):
        viewer.launch(suite.load("humanoid", "stand"), policy=[0.0] * 21)  # pyright: ignore


def test_a_studio_that_does_not_load_is_reported_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.studio", None)
    monkeypatch.delitem(sys.modules, "limberjack.viewer.studio")
    monkeypatch.delattr(viewer, "studio")
    result = _invoke(*_VIEW)
    assert result.exit_code == 1
    expected = (
        "limberjack: limberjack view needs MuJoCo Studio, which cannot be imported: "
        "import of mujoco.studio halted; None in sys.modules; --native needs nothing\n"
    )
    assert result.stderr == expected


def test_programs_for_dm_control_find_it_under_its_name() -> None:
    shown = run(f"""
    {INSTALL}
    from dm_control import viewer
    import limberjack.viewer
    print(viewer.launch is limberjack.viewer.launch)
    from dm_control.viewer import application  # not built, but importable
    """)
    assert shown == "True\n"
