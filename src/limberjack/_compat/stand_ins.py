"""Importable stand-ins for the parts of dm_control that are not built.

Programs, and bridges to other libraries above all, import those parts beside the suite, put their
classes into annotations and ask `isinstance(env, composer.Environment)`, and then run a suite task.
So importing them works, submodules included; every public attribute is a class without instances;
and whatever would need the real thing - a call, a subclass, a loop - raises NotImplementedError.
"""

import abc
from collections.abc import Iterator
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import NoReturn

__all__ = ["WHERE_TO_FIND_IT", "StandInLoader", "is_stand_in"]

WHERE_TO_FIND_IT = (
    "What limberjack lacks is in the genuine dm_control: use that in an environment of its own, "
    "without limberjack.install_as_dm_control()."
)

# Below dm_control, each with all its submodules. A module that Limberjack has comes first.
_NOT_BUILT = (
    "composer",
    "entities",
    "locomotion",
    "manipulation",
    "mjcf",
    "suite.utils.parse_amc",
    "suite.wrappers.mujoco_profiling",
    "utils.inverse_kinematics",
    "utils.transformations",
    "viewer",  # but for the module itself: what is below it
)

_made: dict[str, "_StandInClass"] = {}


def is_stand_in(name: str) -> bool:
    """Whether the module of this name, without the package's, is a part that is not built."""
    if any(part.startswith("__") for part in name.split(".")):  # such as __main__
        return False
    return any(name == part or name.startswith(f"{part}.") for part in _NOT_BUILT)


class StandInLoader(Loader):
    """Makes stand-in modules."""

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """An empty module whose public attributes are stand-in classes."""
        return _StandInModule(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Says in the module's docstring what it is."""
        module.__doc__ = f"A stand-in: {_not_built(module.__name__)}"


class _StandInModule(ModuleType):
    """A module that has every public name."""

    def __getattr__(self, name: str) -> "_StandInClass":
        return _attribute(self.__name__, name)


# ABCMeta, so that `class Task(composer.Task, abc.ABC)` gets our error, not a metaclass conflict.
class _StandInClass(abc.ABCMeta):
    """The class of the stand-in classes: what must not be done with them is defined here."""

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
        return True  # as of any class, though it has a length


def _attribute(owner: str, name: str) -> _StandInClass:
    """The stand-in class of that name in a stand-in module or class."""
    path = f"{owner}.{name}"
    if name.startswith("_"):
        # Tools look for private attributes to learn what an object can do.
        raise AttributeError(f"{path}: {_not_built(owner)}")
    if path not in _made:
        # An `except` clause takes only exceptions.
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
    """In place of `__init_subclass__`; `cls` is the subclass in the making."""
    _refuse(next(base for base in cls.__mro__ if base in _made.values()))


def _not_built(name: str) -> str:
    alias = f"dm_control.{name.partition('.')[2]}"
    return f"{alias} is not built in limberjack, which stands in for dm_control. {WHERE_TO_FIND_IT}"
