"""Commands with workers leave no process, no shared memory and no file outside their folder."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.workers.killing import marked, shared_memory, wait_for

_SLOW = "tests.workers.playing:Deadly"
_COMMANDS = {
    "evaluate": ["pendulum", "swingup", "--policy", _SLOW, "--seeds", "60:200"],
    "collect": ["pendulum", "swingup", "--policy", _SLOW, "--seeds", "60:200"],
    "solve": ["manipulator", "bring_ball", "--episodes", "6"],
}
# matplotlib keeps its list of fonts there, with and without workers.
_OF_MATPLOTLIB = {".cache", ".cache/matplotlib", ".config", ".config/matplotlib"}


def _below(folder: Path) -> set[str]:
    found = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    return {name for name in found if not name.startswith(".cache/matplotlib/fontlist")}


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux's /proc")
@pytest.mark.parametrize("number", [None, signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("command", _COMMANDS)
def test_nothing_is_left_behind(command: str, number: int | None, tmp_path: Path) -> None:
    for name in ("home", "tmp", "work"):
        (tmp_path / name).mkdir()
    mark = f"LEFT_BEHIND={tmp_path}"
    variables = {
        "LEFT_BEHIND": str(tmp_path),
        "HOME": str(tmp_path / "home"),
        "TMPDIR": str(tmp_path / "tmp"),
        "PYTHONPATH": os.pathsep.join(sys.path),
        "SLOW": "0.1",
    }
    options = ["--time-limit", "0.2", "--workers", "2", "--out", str(tmp_path / "out")]
    driver = subprocess.Popen(
        [sys.executable, "-m", "limberjack", command, *_COMMANDS[command], *options],
        cwd=tmp_path / "work",
        env={**os.environ, **variables},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(lambda: len(marked(mark)) == 3)
    wait_for(lambda: list((tmp_path / "out").glob("[!.]*")))
    assert not [line for one in marked(mark) for line in shared_memory(one)]
    if number is not None:
        driver.send_signal(number)
    _, printed = driver.communicate(timeout=300)
    expected = {None: 0, signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL}
    assert driver.returncode == expected[number], printed
    wait_for(lambda: not marked(mark))
    assert _below(tmp_path / "home") <= _OF_MATPLOTLIB
    assert _below(tmp_path / "tmp") == _below(tmp_path / "work") == set()
