"""Domains beside the suite's own: registering, finding installed ones, and sending them elsewhere.

    suite.register("swing", "my_package.swing")

`registry` holds the names; this module decides what may be registered. `_checks` looks at the
module itself.
"""

import importlib
from collections.abc import Iterator, MutableMapping
from types import ModuleType

from limberjack import registry
from limberjack.registry import Domain, Row
from limberjack.suite import _checks

__all__ = [
    "Domains",
    "Registration",
    "find",
    "find_installed",
    "register",
    "registration_of",
    "require",
    "unregister",
]


def register(name: str, module: ModuleType | str) -> None:
    """Adds a domain, which everything that takes a domain's name knows from then on.

    The domain is loaded by `suite.load` and `load_batch`, has Gymnasium's ids, and stands in
    `ALL_TASKS`, `EXTRA`, `TASKS_BY_DOMAIN` and `REWARD_VIZ` (or `NO_REWARD_VIZ`). Registering the
    same module again changes nothing. A module may register itself, in its last line:

        suite.register("swing", __name__)

    Args:
      name: a Python identifier that no other domain has.
      module: the module, or its dotted name; see docs/adding_a_domain.md for what it defines.

    Raises:
      TypeError: `module` is neither.
      ValueError: the name is taken or no identifier, or the module lacks something; the message
        has everything that is wrong with it.
      ImportError: there is no module of that name.
    """
    loaded = importlib.import_module(module) if isinstance(module, str) else module
    if not isinstance(loaded, ModuleType):
        raise TypeError(f"module is {module!r}; expected a module, or its name in dots")
    known = registry.domains().get(name)
    if known is not None:
        if known.module not in (loaded, registry.import_name_of(loaded)):
            raise ValueError(_taken(known, loaded.__name__))
        if known.source in ("suite", "registered"):
            return
    rows = _checks.rows_of(name, loaded)
    registry.add(Domain(name, _by_name(loaded), rows, source="registered"))


def unregister(name: str) -> None:
    """Removes a domain that was registered, assigned or found; its module stays imported.

    Raises:
      ValueError: there is no such domain, or it is one of the suite's own.
    """
    known = registry.domains().get(name)
    if known is None:
        raise ValueError(f"there is no domain {name!r} to unregister")
    if known.source == "suite":
        raise ValueError(f"domain {name!r} is the suite's own; only registered ones can be removed")
    registry.remove(name)


def find(name: str) -> Domain | None:
    """The domain of that name, also one of an installed package; None if there is none.

    Raises:
      ValueError: several installed packages have it, or the module of the one that has it cannot
        be imported or lacks something.
    """
    known = registry.domains().get(name)
    if known is not None or not isinstance(name, str):
        return known
    # Imported here: reading packages' metadata is rarely needed, and slow to import.
    from limberjack.suite import _entry_points as entry_points

    module = entry_points.module_of(name)
    if module is None:
        return None
    try:
        loaded = importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"domain {name!r} is {module}, of an installed package, which cannot be imported: "
            f"{error}"
        ) from error
    if name not in registry.domains():  # else it has registered itself
        rows = _checks.rows_of(name, loaded)
        registry.add(Domain(name, module, rows, source="installed"))
    return registry.domains()[name]


def find_installed() -> dict[str, str]:
    """Finds the domains of all installed packages; what is wrong with those that fail, by name."""
    from limberjack.suite import _entry_points as entry_points

    problems = {}
    for name, modules in entry_points.installed().items():
        known = registry.domains().get(name)
        if known is not None and known.source == "suite":
            problems[name] = f"{', '.join(modules)}: the name belongs to the suite"
            continue
        try:
            find(name)
        except Exception as error:  # of somebody's package: the others are still listed
            problems[name] = f"{', '.join(modules)}: {' '.join(str(error).split())}"
    return problems


def require(name: str, module: str) -> None:
    """Makes sure that a domain is known under its name and is that module.

    Raises:
      ValueError: another module has that name here.
      ImportError: the module cannot be imported here.
    """
    known = registry.domains().get(name)
    if known is None:
        loaded = importlib.import_module(module)
        if name not in registry.domains():
            try:
                register(name, loaded)
            except ValueError:  # as where it comes from: what is assigned need not pass the checks
                Domains()[name] = loaded
        known = registry.domains()[name]
    if known.import_name != module:
        raise ValueError(_taken(known, module))


class Registration:
    """The domain that an environment comes from; unpickled, it imports and registers its module."""

    def __init__(self, name: str, module: str) -> None:
        """Takes the name of the domain and the dotted name of its module."""
        self.name = name
        self.module = module

    def __deepcopy__(self, memo: object) -> "Registration":
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return _registered, (self.name, self.module)


def registration_of(name: str) -> Registration | registry.NotImportable:
    """The registration of a domain that is known."""
    module = registry.domains()[name].import_name
    return registry.NotImportable(name) if module is None else Registration(name, module)


def _registered(name: str, module: str) -> Registration:
    """A `Registration` as it is unpickled: its domain is known afterwards."""
    require(name, module)
    return Registration(name, module)


class Domains(MutableMapping[str, ModuleType]):
    """The registry as dm_control's `suite._DOMAINS`: modules by name; reading one imports it.

    Assigning a module replaces any domain of that name, unchecked, as in dm_control, and changes
    no constant.
    """

    def __getitem__(self, name: str) -> ModuleType:
        return registry.domains()[name].load()

    def __setitem__(self, name: str, module: ModuleType) -> None:
        if not hasattr(module, "SUITE"):
            raise TypeError(f"_DOMAINS[{name!r}] is {module!r}; expected a module with a SUITE")
        suite = module.SUITE
        tagged = {tag: suite.tagged(tag) for tag in getattr(suite, "tags", list)()}
        rows = tuple(
            Row(name, task, tuple(tag for tag, tasks in tagged.items() if task in tasks), None, 0)
            for task in suite
        )
        registry.add(Domain(name, _by_name(module), rows, source="assigned"))

    def __delitem__(self, name: str) -> None:
        registry.remove(name)

    def __contains__(self, name: object) -> bool:
        return name in registry.domains()

    def __iter__(self) -> Iterator[str]:
        return iter(list(registry.domains()))

    def __len__(self) -> int:
        return len(registry.domains())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({list(self)})"


def _by_name(module: ModuleType) -> ModuleType | str:
    """The dotted name of a module that can be imported by it, else the module."""
    return registry.import_name_of(module) or module


def _taken(known: Domain, module: str) -> str:
    """The message that the name of a domain is taken, and `module` must have another one."""
    owner = known.import_name or known.load().__name__
    advice = f"give {module} another name"
    if known.source == "suite":
        return f"domain name {known.name!r} belongs to the suite, as {owner}; {advice}"
    return (
        f"domain name {known.name!r} is registered already, as {owner}; {advice}, or call "
        f"suite.unregister({known.name!r}) first"
    )
