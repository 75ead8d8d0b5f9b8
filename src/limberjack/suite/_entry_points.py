"""Domains of installed packages, from the entry-point group `limberjack.domains`.

    [project.entry-points."limberjack.domains"]
    swing = "my_package.swing"

Reading the metadata of all installed packages takes milliseconds, so it happens only to find an
unknown name or to list everything, never at import.
"""

from importlib import metadata

__all__ = ["GROUP", "installed", "module_of"]

GROUP = "limberjack.domains"


def installed() -> dict[str, list[str]]:
    """Dotted module names by domain; more than one if packages conflict."""
    found: dict[str, list[str]] = {}
    for entry_point in metadata.entry_points(group=GROUP):
        modules = found.setdefault(entry_point.name, [])
        if entry_point.value not in modules:
            modules.append(entry_point.value)
    return dict(sorted(found.items()))


def module_of(name: str) -> str | None:
    """Dotted module name of a domain; None if no installed package provides it.

    Raises:
      ValueError: several packages provide a domain with this name.
    """
    modules = installed().get(name, [])
    if len(modules) > 1:
        raise ValueError(
            f"domain {name!r} is in several installed packages: {', '.join(modules)}; uninstall "
            "all but one, or register one of them under another name with suite.register"
        )
    return modules[0] if modules else None
