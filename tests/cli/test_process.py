"""Commands end with their work: after Ctrl-C at any moment, and whatever a policy leaves behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer

import limberjack
from limberjack.cli import process
from limberjack.cli.process import command_line
from limberjack.utils.files import Hold

_COMMAND = [sys.executable, "-m", "limberjack"]
_PATH = {"PYTHONPATH": str(Path(limberjack.__file__).parents[1])}
_PLAYING = ["evaluate", "cartpole", "balance", "--time-limit", "0.1", "--episodes", "2"]
_ENDS_BY = 60.0  # seconds; a process that hangs fails, on a slow machine too

# Each leaves something that would keep Python from exiting.
_LEAVING = """
import atexit, multiprocessing, threading, time
import numpy as np

done = []

def once(leave):
    if not done:
        done.append(leave())
    return np.zeros(1)

def thread(observation):
    return once(threading.Thread(target=time.sleep, args=(1000,), name="left").start)

def process(observation):
    return once(multiprocessing.get_context("spawn").Process(target=time.sleep, args=(1000,)).start)

def handler(observation):
    return once(lambda: atexit.register(time.sleep, 1000))

def failing(observation):
    thread(observation)
    raise KeyError("x")
"""

needs_signals = pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT to send")


def _started(*arguments: str, directory: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*_COMMAND, *arguments],
        cwd=directory,
        env={**os.environ, **_PATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _ended(running: "subprocess.Popen[str]") -> tuple[int, str, str]:
    """Exit status, output and errors; fails if the process does not end."""
    try:
        output, errors = running.communicate(timeout=_ENDS_BY)
    finally:
        running.kill()
    return running.returncode, output, errors


_LEFT = {
    "thread": (0, "thread 'left'"),
    "process": (0, "exit handler or process"),
    "handler": (0, "exit handler or process"),
    "failing": (1, "thread 'left'"),
}


def test_what_a_policy_leaves_behind_does_not_keep_the_command_alive(tmp_path: Path) -> None:
    (tmp_path / "leaving.py").write_text(_LEAVING)
    # All at once, because each waits for seconds.
    running = {
        name: _started(*_PLAYING, "--policy", f"leaving:{name}", "--out", name, directory=tmp_path)
        for name in _LEFT
    }
    ended = {name: _ended(one) for name, one in running.items()}
    for name, (status, what) in _LEFT.items():
        code, _, errors = ended[name]
        assert code == status, errors
        assert errors.splitlines()[-1] == (
            f"limberjack: a policy's {what} was still running after the command, and is ended"
        )
        assert "Traceback" not in errors
        assert (tmp_path / name / "result.json").exists() == (status == 0)


@needs_signals
@pytest.mark.parametrize("seconds", [0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.7])
def test_ctrl_c_while_a_command_starts_is_status_130_and_no_traceback(
    seconds: float, tmp_path: Path
) -> None:
    running = _started("evaluate", "cartpole", "balance", "--policy", "planner", directory=tmp_path)
    time.sleep(seconds)
    running.send_signal(signal.SIGINT)
    code, output, errors = _ended(running)
    assert code == 130, errors
    assert output == ""
    assert errors == "" or errors.startswith("limberjack: interrupted: no episode was played")
    assert errors.count("\n") <= 1


@needs_signals
def test_a_command_of_the_background_ignores_ctrl_c(tmp_path: Path) -> None:
    ignoring = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"
    program = f"{ignoring}; import os, sys; os.execv(sys.executable, {[*_COMMAND, 'list']!r})"
    running = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, **_PATH},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for _ in range(5):
        time.sleep(0.1)
        running.send_signal(signal.SIGINT)
    code, output, errors = _ended(running)
    # The first signal may come before the program ignores it.
    assert code == 0 or (code == -signal.SIGINT and not output), errors


@needs_signals
def test_a_program_that_imports_the_package_keeps_its_own_handling(tmp_path: Path) -> None:
    for name in ("limberjack", "mine.py"):
        (tmp_path / name).write_text(
            "import signal\nimport limberjack\n"
            "assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n"
        )
        done = subprocess.run(
            [sys.executable, tmp_path / name],
            env={**os.environ, **_PATH},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr


@pytest.fixture
def _signals() -> object:
    """Gives the test's process its signal handlers back."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield None
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Statuses that the process would be ended with if its exit took too long."""
    statuses: list[int] = []
    monkeypatch.setattr(process, "_end_in_time", statuses.append)
    return statuses


@pytest.mark.usefixtures("_signals")
@pytest.mark.parametrize(
    ("number", "status"),
    [(signal.SIGINT, process.INTERRUPTED), (signal.SIGTERM, process.TERMINATED)],
)
def test_a_signal_outside_of_a_command_is_its_status(
    number: signal.Signals, status: int, ended: list[int]
) -> None:
    with pytest.raises(SystemExit) as caught, process.own_process():
        signal.raise_signal(number)
    assert caught.value.code == status
    assert ended == [status]


@pytest.mark.usefixtures("_signals")
def test_sigterm_gives_the_status_of_an_interrupted_command_its_own(ended: list[int]) -> None:
    def command() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            raise SystemExit(process.INTERRUPTED) from None

    with pytest.raises(SystemExit) as caught, process.own_process():
        command()
    assert caught.value.code == process.TERMINATED
    assert ended == [process.TERMINATED]


@pytest.mark.usefixtures("_signals")
def test_other_ends_are_left_as_they_are(ended: list[int]) -> None:
    with process.own_process():
        typer.echo("")
    with pytest.raises(SystemExit), process.own_process():
        raise SystemExit(2)
    with pytest.raises(KeyError), process.own_process():
        raise KeyError("x")
    assert ended == [0, 2, 1]


@pytest.mark.usefixtures("_signals", "ended")
def test_an_interrupt_of_an_import_ends_the_process_unless_a_file_is_unfinished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "interrupting.py").write_text("import signal\nsignal.raise_signal(signal.SIGINT)\n")
    monkeypatch.syspath_prepend(tmp_path)
    statuses: list[int] = []

    def end(status: int) -> None:
        statuses.append(status)
        raise SystemExit(status)

    monkeypatch.setattr(os, "_exit", end)
    with pytest.raises(SystemExit), process.own_process():
        __import__("interrupting")
    assert statuses == [process.INTERRUPTED]
    with pytest.raises(SystemExit), Hold(tmp_path), process.own_process():
        __import__("interrupting")
    assert statuses == [process.INTERRUPTED]


def test_the_command_is_quoted_for_a_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/limberjack", "run", "humanoid", "--out", "a b"])
    assert command_line() == "limberjack run humanoid --out 'a b'"


def test_bytes_that_are_no_text_can_be_written_to_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["limberjack", "run", "--out", "a\udcff"])
    assert command_line() == r"limberjack run --out 'a\udcff'"
