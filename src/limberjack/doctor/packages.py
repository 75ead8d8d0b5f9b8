"""What is installed, by the metadata of distributions: nothing of it is imported.

print(versions()["numpy"])
for extra in extras():
    print(extra.name, extra.missing or "installed", extra.command)
"""

import importlib.metadata
import operator
import platform
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import limberjack
from limberjack.doctor.findings import Extra

__all__ = ["clashes", "extras", "version", "versions"]

_PACKAGE = "limberjack"
# Besides Limberjack and Python: what numbers and episodes depend on.
_OTHERS = ("mujoco-core", "numpy", "gymnasium", "dm-env")

_NAME = re.compile(r"[A-Za-z0-9._-]+")
_OWN_EXTRAS = re.compile(rf"{_PACKAGE}\[([\w., -]+)\]")
_OF_EXTRA = re.compile(r"extra\s*==\s*['\"]([^'\"]+)['\"]")
_OF_PYTHON = re.compile(r"python_version\s*(<=|>=|<|>|==|!=)\s*['\"]([\d.]+)['\"]")
_COMPARISONS = {
    "<": operator.lt,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    ">=": operator.ge,
    ">": operator.gt,
}


def version(distribution: str) -> str | None:
    """The version of an installed distribution; None if there is none."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """The versions of what numbers and episodes depend on; None for what is not installed."""
    found = {name: version(name) for name in _OTHERS}
    return {_PACKAGE: limberjack.__version__, "python": platform.python_version(), **found}


def clashes() -> list[str]:
    """Installed packages that overwrite each other's files, with the remedy."""
    core, full = version("mujoco-core"), version("mujoco")
    if core is None or full is None or core == full:
        return []
    return [
        f"mujoco {full} is installed beside mujoco-core {core}: their files lie in one directory "
        "and overwrite each other. pip uninstall mujoco mujoco-core, and install Limberjack anew"
    ]


def extras() -> tuple[Extra, ...]:
    """The extras that Limberjack's metadata names, or its source where it is not installed."""
    needs = {name: set(_needed(name)) for name in _requirements()}
    return tuple(
        Extra(
            name,
            tuple(sorted(need for need in needed if version(need) is None)),
            f"pip install '{_PACKAGE}[{name}]'",
        )
        for name, needed in needs.items()
    )


def _needed(extra: str) -> Iterator[str]:
    """The distributions that an extra brings on this Python, those of extras that it names too."""
    for requirement in _requirements()[extra]:
        marker = requirement.partition(";")[2]
        if not all(_holds(*python) for python in _OF_PYTHON.findall(marker)):
            continue
        if own := _OWN_EXTRAS.match(requirement):
            for name in own[1].split(","):
                yield from _needed(name.strip())
        elif name := _NAME.match(requirement):
            yield name[0]


def _holds(comparison: str, number: str) -> bool:
    """Whether this Python's version, of two numbers, compares so."""
    wanted = tuple(int(part) for part in number.split("."))
    return _COMPARISONS[comparison](sys.version_info[: len(wanted)], wanted)


def _requirements() -> Mapping[str, list[str]]:
    """What each extra requires, in the form of the metadata."""
    try:
        of_package = importlib.metadata.metadata(_PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return _requirements_of_source()
    found = {name: [] for name in of_package.get_all("Provides-Extra") or ()}
    for requirement in of_package.get_all("Requires-Dist") or ():
        for name in _OF_EXTRA.findall(requirement.partition(";")[2]):
            found[name].append(requirement)
    return found


def _requirements_of_source() -> Mapping[str, list[str]]:
    """The same from pyproject.toml, where the package is run from its source."""
    file = Path(limberjack.__file__).parents[2] / "pyproject.toml"
    try:
        project = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    except (OSError, ValueError, KeyError):
        return {}
    return project.get("optional-dependencies", {}) if project.get("name") == _PACKAGE else {}
