"""Installed packages, read from their metadata: none of them is imported.

print(versions()["numpy"])
for extra in extras():
    print(extra.name, extra.missing or "installed", extra.command)
"""

import dataclasses
import importlib.metadata
import os
import platform
from collections.abc import Iterator

import limberjack
from limberjack.utils.requirements import (
    MUJOCO_DISTRIBUTIONS,
    PACKAGES,
    broken_mujoco,
    install_command,
)

__all__ = ["Extra", "clashes", "extras", "version", "versions"]

# Besides Limberjack and Python: the packages that numbers and episodes depend on.
_OTHERS = ("mujoco", "numpy", "gymnasium", "dm-env")


@dataclasses.dataclass(frozen=True)
class Extra:
    """An optional feature of Limberjack and the packages that it needs."""

    name: str
    missing: tuple[str, ...]  # packages that are not installed
    command: str  # installs the packages of this extra

    @property
    def is_installed(self) -> bool:
        """Whether all packages of the extra are installed."""
        return not self.missing


def version(distribution: str) -> str | None:
    """The version of an installed distribution; None if it is not installed."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def versions() -> dict[str, str | None]:
    """The versions of what numbers and episodes depend on; None for what is not installed."""
    found = {name: version(name) for name in _OTHERS}
    return {"limberjack": limberjack.__version__, "python": platform.python_version(), **found}


def clashes() -> list[str]:
    """Problems with installed files, each with the commands that help.

    MuJoCo's packages share one folder; files of Limberjack may have been lost as those of any.
    """
    found = {name: version(name) for name in MUJOCO_DISTRIBUTIONS}
    installed = {name: number for name, number in found.items() if number is not None}
    if len(set(installed.values())) > 1:
        listed = ", ".join(f"{name} {number}" for name, number in installed.items())
        why = (
            f"{listed} are installed together: they share a folder and overwrite each other's files"
        )
        return [str(broken_mujoco(why))]
    lost = [name for distribution in installed for name in _lost_files(distribution)]
    if lost:
        why = f"MuJoCo {found['mujoco']} lacks {len(lost)} of its files, such as {lost[0]}"
        return [str(broken_mujoco(why))]
    lost = list(_lost_files("limberjack")) if version("limberjack") else []
    if lost:
        return [
            f"Limberjack lacks {len(lost)} of its files, such as {lost[0]}: uninstall it with "
            "`pip uninstall limberjack`, and install it again as before"
        ]
    return []


def extras() -> tuple[Extra, ...]:
    """Each extra, with the packages that are missing and the command that installs them."""
    return tuple(
        Extra(
            name,
            tuple(package for package in packages if version(package.partition("[")[0]) is None),
            install_command(name),
        )
        for name, packages in PACKAGES.items()
    )


def _lost_files(distribution: str) -> Iterator[str]:
    """Recorded files of an installed distribution that do not exist; bytecode does not count."""
    for file in importlib.metadata.files(distribution) or ():
        if file.suffix != ".pyc" and not os.path.exists(file.locate()):
            yield file.as_posix()
