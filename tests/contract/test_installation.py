"""The sdist and the wheel: built, installed outside the checkout, and run there.

Without a network, a new environment receives the wheel and, of the packages of this environment,
those alone that the wheel requires. The slow tests install with pip from the index instead, also
beside MuJoCo 3 and with other versions of Python.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import textwrap
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import limberjack
from limberjack import registry
from tests import tutorial

from .source import REPOSITORY, SOURCE

_LIMIT = 300  # seconds
_PYTHONS = ("3.11", "3.12", "3.13", "3.14")

# Loads, resets and steps a task of each domain, single and batched, and one through Gymnasium.
_PROGRAM = """
import sys
import gymnasium
import numpy as np
import limberjack
from limberjack import suite

assert limberjack.__file__.startswith(sys.prefix), limberjack.__file__
for domain, task in dict(suite.ALL_TASKS).items():
    env = suite.load(domain, task, task_kwargs={"random": 0})
    batch = suite.load_batch(domain, task, num_envs=2, seed=0)
    for each in (env, batch):
        each.reset()
        reward = each.step(np.zeros(each.action_spec().shape)).reward
        assert np.isfinite(reward).all()
    print(domain, task)
env = gymnasium.make("limberjack/humanoid-walk-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(sys.version_info[1])
"""


class _Environment:
    """A virtual environment, run outside the checkout and without this one's variables."""

    def __init__(self, root: Path, python: str = sys.executable, with_pip: bool = False) -> None:
        self.root = root
        self._with_pip = with_pip
        options = [] if with_pip else ["--without-pip"]
        _checked_run([python, "-m", "venv", *options, str(root)])
        self.python = root / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        self.site = Path(self.run("-c", "import sysconfig as s; print(s.get_path('purelib'))"))

    def run(self, *arguments: str, status: int | None = 0) -> str:
        """The output of the environment's Python; `status` is the one it must end with, if any."""
        return _checked_run([str(self.python), "-I", *arguments], self.root, status)

    def pip(self, *arguments: str) -> str:
        """The output of the environment's pip, or of this process's pip acting on it."""
        of_this = [sys.executable, "-m", "pip", "--python", str(self.python)]
        pip = [str(self.python), "-m", "pip"] if self._with_pip else of_this
        command = [*pip, "--disable-pip-version-check", *arguments]
        return _checked_run(command, self.root)


def _checked_run(command: list[str], directory: Path | None = None, status: int | None = 0) -> str:
    inherited = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
    done = subprocess.run(
        command,
        cwd=directory,
        env=inherited,
        capture_output=True,
        text=True,
        timeout=_LIMIT,
        check=False,
    )
    assert status in (None, done.returncode), f"{command}: {done.stdout}{done.stderr}"
    return done.stdout.strip()


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist of the checkout."""
    return _built("sdist", REPOSITORY, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the unpacked sdist, as installers build it."""
    unpacked = tmp_path_factory.mktemp("unpacked")
    with tarfile.open(sdist) as archive:
        archive.extractall(unpacked, filter="data")
    (source,) = unpacked.iterdir()
    return _built("wheel", source, tmp_path_factory.mktemp("wheel"))


def _built(target: str, source: Path, directory: Path) -> Path:
    pytest.importorskip("hatchling", reason="needs hatchling to build, which is not installed")
    build = ["-m", "hatchling", "build", "--target", target, "--directory", str(directory)]
    _checked_run([sys.executable, *build], source)
    (file,) = directory.iterdir()
    return file


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> _Environment:
    """An environment with the wheel and the packages that it requires, and nothing else."""
    pytest.importorskip("pip", reason="needs pip to install, which is not installed")
    environment = _Environment(tmp_path_factory.mktemp("installed") / "environment")
    environment.pip("install", "--quiet", "--no-index", "--no-deps", str(wheel))
    try:
        for name in sorted(_required(environment)):
            _lend(metadata.distribution(name), environment.site)
    except OSError as error:
        pytest.skip(f"this system gives no symbolic links: {error}")
    return environment


def _required(environment: _Environment) -> set[str]:
    """The packages that the installed wheel requires, those that these require included."""
    (own,) = metadata.distributions(name="limberjack", path=[str(environment.site)])
    waiting = list(_needs(own, ""))
    found: dict[tuple[str, str], None] = {}
    while waiting:
        requirement = waiting.pop()
        for extra in ("", *requirement.extras):
            if (requirement.name, extra) not in found:
                found[requirement.name, extra] = None
                waiting += _needs(metadata.distribution(requirement.name), extra)
    return {name for name, _ in found}


def _needs(distribution: metadata.Distribution, extra: str) -> Iterator[Requirement]:
    for requirement in map(Requirement, distribution.requires or ()):
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            yield requirement


def _lend(distribution: metadata.Distribution, site: Path) -> None:
    """Links the files of a distribution of this environment into another one."""
    for top in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
        link = site / top
        if not link.exists():
            link.symlink_to(Path(str(distribution.locate_file(top))).resolve())


def test_the_wheel_holds_every_file_of_the_package_and_its_licences(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    files = {path for path in (SOURCE / "limberjack").rglob("*") if path.is_file()}
    ours = {
        path.relative_to(SOURCE).as_posix() for path in files if path.parent.name != "__pycache__"
    }
    assert "limberjack/suite/humanoid.xml" in ours
    assert {name for name in names if ".dist-info/" not in name} == ours
    licences = {name.rpartition("/")[2] for name in names if ".dist-info/licenses/" in name}
    assert licences == {"LICENSE", "NOTICE"}


def test_the_installed_package_requires_nothing_that_it_does_not_name(
    installed: _Environment,
) -> None:
    assert "No broken requirements found" in installed.pip("check")


def test_the_installed_package_steps_each_domain(installed: _Environment) -> None:
    output = installed.run("-W", "error", "-c", _PROGRAM).splitlines()
    assert {line.split()[0] for line in output[:-1]} == {row.domain for row in registry.TASKS}


def test_the_installed_command_lists_the_tasks_and_its_version(installed: _Environment) -> None:
    command = shutil.which("limberjack", path=str(installed.python.parent))
    assert command is not None
    directory = installed.root
    assert _checked_run([command, "--version"], directory).endswith(limberjack.__version__)
    assert "run_pure_state" in _checked_run([command, "list"], directory)


def test_an_extra_that_is_not_installed_is_an_error_with_its_packages(
    installed: _Environment,
) -> None:
    program = """
    from limberjack.utils.ffmpeg import find_ffmpeg
    try:
        find_ffmpeg()
    except ImportError as error:
        print(error)
    """
    assert installed.run("-c", textwrap.dedent(program)).endswith(
        "pip install imageio-ffmpeg matplotlib pillow"
    )


def test_the_installed_package_finds_the_domains_of_others_by_their_entry_points(
    installed: _Environment,
) -> None:
    tutorial.install(installed.site)
    try:
        listed = installed.run("-m", "limberjack", "list")
    finally:
        shutil.rmtree(installed.site / "my_package")
        shutil.rmtree(installed.site / "my_package-1.0.dist-info")
    assert tutorial.TASK in listed
    assert tutorial.TASK not in installed.run("-m", "limberjack", "list")


# With pip, from the index: `make test-slow`.


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Skips where pip reaches no package index."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "dm-env"]
    done = subprocess.run(
        command,
        cwd=tmp_path_factory.mktemp("index"),
        capture_output=True,
        text=True,
        timeout=_LIMIT,
    )
    if done.returncode != 0:
        pytest.skip(f"pip reaches no package index: {done.stderr.strip().splitlines()[-1:]}")


def _python(version: str) -> str:
    """The interpreter of a version; skips where there is none."""
    if version == ".".join(map(str, sys.version_info[:2])):
        return sys.executable
    found = shutil.which(f"python{version}")
    if found is None or subprocess.run([found, "-c", ""], capture_output=True).returncode != 0:
        pytest.skip(f"there is no Python {version} here")
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("index")
@pytest.mark.parametrize("version", _PYTHONS)
def test_pip_installs_the_wheel_with_all_that_it_requires(
    version: str, wheel: Path, tmp_path: Path
) -> None:
    environment = _Environment(tmp_path / "environment", _python(version), with_pip=True)
    environment.pip("install", "--quiet", str(wheel))
    assert "No broken requirements found" in environment.pip("check")
    output = environment.run("-c", _PROGRAM).splitlines()
    assert output[-1] == version.partition(".")[2]
    assert "run_pure_state" in environment.run("-m", "limberjack", "list")
    _assert_told(environment)


def _assert_told(environment: _Environment) -> None:
    """The number of packages and their size on the disk are those that README tells."""
    readme = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    ((packages, megabytes),) = re.findall(r"(\d+) packages, (\d+) MB", readme)
    own = {"pip", "setuptools", "limberjack"}
    names = {path.name.partition("-")[0] for path in environment.site.glob("*.dist-info")}
    assert len(names - own) == int(packages)
    files = [path for path in environment.site.rglob("*") if path.is_file()]
    counted = [f for f in files if f.relative_to(environment.site).parts[0] not in own]
    blocks = sum(file.stat().st_blocks * 512 for file in counted)
    # Other versions of packages, and other file systems, have other sizes.
    assert blocks / 1e6 == pytest.approx(int(megabytes), rel=0.1)


_IMPORT = "import mujoco; print(mujoco.__version__)"


@pytest.fixture
def with_mujoco_3(index: None, tmp_path: Path) -> _Environment:
    """An environment with MuJoCo 3, as Gymnasium brings it."""
    environment = _Environment(tmp_path / "environment", with_pip=True)
    environment.pip("install", "--quiet", "gymnasium[mujoco]", "mujoco<4")
    assert environment.run("-c", _IMPORT).startswith("3.")
    return environment


def _assert_consistent(environment: _Environment) -> None:
    assert environment.run("-c", _IMPORT).startswith("4.")
    assert "No broken requirements found" in environment.pip("check")
    assert environment.run("-W", "error", "-c", _PROGRAM)
    found = json.loads(environment.run("-m", "limberjack", "doctor", "--json"))
    assert found["core"]["works"]
    assert not [problem for problem in found["problems"] if "MuJoCo" in problem]


@pytest.mark.slow
def test_after_mujoco_3_is_removed_an_installation_is_consistent(
    with_mujoco_3: _Environment, wheel: Path
) -> None:
    assert "pip uninstall -y mujoco`" in (REPOSITORY / "docs" / "install.md").read_text(
        encoding="utf-8"
    )
    with_mujoco_3.pip("uninstall", "--quiet", "-y", "mujoco")
    with_mujoco_3.pip("install", "--quiet", str(wheel))
    _assert_consistent(with_mujoco_3)


@pytest.mark.slow
def test_an_installation_over_mujoco_3_is_consistent_or_names_the_commands_that_repair_it(
    with_mujoco_3: _Environment, wheel: Path
) -> None:
    # pip installs mujoco-core 4 first; then, with mujoco 3, it removes the files that both have.
    with_mujoco_3.pip("install", "--quiet", str(wheel))
    diagnosis = json.loads(with_mujoco_3.run("-m", "limberjack", "doctor", "--json", status=None))
    if not diagnosis["core"]["works"]:
        (problem,) = diagnosis["problems"]
        assert re.search(r"lacks \d+ of its files", problem)
        commands = re.findall(r"pip (uninstall [^;]*|install '[^']*')", problem)
        assert len(commands) == 2
        for command in commands:
            with_mujoco_3.pip(*shlex.split(command))
    _assert_consistent(with_mujoco_3)
