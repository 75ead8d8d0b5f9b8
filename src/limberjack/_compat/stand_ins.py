"""Importable stand-ins for the parts of dm_control that are not implemented.

Many programs, above all bridges to other libraries, import those parts along with the suite, use
their classes in annotations and in checks such as `isinstance(env, composer.Environment)`, and then
run a suite task. Importing the parts therefore works, submodules included; every public attribute
is a class without instances; anything that needs the real class (a call, a subclass, a loop) raises
NotImplementedError.
"""

import abc
from collections.abc import Iterator
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import NoReturn

__all__ = ["WHERE_TO_FIND_IT", "StandInLoader", "is_stand_in"]

WHERE_TO_FIND_IT = (
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


def is_stand_in(name: str) -> bool:
    """Whether the module, named without the package, belongs to a part that is not implemented."""
    if any(part.startswith("__") for part in name.split(".")):  # such as __main__
        return False
    return any(name == part or name.startswith(f"{part}.") for part in _NOT_BUILT)


class StandInLoader(Loader):
    """Makes stand-in modules."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """An empty module whose public attributes are stand-in classes."""
        return _StandInModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Sets the module's docstring."""
        module.__doc__ = f"A stand-in: {_not_built(module.__name__)}"


class _StandInModule(ModuleType):
    """A module with a stand-in class for every public name."""

    def __getattr__(self, name: str) -> "_StandInClass":
        return _attribute(self.__name__, name)


# ABCMeta, so that `class Task(composer.Task, abc.ABC)` raises our error, not a metaclass conflict.
class _StandInClass(abc.ABCMeta):
    """Metaclass of the stand-in classes; defines the operations that raise."""

    def __getattr__(cls, name: str) -> "_StandInClass":
        return _attribute(f"{cls.__module__}.{cls.__name__}", name)

    def __call__(cls, *args: object, **kwargs: object) -> NoReturn:
        _refuse(cls)

    def __iter__(cls) -> Iterator[NoReturn]:
        _refuse(cls)

    def __len__(cls) -> int:
        _refuse(cls)

    def __contains__(cls, item: object) -> bool:
        _refuse(cls)

    def __getitem__(cls, key: object) -> NoReturn:
        _refuse(cls)

    def __bool__(cls) -> bool:
        return True  # as for any class, although `__len__` is defined


def _attribute(owner: str, name: str) -> _StandInClass:
    """The stand-in class with the given name in a stand-in module or class."""
    path = f"{owner}.{name}"
    if name.startswith("_"):
        # Tools probe private attributes to find out what an object supports.
        raise AttributeError(f"{path}: {_not_built(owner)}")
    if path not in _made:
        # An `except` clause accepts only exceptions.
        bases = (Exception,) if name.endswith(("Error", "Exception")) else ()
        names = {
            "__module__": owner,
            "__doc__": f"A stand-in: {_not_built(path)}",
            "__init_subclass__": classmethod(_refuse_subclass),
        }
        _made.setdefault(path, _StandInClass(name, bases, names))
    return _made[path]


def _refuse(cls: type) -> NoReturn:
    raise NotImplementedError(_not_built(f"{cls.__module__}.{cls.__name__}"))


def _refuse_subclass(cls: type, **kwargs: object) -> NoReturn:
    """Replaces `__init_subclass__`; `cls` is the subclass being created."""
    _refuse(next(base for base in cls.__mro__ if base in _made.values()))


def _not_built(name: str) -> str:
    alias = f"dm_control.{name.partition('.')[2]}"
    return f"{alias} is not implemented in limberjack, in use as dm_control. {WHERE_TO_FIND_IT}"
