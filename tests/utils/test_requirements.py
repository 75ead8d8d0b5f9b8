"""Tests of limberjack.utils.requirements."""

import importlib
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from limberjack.utils.requirements import (
    MUJOCO,
    MUJOCO_BROKEN,
    MUJOCO_COMMANDS,
    MUJOCO_REMEDY,
    PACKAGES,
    broken_mujoco,
    install_command,
    is_of_mujoco,
    missing_extra,
)

_REPOSITORY = Path(__file__).parents[2]
_PROJECT = tomllib.loads((_REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
_EXTRAS = _PROJECT["optional-dependencies"]
_FOR_DEVELOPERS = {"docs", "test"}  # no message names these
# Text files that users read or that print what users read.
_READ = ("README.md", "CONTRIBUTING.md", "docs/**/*.md", "examples/*", "src/**/*.py", "Makefile")


def _packages(extra: str) -> list[str]:
    """The packages of an extra in pyproject.toml, those of the extras that it names included."""
    found: list[str] = []
    for requirement in map(Requirement, _EXTRAS[extra]):
        if requirement.name == "limberjack":
            found += [name for other in sorted(requirement.extras) for name in _packages(other)]
        else:
            parts = f"[{','.join(sorted(requirement.extras))}]" if requirement.extras else ""
            found.append(requirement.name + parts)
    return found


def test_the_packages_of_each_extra_are_those_of_the_project() -> None:
    assert set(PACKAGES) == set(_EXTRAS) - _FOR_DEVELOPERS
    for extra, packages in PACKAGES.items():
        assert sorted(packages) == sorted(_packages(extra)), extra


def test_mujocos_versions_are_those_of_the_project() -> None:
    assert MUJOCO in _PROJECT["dependencies"]


@pytest.mark.parametrize(
    ("extra", "command"),
    [
        ("video", "pip install imageio-ffmpeg matplotlib pillow"),
        ("rllib", "pip install 'ray[rllib]' torch"),
    ],
)
def test_the_error_names_the_extra_and_a_command_for_a_shell(extra: str, command: str) -> None:
    assert install_command(extra) == command
    error = missing_extra(extra)
    assert isinstance(error, ImportError)
    assert str(error) == f"needs the extra {extra!r}: {command}"


def test_nothing_tells_users_to_install_limberjack_from_an_index() -> None:
    files = [file for pattern in _READ for file in _REPOSITORY.glob(pattern) if file.is_file()]
    assert len(files) > 100
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert "limberjack[" not in text.replace("limberjack[...]", ""), file
        assert "pip install limberjack" not in text, file


# Beginnings of what a damaged MuJoCo raises; the advice is left out.
_ADVICE = "Repair your environment with:\n  pip install --force-reinstall --no-deps mujoco"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            f"the core bindings are missing (for example, so). {_ADVICE}",
            "the core bindings are missing",
        ),
        (
            f"Version mismatch between 'mujoco' (4.0.1) and x. {_ADVICE}",
            "Version mismatch between 'm",
        ),
        ("libmujoco.so.4.0.0: cannot open shared object file", "libmujoco.so.4.0.0: cannot open"),
        (f"limberjack needs mujoco.batch; {MUJOCO_REMEDY}", "limberjack needs mujoco.batch."),
        ("", "ImportError"),
    ],
)
def test_a_damaged_mujoco_is_reported_with_commands_on_lines_of_their_own(
    text: str, reason: str
) -> None:
    error = broken_mujoco(ImportError(text))
    first, *commands, last = str(error).splitlines()
    assert first.startswith(f"{MUJOCO_BROKEN}: {reason}")
    assert first.endswith("Run these commands, one after the other:")
    assert [command.strip() for command in commands] == list(MUJOCO_COMMANDS)
    assert last.startswith("Programs that need MuJoCo 3")
    assert "--no-deps" not in str(error)
    assert is_of_mujoco(error)
    assert broken_mujoco(error) is error


def test_the_commands_are_words_that_a_shell_understands() -> None:
    uninstall, install = map(shlex.split, MUJOCO_COMMANDS)
    assert uninstall == ["pip", "uninstall", "-y", "mujoco", "mujoco-core", "mujoco-studio"]
    assert install == ["pip", "install", MUJOCO]


def test_an_error_of_importing_mujoco_is_recognised_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_of_mujoco(ModuleNotFoundError("no", name="mujoco"))
    assert is_of_mujoco(ModuleNotFoundError("no", name="mujoco._specs"))
    for other in (ImportError("no"), ModuleNotFoundError("no", name="torch"), KeyError("mujoco")):
        assert not is_of_mujoco(other)
    assert not is_of_mujoco(missing_extra("video"))
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "__init__.py").write_text("raise ImportError('damaged')\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "mujoco"]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(ImportError, match="damaged") as caught:
        importlib.import_module("mujoco")
    assert is_of_mujoco(caught.value)
