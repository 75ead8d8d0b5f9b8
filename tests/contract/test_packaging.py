"""Installed files, requirements, and the targets of make and CI."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import limberjack

from .source import REPOSITORY, SOURCE

_PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
_CORE = {"dm-env", "gymnasium", "mujoco", "numpy", "rich", "safetensors", "threadpoolctl", "typer"}


def _name(requirement: str) -> str:
    """The normalised name of the package that a requirement is for."""
    match = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert match, requirement
    return re.sub(r"[-_.]+", "-", match[0]).lower()


def _constraints() -> dict[str, str]:
    lines = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {_name(name): version for name, version in pins}


def _make(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    make = shutil.which("make")
    if make is None:
        pytest.skip("make is not installed")
    # Without the flags of a make that runs these tests.
    environment = {name: value for name, value in os.environ.items() if "MAKE" not in name}
    assignments = [f"{name}={value}" for name, value in variables.items()]
    return subprocess.run(
        [make, *arguments, *assignments],
        cwd=REPOSITORY,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )


def test_the_version_is_written_once() -> None:
    assert _PROJECT["dynamic"] == ["version"]
    try:
        installed = metadata.version("limberjack")
    except metadata.PackageNotFoundError:
        pytest.skip("limberjack is run from its source, without being installed")
    assert installed == limberjack.__version__


def test_the_changelog_knows_the_version() -> None:
    text = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## [{limberjack.__version__}]" in text


def test_the_core_needs_few_packages() -> None:
    assert {_name(requirement) for requirement in _PROJECT["dependencies"]} == _CORE


def test_every_extra_is_named_on_the_page_of_installing() -> None:
    text = (REPOSITORY / "docs" / "install.md").read_text(encoding="utf-8")
    for extra in _PROJECT["optional-dependencies"]:
        assert f"`{extra}`" in text, extra


def test_constraints_pin_every_requirement_and_name_no_address() -> None:
    pins = _constraints()
    extras = _PROJECT["optional-dependencies"].values()
    for requirement in [*_PROJECT["dependencies"], *(item for extra in extras for item in extra)]:
        assert _name(requirement) in {*pins, "limberjack"}, requirement
    assert "//" not in (REPOSITORY / "constraints.txt").read_text(encoding="utf-8")


def test_the_pinned_mujoco_is_one_version() -> None:
    pins = _constraints()
    assert pins["mujoco"] == pins["mujoco-core"] == pins["mujoco-studio"]


def test_the_package_is_typed_and_carries_its_models() -> None:
    root = Path(limberjack.__file__).parent
    assert (root / "py.typed").exists()
    assert {path.name for path in root.glob("suite/*.xml")} >= {"humanoid.xml"}


def test_the_wheel_holds_the_package_alone_and_no_hook_of_pythons_start() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel == {"packages": ["src/limberjack"]}
    assert not list((REPOSITORY / "src").rglob("*.pth"))


def test_the_licence_is_apache_and_the_notice_names_what_follows_dm_control() -> None:
    assert "Version 2.0, January 2004" in (REPOSITORY / "LICENSE").read_text(encoding="utf-8")
    notice = (REPOSITORY / "NOTICE").read_text(encoding="utf-8")
    assert "The dm_control Authors" in notice
    package = SOURCE / "limberjack"
    rows = re.findall(r"^    ([\w/.]+)  +\S", notice, re.MULTILINE)
    listed = [name for name in rows if name != "here"]
    assert [name for name in listed if not (package / name).exists()] == []
    models = {path.relative_to(package).as_posix(): path for path in package.rglob("*.xml")}
    assert models.keys() <= set(listed)
    for path in models.values():
        head = path.read_text(encoding="utf-8").partition("<mujoco")[0]
        assert "The dm_control" in head, path
        assert "see NOTICE" in head, path


def test_the_page_of_installing_names_the_licence_of_the_ffmpeg_in_the_wheel() -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    page = (REPOSITORY / "docs" / "install.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith("| `video` |")]
    assert ("--enable-gpl" in done.stdout) == ("under the GPL" in row)


def test_make_alone_lists_the_targets() -> None:
    result = _make()
    assert result.returncode == 0
    for target in ("demo", "test", "test-slow", "lint", "format", "clean"):
        assert f"  {target} " in result.stdout


def test_make_reports_a_missing_python() -> None:
    result = _make("check-python", PYTHON="no-such-python")
    assert result.returncode != 0
    assert "there is no working 'no-such-python'" in result.stderr


def test_make_reports_a_python_that_is_too_old(tmp_path: Path) -> None:
    # This Python, made to believe that it is older.
    old = tmp_path / "python"
    old.write_text(
        f'#!/bin/sh\nshift\nexec "{sys.executable}" -c '
        '"import sys; sys.version_info = (3, 9, 6); exec(sys.argv[1])" "$@"\n'
    )
    old.chmod(0o755)
    result = _make("check-python", PYTHON=str(old))
    assert result.returncode != 0
    assert "needs Python 3.11 or newer" in result.stderr
    assert "is 3.9" in result.stderr


def test_ci_runs_make_test_and_is_valid_bash() -> None:
    script = REPOSITORY / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert "make test" in script.read_text(encoding="utf-8")
    bash = shutil.which("bash")
    if bash is not None:
        subprocess.run([bash, "-n", script], check=True, timeout=60)
