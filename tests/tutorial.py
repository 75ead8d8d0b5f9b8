"""The domain of docs/adding_a_domain.md as a separately installed package, `my_package`."""

import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import limberjack

__all__ = ["DOMAIN", "MODULE", "TASK", "domain_text", "environment", "install"]

DOMAIN, TASK, MODULE = "swing", "swing_up", "my_package.swing"

_PAGE = Path(__file__).parents[1] / "docs" / "adding_a_domain.md"
_BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_USE, _COST, _SAFE = "## Use it\n", "## A cost for the planner\n", "## Writing it batch-safe\n"
_REGISTER = 'suite.register("swing", __name__)\n'


def domain_text() -> str:
    """The module of the domain: the page's blocks up to its use."""
    return "\n\n".join(_BLOCK.findall(_PAGE.read_text(encoding="utf-8").partition(_USE)[0]))


def _cost_text() -> str:
    page = _PAGE.read_text(encoding="utf-8")
    return _BLOCK.findall(page.partition(_COST)[2].partition(_SAFE)[0])[0]


def install(site: Path, with_entry_point: bool = True, registers: bool = True) -> None:
    """Installs the package into a directory of the module search path.

    Args:
      site: the directory.
      with_entry_point: whether its metadata names the domain.
      registers: whether the module registers itself when it is imported.
    """
    package = site / "my_package"
    package.mkdir()
    text = domain_text()
    assert _REGISTER in text
    (package / "__init__.py").write_text('"""A package with a domain."""\n', encoding="utf-8")
    text = text if registers else text.replace(_REGISTER, "")
    (package / "swing.py").write_text(text, encoding="utf-8")
    (package / "swing_cost.py").write_text(_cost_text(), encoding="utf-8")
    if with_entry_point:
        metadata = site / "my_package-1.0.dist-info"
        metadata.mkdir()
        facts = "Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n"
        (metadata / "METADATA").write_text(facts, encoding="utf-8")
        lines = f"[limberjack.domains]\n{DOMAIN} = {MODULE}\n"
        (metadata / "entry_points.txt").write_text(lines, encoding="utf-8")


def environment(folder: Path) -> Path:
    """The interpreter of a new virtual environment, into which pip has installed the package.

    Limberjack and what it needs are those of this process.

    Args:
      folder: an empty directory for the environment.
    """
    made = folder / "environment"
    venv.create(made, symlinks=sys.platform != "win32")
    python = made / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    where = {"base": str(made), "platbase": str(made)}
    site = Path(sysconfig.get_path("purelib", "venv", where))
    places = [sysconfig.get_path("purelib"), Path(limberjack.__file__).parents[1]]
    (site / "tests.pth").write_text("\n".join(map(str, places)), encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    options = ["--disable-pip-version-check", "--no-index", "--no-deps"]
    subprocess.run([*pip, *options, str(_wheel(folder))], check=True)
    return python


def _wheel(folder: Path) -> Path:
    """The package as a wheel."""
    content = folder / "content"
    content.mkdir()
    install(content)
    metadata = content / "my_package-1.0.dist-info"
    facts = "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    (metadata / "WHEEL").write_text(facts, encoding="utf-8")
    (metadata / "RECORD").touch()
    files = sorted(path for path in content.rglob("*") if path.is_file())
    names = [path.relative_to(content).as_posix() for path in files]
    (metadata / "RECORD").write_text("".join(f"{name},,\n" for name in names), encoding="utf-8")
    wheel = folder / "my_package-1.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path, name in zip(files, names, strict=True):
            archive.write(path, name)
    return wheel
