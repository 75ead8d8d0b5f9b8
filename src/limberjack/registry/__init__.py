"""Registry of domains: their names and the modules that define them.

    registry.domains()["humanoid"].import_name    # 'limberjack.suite.humanoid'
    registry.steps("humanoid", "walk")            # 1000, from a generated table

It initially holds the suite's own domains, described by `table.py` so that a domain is imported
only on first use. `limberjack.suite` adds others; `limberjack.gym` and `limberjack.suite` listen
for changes. The registry imports neither NumPy nor MuJoCo, and neither validates domains nor loads
environments: `limberjack.suite.register` does that.
"""

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

from limberjack.registry.domain import Domain, NotImportable, Row, import_name_of
from limberjack.registry.table import TASKS

__all__ = [
    "TASKS",
    "Domain",
    "NotImportable",
    "Row",
    "add",
    "by_domain",
    "domains",
    "import_name_of",
    "listen",
    "remove",
    "steps",
    "suite_module",
]

_SUITE = "limberjack.suite"

# Called with a domain and whether it was added (True) or removed (False).
_Listener = Callable[[Domain, bool], None]

_domains: dict[str, Domain] = {}
_listeners: list[_Listener] = []


def by_domain(tasks: Iterable[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """The names of the tasks of each domain, from (domain, task) pairs."""
    found: dict[str, list[str]] = {}
    for domain, task in tasks:
        found.setdefault(domain, []).append(task)
    return {domain: tuple(names) for domain, names in found.items()}


def domains() -> Mapping[str, Domain]:
    """Live, read-only view of all domains by name."""
    return MappingProxyType(_domains)


def steps(domain: str, task: str) -> int | None:
    """Steps per episode; None if there is no time limit or the length is unknown."""
    known = _domains.get(domain)
    rows = {row.task: row.steps for row in known.rows} if known is not None else {}
    return rows.get(task)


def suite_module(domain: str) -> str:
    """The dotted name of a module of the suite."""
    return f"{_SUITE}.{domain}"


def add(domain: Domain) -> None:
    """Adds a domain, replacing any of the same name, and notifies all listeners."""
    if domain.name in _domains:
        remove(domain.name)
    _domains[domain.name] = domain
    for listener in _listeners:
        listener(domain, True)


def remove(name: str) -> None:
    """Removes a domain and notifies all listeners; raises KeyError if it does not exist."""
    domain = _domains.pop(name)
    for listener in _listeners:
        listener(domain, False)


def listen(listener: _Listener) -> None:
    """Calls a listener for every domain registered now and on every later change."""
    _listeners.append(listener)
    for domain in list(_domains.values()):
        listener(domain, True)


def _add_suite() -> None:
    for name in by_domain((row.domain, row.task) for row in TASKS):
        rows = tuple(row for row in TASKS if row.domain == name)
        add(Domain(name, suite_module(name), rows, source="suite"))


_add_suite()
