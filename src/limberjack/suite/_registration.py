"""User domains: registration, discovery of installed ones, and pickling.

    suite.register("swing", "my_package.swing")

`registry` stores the domains, this module decides what may be registered, and `_checks` validates
the module itself.
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
    """Adds a domain, which then works wherever a domain's name is accepted.

    The domain can be loaded by `suite.load` and `load_batch`, gets Gymnasium ids, and appears in
    `ALL_TASKS`, `EXTRA`, `TASKS_BY_DOMAIN` and `REWARD_VIZ` (or `NO_REWARD_VIZ`). Registering the
    same module again has no effect. A module may register itself in its last line:

        suite.register("swing", __name__)

    Args:
      name: a Python identifier not used by another domain.
      module: the module, or its dotted name; docs/adding_a_domain.md describes its contents.

    Raises:
      TypeError: `module` is neither a module nor a string.
      ValueError: the name is taken or not an identifier, or the module is incomplete; the message
        lists all problems.
      ImportError: there is no module with this name.
    """
    loaded = importlib.import_module(module) if isinstance(module, str) else module
    if not isinstance(loaded, ModuleType):
        raise TypeError(f"module is {module!r}; expected a module, or its dotted name")
    known = registry.domains().get(name)
    if known is not None:
        if known.module not in (loaded, registry.import_name_of(loaded)):
            raise ValueError(_taken(known, loaded.__name__))
        if known.source in ("suite", "registered"):
            return
    rows = _checks.rows_of(name, loaded)
    registry.add(Domain(name, _by_name(loaded), rows, source="registered"))


def unregister(name: str) -> None:
    """Removes a domain that was registered, assigned or discovered; its module stays imported.

    Raises:
      ValueError: there is no such domain, or it belongs to the suite.
    """
    known = registry.domains().get(name)
    if known is None:
        raise ValueError(f"there is no domain {name!r} to unregister")
    if known.source == "suite":
        raise ValueError(f"domain {name!r} belongs to the suite; only other domains can be removed")
    registry.remove(name)


def find(name: str) -> Domain | None:
    """The domain with this name, including those of installed packages; None if there is none.

    Raises:
      ValueError: several installed packages provide it, or its module cannot be imported or is
        incomplete.
    """
    known = registry.domains().get(name)
    if known is not None or not isinstance(name, str):
        return known
    # Imported lazily: rarely needed, and slow to import.
    from limberjack.suite import _entry_points as entry_points

    module = entry_points.module_of(name)
    if module is None:
        return None
    try:
        loaded = importlib.import_module(module)
    except ImportError as error:
        raise ValueError(
            f"domain {name!r} is provided by {module}, from an installed package, which cannot be "
            f"imported: {error}"
        ) from error
    if name not in registry.domains():  # unless the module has registered itself
        rows = _checks.rows_of(name, loaded)
        registry.add(Domain(name, module, rows, source="installed"))
    return registry.domains()[name]


def find_installed() -> dict[str, str]:
    """Discovers the domains of all installed packages; returns problems of failed ones by name."""
    from limberjack.suite import _entry_points as entry_points

    problems = {}
    for name, modules in entry_points.installed().items():
        known = registry.domains().get(name)
        if known is not None and known.source == "suite":
            problems[name] = f"{', '.join(modules)}: the name belongs to the suite"
            continue
        try:
            find(name)
        except Exception as error:  # a user's package may raise anything; continue with the others
            problems[name] = f"{', '.join(modules)}: {' '.join(str(error).split())}"
    return problems


def require(name: str, module: str) -> None:
    """Makes sure that a domain is registered under this name with this module.

    Raises:
      ValueError: the name belongs to another module in this process.
      ImportError: the module cannot be imported in this process.
    """
    known = registry.domains().get(name)
    if known is None:
        loaded = importlib.import_module(module)
        if name not in registry.domains():
            try:
                register(name, loaded)
            except ValueError:  # an assigned domain need not pass the checks, in any process
                Domains()[name] = loaded
        known = registry.domains()[name]
    if known.import_name != module:
        raise ValueError(_taken(known, module))


class Registration:
    """The domain of an environment; unpickling imports and registers its module."""

    def __init__(self, name: str, module: str) -> None:
        """Stores the name of the domain and the dotted name of its module."""
        self.name = name
        self.module = module

    def __deepcopy__(self, memo: object) -> "Registration":
        return self

    def __reduce__(self) -> tuple[object, ...]:
        return _registered, (self.name, self.module)


def registration_of(name: str) -> Registration | registry.NotImportable:
    """The registration of a known domain."""
    module = registry.domains()[name].import_name
    return registry.NotImportable(name) if module is None else Registration(name, module)


def _registered(name: str, module: str) -> Registration:
    """Unpickles a `Registration`, and registers its domain."""
    require(name, module)
    return Registration(name, module)


class Domains(MutableMapping[str, ModuleType]):
    """The registry as dm_control's `suite._DOMAINS`: modules by name, imported when read.

    Assigning a module replaces any domain of that name without validation, as in dm_control, and
    does not change the constants.
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
    """The dotted name of a module if it can be imported by name, otherwise the module."""
    return registry.import_name_of(module) or module


def _taken(known: Domain, module: str) -> str:
    """Error message for a domain name that is taken, with advice for `module`."""
    owner = known.import_name or known.load().__name__
    advice = f"give {module} another name"
    if known.source == "suite":
        return f"domain name {known.name!r} belongs to the suite, as {owner}; {advice}"
    return (
        f"domain name {known.name!r} is registered already, as {owner}; {advice}, or call "
        f"suite.unregister({known.name!r}) first"
    )
