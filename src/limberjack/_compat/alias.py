"""Every module of Limberjack under the name of its counterpart in dm_control.

Two finders on `sys.meta_path` do it. The first, before all others, answers for `dm_control` and
what is below it with the module of Limberjack itself, so nothing is ever loaded twice and no other
finder is asked. The last, after all others, answers for what Limberjack does not have: a stand-in
for the parts of dm_control that are not built, and for all else an error that says what there is.
"""

import importlib
import importlib.util
import pkgutil
import sys
import threading
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

import limberjack
from limberjack._compat import stand_ins
from limberjack.utils.suggest import did_you_mean

__all__ = ["install"]

_ALIAS = "dm_control"
_REAL = "limberjack"
_lock = threading.Lock()


def install() -> None:
    """Installs both finders; see `limberjack.install_as_dm_control`."""
    with _lock:
        _refuse_genuine()
        if sys.modules.get(_ALIAS, limberjack) is None:  # somebody blocked its import
            del sys.modules[_ALIAS]
        _place_finders()
        if sys.modules.setdefault(_ALIAS, limberjack) is not limberjack:
            # Another thread began to import the genuine one after the look above.
            _remove_finders()
            _refuse_genuine()


def _refuse_genuine() -> None:
    """Raises if a module named dm_control or below it is not Limberjack's."""
    foreign = [
        module
        for name, module in list(sys.modules.items())
        if _is_below(name, _ALIAS)
        and module is not None
        and module is not sys.modules.get(_real_name(name))
    ]
    if foreign:
        origin = getattr(foreign[0], "__file__", None) or "an unknown place"
        raise RuntimeError(
            f"dm_control is already imported, from {origin} ({len(foreign)} modules), and cannot "
            "be replaced: call limberjack.install_as_dm_control() before anything imports "
            "dm_control, at the top of the program. Nothing was changed."
        )


def _place_finders() -> None:
    """Puts the finders first and last on `sys.meta_path`; at no time is one that was there missing.

    Meanwhile other threads may import.
    """
    finders = sys.meta_path
    if finders[0] is not _alias_finder:
        finders.insert(0, _alias_finder)
        if _alias_finder in finders[1:]:
            del finders[finders.index(_alias_finder, 1)]
    if finders[-1] is not _last_finder:
        finders.append(_last_finder)
        if _last_finder in finders[:-1]:
            finders.remove(_last_finder)


def _remove_finders() -> None:
    """Takes both finders off `sys.meta_path`."""
    for finder in (_alias_finder, _last_finder):
        sys.meta_path.remove(finder)


class _AliasLoader(Loader):
    """Loads a module of Limberjack, by its own name, as the module that was asked for."""

    def __init__(self, real_name: str) -> None:
        self.real_name = real_name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The one module, imported if it was not."""
        module = importlib.import_module(self.real_name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Nothing is executed again; the spec that the import system has just set is taken back."""
        module.__spec__ = self._spec


class _AliasSpec(ModuleSpec):
    """The spec of an alias, whose package is that of the real module.

    The import system sets it on the module for a moment, in which another thread may resolve a
    relative import there.
    """

    @property
    def parent(self) -> str:
        """The package that relative imports in the module start from."""
        assert isinstance(self.loader, _AliasLoader)
        is_package = self.submodule_search_locations is not None
        return self.loader.real_name if is_package else self.loader.real_name.rpartition(".")[0]


class _AliasFinder(MetaPathFinder):
    """Finds `dm_control` and what is below it in Limberjack, or nowhere."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of Limberjack's module; else an error, or None for a mere search."""
        if not _is_below(fullname, _ALIAS):
            return None
        real_name = _real_name(fullname)
        real = importlib.util.find_spec(real_name)
        if real is None:
            if _importing() or self._is_found_elsewhere(fullname, path):
                raise ModuleNotFoundError(_missing(fullname, real_name), name=fullname)
            return None
        spec = _AliasSpec(fullname, _AliasLoader(real_name), origin=real.origin)
        spec.submodule_search_locations = real.submodule_search_locations
        return spec

    def _is_found_elsewhere(self, fullname: str, path: Sequence[str] | None) -> bool:
        """Whether another finder would answer, as that of an editable dm_control does."""
        others = [finder for finder in sys.meta_path if finder is not self]
        return any(
            find_spec(fullname, path) is not None
            for other in others
            if (find_spec := getattr(other, "find_spec", None)) is not None
        )


class _LastFinder(MetaPathFinder):
    """Answers for the modules below `limberjack` that no other finder has found.

    `from dm_control import composer` looks for `limberjack.composer`, since that is the package's
    own name.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The spec of a stand-in; else an error, or None for a mere search."""
        if not fullname.startswith(f"{_REAL}."):
            return None
        if stand_ins.is_stand_in(fullname.removeprefix(f"{_REAL}.")):
            return ModuleSpec(fullname, stand_ins.StandInLoader(), is_package=True)
        if _importing():
            # Not `name=fullname`: `from package import name` swallows an error of that name.
            alias = _ALIAS + fullname.removeprefix(_REAL)
            raise ModuleNotFoundError(_missing(fullname, fullname), name=alias)
        return None


_alias_finder = _AliasFinder()
_last_finder = _LastFinder()


def _is_below(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def _real_name(alias: str) -> str:
    return _REAL + alias.removeprefix(_ALIAS)


def _importing() -> bool:
    """Whether the calling finder was asked by an import, which deserves an error that says why.

    A search, as by `importlib.util.find_spec`, must get None for a module that is not there, and
    finders are not told which of the two it is. Where Python's import system renames the function
    looked for here, imports fail with Python's own plain message.
    """
    try:
        asking = sys._getframe(3)  # this function, the finder, importlib's _find_spec
    except ValueError:
        return False
    return asking.f_code.co_name == "_find_and_load_unlocked"


def _missing(asked: str, real_name: str) -> str:
    """What to say about a module, asked for by either name, that is not built nor stood in for."""
    package_name, _, name = real_name.rpartition(".")
    below = real_name.removeprefix(f"{_REAL}.")
    package = sys.modules.get(package_name)
    choices = {module.name for module in pkgutil.iter_modules(getattr(package, "__path__", []))}
    choices.update(vars(package) if package is not None else ())
    domains = ""
    if package_name == f"{_REAL}.suite":
        built = ", ".join(getattr(package, "TASKS_BY_DOMAIN", ()))
        domains = f" The domains that it has are {built}."
    hint = did_you_mean(name, [choice for choice in choices if not choice.startswith("_")])
    return (
        f"No module named {asked!r}: limberjack, which stands in for dm_control here, has no "
        f"{below!r}.{hint}{domains} {stand_ins.WHERE_TO_FIND_IT}"
    )
