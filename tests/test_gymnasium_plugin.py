"""A hook left behind by an older installation is harmless: see `_gymnasium_plugin`."""

import site
import subprocess
import sys
from pathlib import Path

import pytest

import limberjack
from tests.programs import run

_HOOK = "import limberjack._gymnasium_plugin\n"
_SOURCE = Path(limberjack.__file__).parents[1]
# Run in a Python without site-packages, as if these directories were all that it has.
_START = f"""
import site, sys
sys.path.insert(0, {str(_SOURCE)!r})
before = set(sys.modules)
site.addsitedir({{directory!r}})  # what Python does at its start with every site directory
"""
_AFTERWARDS = f"""
for directory in {[*site.getsitepackages()]!r}:
    sys.path.append(directory)
"""


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """A site directory with the hook."""
    (tmp_path / "limberjack-gymnasium.pth").write_text(_HOOK)
    return tmp_path


def _run_without_site(directory: Path, program: str) -> str:
    code = _START.format(directory=str(directory)) + program
    arguments = [sys.executable, "-I", "-S", "-W", "error", "-c", code]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_python_starts_silently_and_imports_nothing(directory: Path) -> None:
    program = """
try:
    import sitecustomize  # the next thing that Python looks for
except ImportError:
    pass
loaded = {name.partition(".")[0] for name in set(sys.modules) - before}
print({"gymnasium", "limberjack", "numpy", "mujoco"} & loaded)
print([finder for finder in sys.meta_path if "limberjack" in type(finder).__module__])
"""
    assert _run_without_site(directory, program) == "set()\n[]\n"


@pytest.mark.parametrize("between", ["", "import colorsys"])
def test_a_later_import_registers(directory: Path, between: str) -> None:
    program = f"""{_AFTERWARDS}
{between}
import limberjack.suite
import gymnasium
print("limberjack/humanoid-walk-v0" in gymnasium.registry, limberjack.suite.ALL_TASKS[0][0])
"""
    assert _run_without_site(directory, program) == "True acrobot\n"


def test_a_hook_that_runs_after_the_import_changes_nothing(directory: Path) -> None:
    printed = run(
        f"""
        import site, sys
        import limberjack
        site.addsitedir({str(directory)!r})
        import colorsys
        assert sys.modules["limberjack"] is limberjack
        import gymnasium
        print("limberjack/humanoid-walk-v0" in gymnasium.registry)
        """
    )
    assert printed == "True\n"


def test_a_site_customisation_that_imports_the_package_gets_all_of_it(directory: Path) -> None:
    (directory / "sitecustomize.py").write_text("import limberjack\n")
    program = f"""{_AFTERWARDS}
sys.path.insert(0, {str(directory)!r})
site.execsitecustomize()
assert "sitecustomize" in sys.modules
print("limberjack/humanoid-walk-v0" in sys.modules["gymnasium"].registry)
"""
    assert _run_without_site(directory, program) == "True\n"
