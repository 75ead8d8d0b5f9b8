"""The command itself: version, help, and what every command refuses."""

import subprocess
import sys
from pathlib import Path

import pytest

import limberjack
from tests.cli.conftest import call, invoke

_RUN = ["run", "humanoid", "stand", "--time-limit", "0.25"]


def test_the_installed_command_is_the_same(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("limberjack")
    if not command.exists():
        pytest.skip("limberjack is not installed beside this Python; it is run from its source")
    result = subprocess.run(
        [command, *_RUN], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert result.stdout == call(*_RUN, directory=tmp_path).stdout


def test_version_and_help() -> None:
    assert invoke("--version").stdout.strip() == limberjack.__version__
    assert "Run episodes of a task" in invoke("run", "--help").stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"],
        ["run", "humanoid"],
        [*_RUN, "--episodes", "0"],
        [*_RUN, "--seed", "-1"],
        [*_RUN, "--seed", "4294967296"],
        [*_RUN, "--speed", "3"],
        ["ru"],
    ],
)
def test_what_cannot_be_parsed_is_status_2(arguments: list[str]) -> None:
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from limberjack.cli import app; app(['--help'], standalone_mode=False)\n"
        "heavy = {'mujoco', 'dm_env', 'matplotlib', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=120)
