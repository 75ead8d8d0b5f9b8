"""Messages between the driver and a worker, and the end of a worker."""

import io
import json
import os
import pickle
import select
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest

from limberjack.workers import prepare
from limberjack.workers.attempt import Answer
from limberjack.workers.pool import _PROGRAM
from limberjack.workers.process import LENGTH, read_message, write_message
from limberjack.workers.setup import Setup

from .killing import is_alive
from .playing import TASK, fork_and_end, print_and_seeds, scores_slowly


@pytest.fixture
def worker() -> Iterator["subprocess.Popen[bytes]"]:
    """A process that waits for units."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _PROGRAM, json.dumps(sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    with process:
        yield process
        process.kill()


def _streams(process: "subprocess.Popen[bytes]") -> tuple[IO[bytes], IO[bytes]]:
    assert process.stdin is not None
    assert process.stdout is not None
    return process.stdin, process.stdout


def test_messages_are_read_as_they_were_written() -> None:
    stream = io.BytesIO()
    write_message(stream, [b"one", b"", b"three"])
    stream.seek(0)
    assert [read_message(stream) for _ in range(3)] == [b"one", b"", b"three"]


@pytest.mark.parametrize("content", [b"", b"\x01", LENGTH.pack(5) + b"four"])
def test_the_end_of_a_stream_is_an_error_also_within_a_message(content: bytes) -> None:
    with pytest.raises(EOFError):
        read_message(io.BytesIO(content))


def _message(
    function: Callable[..., object],
    setup: Setup,
    seeds: tuple[int, ...],
    new: dict[str, Setup] = {},  # noqa: B006 (it is not changed)
) -> bytes:
    return pickle.dumps(({"function": function, **new}, "function", setup.key, seeds, ()))


@pytest.mark.skipif(sys.platform == "win32", reason="closes a stream with a POSIX shell")
def test_workers_play_where_standard_error_is_closed(tmp_path: Path) -> None:
    given = [*("evaluate", *TASK, "--policy", "random", "--episodes", "1"), "--time-limit", "0.05"]
    command = [sys.executable, "-m", "limberjack", *given, "--workers", "1", "--out", "out"]
    done = subprocess.run(["sh", "-c", f"{shlex.join(command)} 2>&-"], cwd=tmp_path, timeout=120)
    assert done.returncode == 0
    assert (tmp_path / "out" / "result.json").exists()


def test_a_worker_answers_prints_to_standard_error_and_ends_with_its_input(
    worker: "subprocess.Popen[bytes]",
) -> None:
    units, answers = _streams(worker)
    setup = prepare(*TASK, "random")
    worker.send_signal(0)
    write_message(units, [_message(print_and_seeds, setup, (3, 4), {setup.key: setup})])  # pyright: ignore[reportArgumentType]
    assert pickle.loads(read_message(answers)) == Answer((3, 4))  # pyright: ignore[reportArgumentType]
    score = Path(f"/proc/{worker.pid}/oom_score_adj")
    assert not score.exists() or score.read_text() == "500\n"  # Linux ends it before the driver
    worker.send_signal(signal.SIGINT)  # the driver's business
    write_message(units, [_message(print_and_seeds, setup, (5,))])  # pyright: ignore[reportArgumentType]
    assert pickle.loads(read_message(answers)) == Answer((5,))  # pyright: ignore[reportArgumentType]
    # In the middle of a unit, and without a word.
    write_message(units, [_message(scores_slowly, setup, (6,))])  # pyright: ignore[reportArgumentType]
    _, printed = worker.communicate(timeout=20)
    assert worker.returncode == 0
    assert b"printed by a policy" in printed
    assert b"written by a library" in printed
    assert b"Traceback" not in printed


def test_the_end_of_a_worker_is_noticed_while_a_process_lives_that_it_forked(
    worker: "subprocess.Popen[bytes]",
) -> None:
    units, answers = _streams(worker)
    setup = prepare(*TASK, "random")
    write_message(units, [_message(fork_and_end, setup, (0,), {setup.key: setup})])  # pyright: ignore[reportArgumentType]
    assert worker.stderr is not None
    child = int(worker.stderr.readline())
    try:
        assert select.select([answers], [], [], 30)[0], "a driver would wait for the other process"
        with pytest.raises(EOFError):
            read_message(answers)  # pyright: ignore[reportArgumentType]
        assert is_alive(child)
    finally:
        os.kill(child, signal.SIGKILL)
