"""Installed packages and extras."""

import email.message
import importlib.metadata
import tomllib
from pathlib import Path

import pytest

from limberjack.doctor import packages

_REPOSITORY = Path(__file__).parents[2]


def test_extras_are_those_of_the_projects_metadata() -> None:
    with open(_REPOSITORY / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)["project"]
    found = {extra.name: extra for extra in packages.extras()}
    assert set(found) == set(project["optional-dependencies"])
    for name, extra in found.items():
        assert extra.command == f"pip install 'limberjack[{name}]'"
    # This very test needs it.
    assert "pytest" not in found["test"].missing


def test_extras_come_from_the_metadata_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    metadata = email.message.Message()
    for name in ("draw", "all"):
        metadata["Provides-Extra"] = name
    for requirement in (
        "numpy",
        'no-such-thing>=2; extra == "draw"',
        'pytest; extra == "draw"',
        'old-thing; python_version < "3.9" and extra == "draw"',
        'new-thing; python_version >= "3.9" and extra == "draw"',
        'limberjack[draw]; extra == "all"',
        'other_thing[part]<3 ; extra == "all"',
    ):
        metadata["Requires-Dist"] = requirement
    monkeypatch.setattr(importlib.metadata, "metadata", lambda _: metadata)
    draw, all_ = packages.extras()
    assert (draw.name, draw.missing) == ("draw", ("new-thing", "no-such-thing"))
    assert not draw.is_installed
    assert all_.missing == ("new-thing", "no-such-thing", "other_thing")
    assert all_.command == "pip install 'limberjack[all]'"


def test_an_older_mujoco_beside_mujoco_core_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "version", {"mujoco": "3.3.0", "mujoco-core": "4.0.0"}.get)
    (problem,) = packages.clashes()
    assert "mujoco 3.3.0 is installed beside mujoco-core 4.0.0" in problem
    assert "pip uninstall" in problem
    for versions in ({"mujoco": "4.0.0", "mujoco-core": "4.0.0"}, {"mujoco-core": "4.0.0"}):
        monkeypatch.setattr(packages, "version", versions.get)
        assert packages.clashes() == []
