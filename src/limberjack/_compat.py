"""Import machinery behind `limberjack.install_as_dm_control`.

Every Limberjack module gets the name of its dm_control counterpart too. This takes two finders on
`sys.meta_path`. The first, ahead of all others, resolves `dm_control` and its submodules to the
Limberjack module itself, so no module is loaded twice and no other finder is consulted. The last,
after all others, handles modules that Limberjack lacks: a stand-in for the parts of dm_control that
are not implemented, otherwise an error that lists what is available.

Many programs, above all bridges to other libraries, import those parts along with the suite, use
their classes in annotations and in checks such as `isinstance(env, composer.Environment)`, and then
run a suite task. Importing the parts therefore works, submodules included; every public attribute
is a class without instances; anything that needs the real class (a call, a subclass, a loop) raises
NotImplementedError.
"""

import abc
import collections
import importlib
import importlib.util
import pkgutil
import sys
import threading
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import NoReturn

import limberjack
from limberjack.utils.suggest import did_you_mean

__all__ = ["install"]

_ALIAS = "dm_control"
_REAL = "limberjack"
_lock = threading.Lock()

_WHERE_TO_FIND_IT = (
    "To use it, install dm_control itself in a separate environment, without "
    "limberjack.install_as_dm_control()."
)

# Below dm_control, each with all its submodules. Modules that Limberjack has take precedence.
_NOT_BUILT = (
    "composer",
    "entities",
    "locomotion",
    "manipulation",
    "mjcf",
    "suite.wrappers.mujoco_profiling",
    "viewer",  # its submodules only: Limberjack has the module itself
)

_made: dict[str, "_StandInClass"] = {}


def install() -> None:
    """Installs both finders; see `limberjack.install_as_dm_control`."""
    with _lock:
        _refuse_genuine()
        if sys.modules.get(_ALIAS, limberjack) is None:  # the program blocked its import
            del sys.modules[_ALIAS]
        _place_finders()
        if sys.modules.setdefault(_ALIAS, limberjack) is not limberjack:
            # Another thread began to import the real dm_control after the check above.
            for finder in (_alias_finder, _last_finder):
                sys.meta_path.remove(finder)
            _refuse_genuine()


def _refuse_genuine() -> None:
    """Raises RuntimeError if dm_control or a submodule of it is imported and not Limberjack's."""
    foreign = [
        module
        for name, module in list(sys.modules.items())
        if _is_below(name, _ALIAS)
        and module is not None
        and module is not sys.modules.get(_real_name(name))
    ]
    if foreign:
        origin = getattr(foreign[0], "__file__", None) or "an unknown location"
        raise RuntimeError(
            f"dm_control is already imported, from {origin} ({len(foreign)} modules), and cannot "
            "be replaced: call limberjack.install_as_dm_control() before anything imports "
            "dm_control, at the top of the program. Nothing was changed."
        )


def _place_finders() -> None:
    """Puts the finders first and last on `sys.meta_path`.

    No existing finder is ever missing in between, since other threads may import meanwhile.
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


class _AliasLoader(Loader):
    """Loads a Limberjack module under its own name in place of the requested one."""

    def __init__(self, real_name: str) -> None:
        self.real_name = real_name
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The Limberjack module, imported if necessary."""
        module = importlib.import_module(self.real_name)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restores the module's own spec, which the import system has just replaced."""
        module.__spec__ = self._spec


class _AliasSpec(ModuleSpec):
    """Spec of an alias that reports the real module's package as its parent.

    The import system sets this spec on the module briefly, and another thread may resolve a
    relative import in the module during that time.
    """

    @property
    def parent(self) -> str:
        """The package from which relative imports in the module start."""
        assert isinstance(self.loader, _AliasLoader)
        is_package = self.submodule_search_locations is not None
        return self.loader.real_name if is_package else self.loader.real_name.rpartition(".")[0]


class _AliasFinder(MetaPathFinder):
    """Resolves `dm_control` and its submodules to Limberjack's modules, never to others."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Spec of Limberjack's module; if there is none, an error on import, None on a search."""
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
        """Whether another finder would find the module, such as that of an editable dm_control."""
        others = [finder for finder in sys.meta_path if finder is not self]
        return any(
            find_spec(fullname, path) is not None
            for other in others
            if (find_spec := getattr(other, "find_spec", None)) is not None
        )


class _LastFinder(MetaPathFinder):
    """Handles modules below `limberjack` that no other finder has found.

    `from dm_control import composer` looks for `limberjack.composer`, because the aliased package
    keeps its own name.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Spec of a stand-in; if there is none, an error on import, None on a search."""
        if not fullname.startswith(f"{_REAL}."):
            return None
        if _is_stand_in(fullname.removeprefix(f"{_REAL}.")):
            return ModuleSpec(fullname, _StandInLoader(), is_package=True)
        if _importing():
            # Not `name=fullname`: `from package import name` swallows an error with that name.
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
    """Whether the calling finder serves an import, which gets an error with an explanation.

    A search, such as `importlib.util.find_spec`, must return None for a missing module, and the
    import system does not say which of the two is under way. If a Python release renames the
    function checked here, imports fail with Python's plain message.
    """
    try:
        asking = sys._getframe(3)  # this function, the finder, importlib's _find_spec
    except ValueError:
        return False
    return asking.f_code.co_name == "_find_and_load_unlocked"


def _missing(asked: str, real_name: str) -> str:
    """Error message for a missing module, requested under either name, without a stand-in."""
    package_name, _, name = real_name.rpartition(".")
    below = real_name.removeprefix(f"{_REAL}.")
    package = sys.modules.get(package_name)
    choices = {module.name for module in pkgutil.iter_modules(getattr(package, "__path__", []))}
    choices.update(vars(package) if package is not None else ())
    domains = ""
    if package_name == f"{_REAL}.suite":
        built = ", ".join(getattr(package, "TASKS_BY_DOMAIN", ()))
        domains = f" Available domains: {built}."
    hint = did_you_mean(name, [choice for choice in choices if not choice.startswith("_")])
    return (
        f"No module named {asked!r}: limberjack, which stands in for dm_control here, has no "
        f"{below!r}.{hint}{domains} {_WHERE_TO_FIND_IT}"
    )


def _is_stand_in(name: str) -> bool:
    """Whether the module, named without the package, belongs to a part that is not implemented."""
    if any(part.startswith("__") for part in name.split(".")):  # such as __main__
        return False
    return any(name == part or name.startswith(f"{part}.") for part in _NOT_BUILT)


class _StandInLoader(Loader):
    """Makes stand-in modules."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """An empty module whose public attributes are stand-in classes."""
        return _StandInModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Sets the module's docstring."""
        module.__doc__ = f"A stand-in: {_not_built(module.__name__)}"


class _StandInModule(ModuleType):
    """A module with a stand-in class for every public name."""

    def __getattr__(self, name: str) -> type:
        return _attribute(self.__name__, name)


# Of these programs make constants as they are imported, such as the files of tasks of ExoRL.
_PLAIN = {
    "limberjack.manipulation.shared.workspaces.BoundingBox": collections.namedtuple(
        "BoundingBox", ("lower", "upper")
    )
}


def _refuse(self: type, *args: object, **kwargs: object) -> NoReturn:
    """Raises the error of a stand-in class, or of that from which a program's class is derived."""
    made = next(one for one in self.__mro__ if one in _made.values())
    raise NotImplementedError(_not_built(f"{made.__module__}.{made.__name__}"))


# ABCMeta, so that `class Task(composer.Task, abc.ABC)` raises our error, not a metaclass conflict.
class _StandInClass(abc.ABCMeta):
    """Metaclass of the stand-in classes; defines the operations that raise."""

    def __getattr__(cls, name: str) -> type:
        return _attribute(f"{cls.__module__}.{cls.__name__}", name)

    __call__ = __iter__ = __len__ = __contains__ = __getitem__ = _refuse

    def __bool__(cls) -> bool:
        return True  # as for any class, although `__len__` is defined


def _attribute(owner: str, name: str) -> type:
    """The stand-in class with the given name in a stand-in module or class."""
    path = f"{owner}.{name}"
    if path in _PLAIN:
        return _PLAIN[path]
    if name.startswith("_"):
        # Tools probe private attributes to find out what an object supports.
        raise AttributeError(f"{path}: {_not_built(owner)}")
    if path not in _made:
        # An `except` clause accepts only exceptions.
        bases = (Exception,) if name.endswith(("Error", "Exception")) else ()
        names = {
            "__module__": owner,
            "__doc__": f"A stand-in: {_not_built(path)}",
        }
        _made.setdefault(path, _StandInClass(name, bases, names))
    return _made[path]


def _not_built(name: str) -> str:
    alias = f"dm_control.{name.partition('.')[2]}"
    return f"{alias} is not implemented in limberjack, in use as dm_control. {_WHERE_TO_FIND_IT}"
