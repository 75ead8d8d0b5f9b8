"""Tests of limberjack.utils.requirements."""

import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from limberjack.utils.requirements import MUJOCO, PACKAGES, install_command, missing_extra

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
        ("video", "pip install imageio-ffmpeg matplotlib"),
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
