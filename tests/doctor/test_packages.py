"""Installed packages and extras."""

import importlib.metadata
from pathlib import Path

import pytest

from limberjack.doctor import packages
from limberjack.utils import requirements

_CLEAN = {"mujoco": "4.0.0", "mujoco-core": "4.0.0", "mujoco-studio": "4.0.0"}
_REMEDY = """Run these commands, one after the other:
  pip uninstall -y mujoco mujoco-core mujoco-studio
  pip install 'mujoco>=4.0,<5'
Programs that need MuJoCo 3, as dm_control does, belong into another virtual environment."""


def test_extras_name_the_packages_that_are_missing_and_the_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    installed = {"matplotlib": "3.9", "pillow": "13.0", "ipykernel": "6.29", "ray": "2.60"}
    monkeypatch.setattr(packages, "version", installed.get)
    found = {extra.name: extra for extra in packages.extras()}
    assert found.keys() == requirements.PACKAGES.keys()
    assert found["video"].missing == ("imageio-ffmpeg",)
    assert found["video"].command == "pip install imageio-ffmpeg matplotlib pillow"
    assert found["notebook"].missing == ("imageio-ffmpeg",)
    assert found["rllib"].missing == ("torch",)
    assert not found["rllib"].is_installed


def test_versions_are_those_of_the_installed_distributions() -> None:
    found = packages.versions()
    assert found["mujoco"] == importlib.metadata.version("mujoco")
    assert packages.version("no-such-package") is None


def test_mujocos_packages_agree_here() -> None:
    assert packages.clashes() == []


@pytest.mark.parametrize("change", [{"mujoco": "3.3.0"}, {"mujoco-studio": "4.0.1"}])
def test_parts_of_several_mujocos_are_a_problem_with_its_remedy(
    change: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {**_CLEAN, **change}
    monkeypatch.setattr(packages, "version", found.get)
    (problem,) = packages.clashes()
    listed = ", ".join(f"{name} {number}" for name, number in found.items())
    assert problem.startswith(f"{listed} are installed together")
    assert problem.endswith(_REMEDY)


def test_files_that_limberjack_lost_are_a_problem_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    metadata = tmp_path / "limberjack-1.0.0.dist-info"
    metadata.mkdir()
    (metadata / "RECORD").write_text("limberjack/suite/walker.xml,,", encoding="utf-8")
    own = importlib.metadata.PathDistribution(metadata)
    monkeypatch.setattr(packages, "version", {**_CLEAN, "limberjack": "1.0.0"}.get)
    monkeypatch.setattr(
        importlib.metadata, "files", lambda name: own.files if name == "limberjack" else []
    )
    (problem,) = packages.clashes()
    assert problem == (
        "Limberjack lacks 1 of its files, such as limberjack/suite/walker.xml: uninstall it with "
        "`pip uninstall limberjack`, and install it again as before"
    )


def test_files_that_mujoco_lost_are_a_problem_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    metadata = tmp_path / "mujoco_core-4.0.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Name: mujoco-core\nVersion: 4.0.0\n", encoding="utf-8")
    files = ("mujoco/batch.py,,", "mujoco/__pycache__/batch.pyc,,", "mujoco/_specs.so,,")
    (metadata / "RECORD").write_text("\n".join(files), encoding="utf-8")
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "batch.py").touch()
    core = importlib.metadata.PathDistribution(metadata)
    monkeypatch.setattr(packages, "version", _CLEAN.get)
    monkeypatch.setattr(
        importlib.metadata, "files", lambda name: core.files if name == "mujoco-core" else []
    )
    (problem,) = packages.clashes()
    assert problem.startswith("MuJoCo 4.0.0 lacks 1 of its files, such as mujoco/_specs.so")
    assert problem.endswith(_REMEDY)
    (tmp_path / "mujoco" / "_specs.so").touch()
    assert packages.clashes() == []
