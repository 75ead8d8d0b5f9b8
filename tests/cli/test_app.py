"""The command itself: version, help, and what every command refuses."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer.main

import limberjack
from limberjack.cli import app
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
        [*_RUN, "--seeds", "-1"],
        [*_RUN, "--seeds", "4294967296"],
        [*_RUN, "--speed", "3"],
        ["ru"],
    ],
)
def test_arguments_that_cannot_be_parsed_are_status_2(arguments: list[str]) -> None:
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_without_a_command_five_to_begin_with_are_shown_and_each_is_understood() -> None:
    result = invoke()
    assert result.exit_code == 0
    shown = [line.split() for line in result.stdout.splitlines() if line.startswith("  limberjack")]
    assert len(shown) == 5
    commands = typer.main.get_command(app)
    for program, name, *arguments in shown:
        assert program == "limberjack"
        command = commands.commands[name]  # pyright: ignore[reportAttributeAccessIssue] (a group)
        command.make_context(name, arguments)  # it raises an error for arguments that it lacks


def test_the_system_s_errors_are_reported_without_their_number(tmp_path: Path) -> None:
    result = invoke("run", "cartpole", "balance", "--policy", f"mlp:{tmp_path / 'no'}")
    assert result.exit_code == 2
    assert "Errno" not in result.stderr
    assert f"No such file or directory: '{tmp_path / 'no'}'" in " ".join(result.stderr.split())


def test_numbers_have_short_types_in_help() -> None:
    text = invoke("evaluate", "--help").stdout + invoke("record", "--help").stdout
    assert " N " in text
    assert " X " in text
    for long in ("<int", "<float", "INTEGER", "FLOAT", "x>=", "<=x"):
        assert long not in text


def test_a_number_out_of_range_is_refused_with_the_range() -> None:
    result = invoke("train", "cartpole", "balance", "--out", "out", "--seed", "1000000")
    assert result.exit_code == 2
    assert "999999" in result.stderr


_SHELL = [sys.executable, "-m", "limberjack", "policies"]


@pytest.mark.skipif(sys.platform == "win32", reason="redirects with a POSIX shell")
@pytest.mark.parametrize(("closed", "lines"), [(">&-", 0), ("2>&-", 3)])
def test_a_closed_stream_is_no_error(closed: str, lines: int) -> None:
    done = subprocess.run(
        ["sh", "-c", f"{shlex.join(_SHELL)} {closed}"], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0
    assert done.stderr == ""
    assert done.stdout.count("\n") >= lines


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has /dev/full")
def test_a_full_output_is_reported_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(
            [sys.executable, "-m", "limberjack", "list"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert result.stderr == "limberjack: could not write: No space left on device\n"
    assert result.returncode == 1


def test_a_folder_whose_name_is_no_text_is_written_to(tmp_path: Path) -> None:
    done = call(*_RUN, "--out", "a\udcff", directory=tmp_path, MUJOCO_GL="disable")
    assert done.returncode == 0, done.stderr
    assert "a\\udcff/report.html" in done.stdout
    assert (tmp_path / "a\udcff" / "report.html").exists()
    replayed = call("replay", "a\udcff", directory=tmp_path)
    assert replayed.returncode == 0, replayed.stderr
    assert replayed.stdout.endswith(", every bit the same\n")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("import sys; sys.exit(0)", "raised SystemExit(0) (a_module.py, line 1, in <module>)"),
        ("{}['x']", "KeyError: 'x' (a_module.py, line 1, in <module>)"),
        ("raise ValueError('x')", "ValueError: x (a_module.py, line 1, in <module>)"),
    ],
)
def test_a_module_that_cannot_be_imported_is_named(
    source: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a_module.py").write_text(source)
    monkeypatch.chdir(tmp_path)
    done = invoke("--import", "a_module", "list")
    assert (done.exit_code, done.stderr) == (2, f"limberjack: --import a_module: {message}\n")


@pytest.mark.parametrize(
    ("module", "message"),
    [
        (".domains", "expected the full name of a module"),
        ("colorsys", "the module registers no domain; write suite.register(NAME, __name__) in its"),
        ("no_such_module", "No module named 'no_such_module'"),
    ],
)
def test_what_is_no_module_of_domains_is_refused(module: str, message: str) -> None:
    result = invoke("--import", module, "list")
    assert result.exit_code == 2
    assert result.stderr.startswith(f"limberjack: --import {module}: {message}")
    assert result.stderr.count("\n") == 1


# Any: Typer's own classes of commands.
_PROGRAM: Any = typer.main.get_command(app)
_HELP_PAGES = [[], *([name] for name in _PROGRAM.commands)]


@pytest.mark.parametrize("command", _HELP_PAGES)
def test_a_help_page_is_shown_by_either_name(command: list[str]) -> None:
    pages = [invoke(*command, option) for option in ("-h", "--help")]
    assert [page.exit_code for page in pages] == [0, 0]
    assert pages[0].stdout == pages[1].stdout


@pytest.mark.parametrize("command", _HELP_PAGES)
def test_flags_are_shown_without_a_type(
    command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    page = invoke(*command, "-h").stdout
    assert "bool" not in page.lower()
    assert re.search(r"--help +-h +Show this message", page)


def _examples(command: Any) -> list[list[str]]:
    """The arguments of the calls at the end of a help page."""
    lines = command.epilog.splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("limberjack ")]


@pytest.mark.parametrize("name", _PROGRAM.commands)
def test_every_help_page_ends_with_examples_that_can_be_parsed(name: str) -> None:
    page = invoke(name, "--help").stdout
    calls = _examples(_PROGRAM.commands[name])
    assert calls
    for arguments in calls:
        assert arguments[0] == name
        assert f"limberjack {shlex.join(arguments)}" in page
        _PROGRAM.commands[name].make_context(name, arguments[1:])


def test_the_examples_of_the_program_name_its_commands() -> None:
    calls = _examples(_PROGRAM)
    assert {arguments[0] for arguments in calls} <= {*_PROGRAM.commands, "COMMAND"}
    assert len(calls) > 1


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from limberjack.cli import app; app(['--help'], standalone_mode=False)\n"
        "heavy = {'mujoco', 'dm_env', 'matplotlib', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=120)


@pytest.mark.parametrize(
    ("arguments", "address"),
    [
        (["--ray"], "local"),
        (["--ray", "--workers", "2"], "local"),
        (["--ray", "head:6379"], "head:6379"),
        (["--ray=head:6379"], "head:6379"),
        ([], None),
    ],
)
def test_ray_takes_an_address_or_none(
    arguments: list[str], address: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[object] = []

    def evaluate(*args: object, **kwargs: object) -> None:
        asked.append(kwargs["ray"])
        raise ValueError("that will do")

    monkeypatch.setattr("limberjack.evaluation.evaluate", evaluate)
    assert invoke("evaluate", "humanoid", "walk", *arguments).stderr.endswith("that will do\n")
    assert asked == [address]


@pytest.mark.parametrize("command", ["run cartpole balance", "doctor"])
def test_a_damaged_mujoco_is_reported_with_commands_on_lines_of_their_own(
    command: str, tmp_path: Path
) -> None:
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "__init__.py").write_text(
        "raise ImportError('no core bindings. Repair with:\\n  pip install --no-deps mujoco')\n"
    )
    paths = [str(tmp_path), str(Path(limberjack.__file__).parents[1])]
    done = subprocess.run(
        [sys.executable, "-m", "limberjack", *command.split()],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    said = done.stdout + done.stderr
    lines = [line.strip() for line in said.splitlines()]
    assert "pip uninstall -y mujoco mujoco-core mujoco-studio" in lines
    assert "pip install 'mujoco>=4.0,<5'" in lines
    assert "MuJoCo cannot be imported: no core bindings" in said
    assert "--no-deps" not in said
    assert "Traceback" not in said


def test_a_lost_file_of_limberjack_is_reported_in_one_line() -> None:
    program = """
import sys
from limberjack import cli, suite
from limberjack.doctor import packages

def lost():
    raise FileNotFoundError(2, "No such file or directory", "walker.xml")

suite.tasks, packages.clashes = lost, lambda: ["Limberjack lacks 1 of its files"]
sys.argv = ["limberjack", "list"]
cli.main()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "limberjack: Limberjack lacks 1 of its files\n"
