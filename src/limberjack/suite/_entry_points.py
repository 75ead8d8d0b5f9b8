"""The domains of installed packages, by the entry-point group `limberjack.domains`.

    [project.entry-points."limberjack.domains"]
    swing = "my_package.swing"

Reading the metadata of all installed packages takes milliseconds, so it is done only when a name
is missing, and to list everything; never at import.
"""

from importlib import metadata

__all__ = ["GROUP", "installed", "module_of"]

GROUP = "limberjack.domains"


def installed() -> dict[str, list[str]]:
    """Dotted names of modules by the name of the domain; more than one where packages conflict."""
    found: dict[str, list[str]] = {}
    for entry_point in metadata.entry_points(group=GROUP):
        modules = found.setdefault(entry_point.name, [])
        if entry_point.value not in modules:
            modules.append(entry_point.value)
    return dict(sorted(found.items()))


def module_of(name: str) -> str | None:
    """The dotted name of the module of a domain; None if no installed package has it.

    Raises:
      ValueError: several packages have a domain of that name.
    """
    modules = installed().get(name, [])
    if len(modules) > 1:
        raise ValueError(
            f"domain {name!r} is in several installed packages: {', '.join(modules)}; uninstall "
            "all but one, or register one of them under another name with suite.register"
        )
    return modules[0] if modules else None
