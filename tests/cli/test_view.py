"""`limberjack view` and `viewer.launch` without a browser: access, addresses, errors and ends."""

import os
import re
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer.testing

from limberjack import suite, viewer
from limberjack.cli import app
from limberjack.viewer.session import Session, ViewerError
from tests.policies import saved_models
from tests.programs import INSTALL, run
from tests.viewer.handshakes import WEBSOCKET, Answer, ask, connect, head, seconds_until_closed

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


def _announced(process: "subprocess.Popen[str]") -> tuple[str, int, str]:
    """The address that the command prints, its port and its token."""
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.match(r"(http://127\.0\.0\.1:(\d+)/\?token=([\w-]{43}))(\s|$)", line)
    assert found, (line, process.communicate())
    return found[1], int(found[2]), found[3]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """The command, serving: its process, port, and the headers with which it lets a browser in."""
    directory = tmp_path_factory.mktemp("served")
    process = _program(directory, "-m", "limberjack", *_VIEW, "--allow-host", "viewer.example.org")
    _, port, token = _announced(process)
    yield SimpleNamespace(process=process, port=port, good={"Cookie": f"limberjack-{port}={token}"})
    process.kill()
    process.communicate()


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


# A message to the interface, as a forged click would be: a WebSocket frame of 16 bytes.
_FRAME = b"\x82\x90\x00\x00\x00\x00" + bytes(16)


def _is_refused(answer: Answer) -> bool:
    return answer.status == 403 and answer.text.startswith("limberjack: ")


@pytest.mark.parametrize("path", ["/", "/model", "/ui", "/state", "/drop", "/web_client.wasm"])
@pytest.mark.parametrize(
    "bad",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "http://localhost:1"},
        {"Host": "evil.example"},
        {"Cookie": ""},
        {"Cookie": "limberjack-8080=guess"},
    ],
)
def test_other_pages_other_names_and_other_users_are_refused(
    served: SimpleNamespace, path: str, bad: dict[str, str]
) -> None:
    websocket = WEBSOCKET if path in ("/ui", "/state", "/drop") else {}
    answer = ask(served.port, path, websocket | served.good | bad, after=_FRAME)
    assert _is_refused(answer)
    assert served.process.poll() is None


def test_uploads_are_refused_to_the_viewer_s_own_page(served: SimpleNamespace) -> None:
    own = {"Origin": f"http://localhost:{served.port}", **served.good, **WEBSOCKET}
    assert _is_refused(ask(served.port, "/drop?sid=1", own))


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("localhost:1", "http://localhost:1"),  # a tunnel from another port
        ("viewer.example.org", "https://viewer.example.org"),
    ],
)
def test_a_tunnel_and_a_name_that_is_allowed_are_let_in(
    served: SimpleNamespace, host: str, origin: str
) -> None:
    token = served.good["Cookie"].partition("=")[2]
    page = ask(served.port, f"/?token={token}", {"Host": host})
    assert page.status == 200
    cookie = page.headers["set-cookie"].partition(";")[0]
    browser = {"Host": host, "Origin": origin, "Cookie": cookie}
    for path, more, status in (("/model", {}, 200), ("/state", WEBSOCKET, 101)):
        answer = ask(served.port, path, browser | more)
        assert answer.status == status
        assert "access-control-allow-origin" not in answer.headers


@pytest.mark.slow  # tests/viewer/test_guard.py shortens the limit
def test_half_sent_handshakes_are_closed_after_ten_seconds(served: SimpleNamespace) -> None:
    half = head("/state", {"Host": f"localhost:{served.port}", **served.good})[:-4]
    took: list[float] = []

    def hold(sent: bytes) -> None:
        with connect(served.port) as connection:
            connection.sendall(sent)
            took.append(seconds_until_closed(connection))

    threads = [threading.Thread(target=hold, args=[sent]) for sent in (b"", half)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(9.0 < seconds < 15.0 for seconds in took), took
    assert len(took) == 2


def test_the_command_serves_this_machine_until_ctrl_c(running: Any, tmp_path: Path) -> None:
    address, port, token = _announced(running)
    assert _status(address) == 200
    cookie = f"limberjack-{port}={token}"
    assert ask(port, "/web_client.wasm", {"Cookie": cookie}).status == 200
    assert not _reaches("127.0.0.2", port)  # where it would be, listening on all networks
    taken = _invoke(*_VIEW, "--port", str(port))
    assert taken.exit_code == 2
    message = rf"limberjack: port {port} is in use; port \d+ is free\n"
    assert re.fullmatch(message, taken.stderr)
    for rubbish in (b"rubbish\r\n\r\n", b"GET / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"):
        with connect(port) as connection:
            connection.sendall(rubbish)
            assert seconds_until_closed(connection) < 15.0
    running.send_signal(signal.SIGINT)
    rest, errors = running.communicate(timeout=60)
    assert (rest, errors, running.returncode) == ("", "", 130)
    assert not _reaches("127.0.0.1", port)
    assert list(tmp_path.iterdir()) == []  # no ~/.mujoco.ini, no imgui.ini, no log


def test_two_viewers_started_at_once_have_ports_and_tokens_of_their_own(
    running: Any, tmp_path: Path
) -> None:
    other = _program(tmp_path, "-m", "limberjack", *_VIEW)
    try:
        both = [_announced(running), _announced(other)]
        jar = "; ".join(f"limberjack-{port}={token}" for _, port, token in both)
        for (address, port, token), (_, other_port, foreign) in (both, both[::-1]):
            assert port != other_port
            assert token != foreign
            assert _status(address) == 200
            assert ask(port, "/state", {"Cookie": jar, **WEBSOCKET}).status == 101
            assert _is_refused(ask(port, f"/?token={foreign}", {}))
    finally:
        other.kill()
        other.communicate()


def test_launch_takes_a_function_and_returns_after_ctrl_c(tmp_path: Path) -> None:
    program = """
        from limberjack import suite, viewer

        def load():
            global env
            env = suite.load("humanoid", "stand", task_kwargs={"random": 0})
            return env

        viewer.launch(load, policy="random", title="a title", announce=print)
        try:
            env.reset()
        except RuntimeError as error:
            print(error)
    """
    process = _program(tmp_path, "-c", textwrap.dedent(program))
    try:
        _announced(process)
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
        (
            (*_VIEW, "--allow-host", "https://a.example"),
            "expected a name such as viewer.example.org",
        ),
        ((*_VIEW, "--policy", "random", "--policy", "zeor"), "did you mean 'zero'"),
        ((*_VIEW, "--speed", "0"), "speed is 0.0; expected a positive number"),
    ],
)
def test_mistakes_are_one_line_and_start_nothing(arguments: tuple[str, ...], message: str) -> None:
    result = _invoke(*arguments)
    assert result.exit_code == 2
    assert message.lower() in result.stderr.lower()
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""


def test_a_saved_model_acts_in_the_viewer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = saved_models.install(monkeypatch, tmp_path)
    controls: list[np.ndarray] = []

    def show(session: Session) -> None:
        session.step()
        controls.append(session.data.ctrl.copy())

    monkeypatch.setattr(viewer, "in_window", lambda: show)
    result = _invoke("view", "humanoid/stand", "--native", "--policy", name, "--seed", "32")
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(controls, np.full((1, 21), 0.25))
    wrong = _invoke("view", "stacker/stack_2", "--native", "--policy", name)
    assert wrong.exit_code == 2
    assert "the model's actions have shape (21,)" in wrong.stderr


def test_plans_are_explained_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    def show(session: Session) -> None:
        session.step()
        seen.append(session.status().plan)

    monkeypatch.setattr(viewer, "in_window", lambda: show)
    command = ("view", "cartpole/balance", "--native", "--policy", "planner")
    for options in (("--explain",), ()):
        result = _invoke(*command, *options)
        assert result.exit_code == 0, result.output
    explained, silent = seen
    assert explained.stage == ""
    assert set(explained.terms) == {"height", "motion", "off centre", "reward"}
    assert silent is None


@pytest.mark.parametrize(
    "option", [("--port", "8080"), ("--host", "0.0.0.0"), ("--allow-host", "one.example")]
)
def test_a_window_has_no_address(option: tuple[str, str]) -> None:
    result = _invoke("view", "cartpole/balance", "--native", *option)
    assert result.exit_code == 2
    assert result.stderr.startswith("limberjack: --native opens a window and listens on no port")


def test_the_policies_named_are_offered_first_then_the_built_in_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Session] = []
    monkeypatch.setattr(viewer, "in_window", lambda: seen.append)
    named = ("--policy", "zero", "--policy", "pretrained", "--explain")
    for options in (named, ()):
        result = _invoke("view", "cartpole/balance", "--native", *options)
        assert result.exit_code == 0, result.output
    assert seen[0].policies == ("zero", "pretrained", "planner", "none", "random")
    assert seen[1].policies == ("none", "zero", "random", "planner", "pretrained")


def test_the_command_line_of_a_view_shows_the_same_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    commands: list[str] = []

    def in_browsers(
        access: object, title: str, announce: object, weigh: object, command: Any
    ) -> Any:
        def show(session: Session) -> None:
            session.choose("random")
            session.set_speed(0.5)
            session.begin(7)
            commands.append(command(session.status()))

        return show

    monkeypatch.setattr(viewer, "in_browsers", in_browsers)
    options = ("--policy", "zero", "--time-limit", "2")
    assert _invoke("view", "cartpole/balance", *options, "--seed", "3").exit_code == 0
    shown = "limberjack view cartpole/balance --policy random --time-limit 2 --seed 7 --speed 0.5"
    assert commands == [shown]
    # It is understood, and means itself.
    assert _invoke(*shown.split()[1:]).exit_code == 0
    assert commands == [shown, shown]


def test_the_command_line_of_a_view_has_all_digits_and_imports_what_was_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: list[str] = []

    def in_browsers(
        access: object, title: str, announce: object, weigh: object, command: Any
    ) -> Any:
        return lambda session: commands.append(command(session.status()))

    monkeypatch.setattr(viewer, "in_browsers", in_browsers)
    monkeypatch.syspath_prepend(tmp_path)
    source = "from limberjack import suite\nfrom tests.plain_domain import SUITE\n"
    (tmp_path / "shown_domain.py").write_text(f'{source}suite.register("shown", __name__)\n')
    typed = ["--import", "shown_domain", "--import", "tests.plain_domain", "view", "shown/push"]
    typed += ["--policy", "zero", "--time-limit", "0.1234567", "--seed", "0"]
    suite.register("plain", "tests.plain_domain")
    try:
        result = _invoke(*typed)
        assert result.exit_code == 0, result.output
    finally:
        suite.unregister("plain")
        suite.unregister("shown")
    assert commands == [" ".join(["limberjack", *typed])]


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
