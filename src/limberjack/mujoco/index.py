"""Named indexing: fields of MuJoCo's structs, indexed by the names of the model's objects.

    physics.named.data.xpos["head", "z"]
    physics.named.data.qpos[["shoulder", "elbow"]]
    physics.named.model.geom_rgba["ball"] = 1, 0, 0, 1

The rows of a field are named after the model's objects: those of `xpos` after bodies, those of
`qpos` after joints (some of which span several elements). Columns of positions, quaternions,
matrices and colours are named `x y z`, `qw qx qy qz`, `xx xy ... zz` and `r g b a`. The object kind
follows from the field's name; indexers are created lazily.

Keys made of names, numbers, slices and lists of them are converted to a NumPy index once and
cached. In a batch the index is prefixed with `...`, so `xpos["head", "z"]` has one number per row.
"""

import collections
import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, NamedTuple, NoReturn

import mujoco
import numpy as np

from limberjack.mujoco import fields
from limberjack.mujoco.read_only import Checked
from limberjack.utils.arrays import index_for
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "Axes",
    "Axis",
    "FieldIndexer",
    "NamedFields",
    "NamedIndexStructs",
    "Names",
]

Axes = collections.namedtuple("Axes", ["row", "col"], defaults=(None,))

_Resolved = tuple[np.ndarray, tuple | np.ndarray]  # an array, and a key's index into it
_MOST_KEYS = 1000  # cached per field; a loop over many numbers must not fill the memory
_ENDS = (int, type(None))  # types of the parts of a slice that can be cached


class Axis:
    """An axis of a field, with or without names; converts one item of a key to a NumPy index."""

    def __init__(
        self,
        names: Sequence[str] | None = None,
        sizes: Iterable[int] | None = None,
        singletons_are_scalars: bool = False,
        what: str = "",
    ) -> None:
        """Creates an axis.

        Args:
          names: names of the objects in order, empty for an unnamed object; None for an axis
            without names.
          sizes: number of elements of each object along this axis; None for one each, which a name
            then selects as a scalar.
          singletons_are_scalars: whether the name of an object with one element selects a scalar.
          what: the kind of object, for messages.
        """
        if names is not None:
            self.names = list(names)
        self._what = what
        self._one: dict[str, int | slice] = {}
        self._many: dict[str, list[int]] = {}
        start = 0
        counts = [1] * len(names or ()) if sizes is None else list(sizes)
        for name, count in zip(names or (), counts, strict=True):
            if name:
                scalar = sizes is None or (singletons_are_scalars and count == 1)
                self._one[name] = start if scalar else slice(start, start + count)
                self._many[name] = list(range(start, start + count))
            start += count
        self._ragged = sizes is not None

    def convert_key_item(self, item: object) -> Any:  # Any: what NumPy indexes with
        """The NumPy index for one item of a key; items without names are returned unchanged.

        Raises:
          KeyError: an unknown name, with a suggestion.
          IndexError: Ellipsis, None or an empty name.
        """
        _refuse(item)
        if isinstance(item, str):
            return self._one[item] if item in self._one else self._unknown(item)
        if not isinstance(item, (list, np.ndarray)):
            return item
        flat = np.asarray(item, dtype=None)
        if not flat.size or not isinstance(flat.flat[0], str) or not hasattr(self, "names"):
            return item
        offsets = np.array([i for name in flat.flat for i in self._indices(str(name))], np.intp)
        return offsets if self._ragged and flat.ndim == 1 else offsets.reshape(flat.shape)

    def _indices(self, name: str) -> list[int]:
        return self._many[name] if name in self._many else self._unknown(name)

    def _unknown(self, name: str) -> NoReturn:
        known = ", ".join(self._one) or "none"
        raise KeyError(
            f"no {self._what or 'element'} is named {name!r}.{did_you_mean(name, self._one)} "
            f"Names: {known}."
        )


_UNNAMED = Axis()


class Names:
    """The axes of one compiled model, created on first use."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Keeps a reference to the raw `mujoco.MjModel`, which it only reads."""
        self.model = model
        self._axes: dict[str | None, Axis] = {None: _UNNAMED}

    def axis(self, size_name: str | None) -> Axis:
        """The axis of a size such as 'nbody', 'nq' or 'xyz'; unnamed for None."""
        if size_name not in self._axes:
            self._axes[size_name] = self._make(str(size_name))
        return self._axes[size_name]

    def _make(self, size_name: str) -> Axis:
        if size_name in fields.COLUMN_NAMES:
            return Axis(fields.COLUMN_NAMES[size_name], what="column")
        model = self.model
        if size_name == "nmocap":
            bodies = np.argsort(model.body_mocapid)[model.nbody - model.nmocap :]
            return Axis([self._object_names("body")[i] for i in bodies], what="mocap body")
        if size_name in fields.RAGGED:
            kind, address = fields.RAGGED[size_name]
            starts = getattr(model, address).ravel()
            sizes = np.diff(np.r_[starts, getattr(model, size_name)])
            return Axis(self._object_names(kind), sizes, what=kind)
        if size_name in fields.ACTUATORS:
            sizes = getattr(model, fields.ACTUATORS[size_name]).ravel()
            names = self._object_names("actuator")
            return Axis(names, sizes, singletons_are_scalars=True, what="actuator")
        kind = fields.OBJECTS[size_name]
        return Axis(self._object_names(kind), what=kind)

    def _object_names(self, kind: str) -> list[str]:
        """Names of all objects of a kind in order, empty for unnamed objects."""
        starts = getattr(self.model, f"name_{kind}adr").ravel()
        names = self.model.names
        return [names[start : names.find(b"\0", start)].decode() for start in starts]


class FieldIndexer:
    """An array of the simulation that also accepts names as indices.

    Keys may be names, lists of names and anything NumPy accepts except Ellipsis and None.
    Attributes are forwarded to the array.
    """

    __slots__ = ("_axes", "_batch", "_field", "_known", "_name")

    def __init__(self, name: str, field: np.ndarray, axes: Axes, batch: bool = False) -> None:
        """Wraps an array.

        Args:
          name: the field's name, for messages.
          field: the live array, (rows, columns), with a leading axis of simulations in a batch.
          axes: the row axis and, if there are columns, the column axis.
          batch: whether the array has a leading axis of simulations.
        """
        self._name = name
        self._field = field
        self._axes = axes
        self._batch = batch
        self._known: dict[Hashable, _Resolved] = {}

    @property
    def axes(self) -> Axes:
        """Row and column axis, a named tuple."""
        return self._axes

    def __getitem__(self, key: object) -> np.ndarray:
        array, index = self._lookup(key) or self._resolve(key)
        return array[index]

    def __setitem__(self, key: object, value: object) -> None:
        array, index = self._lookup(key) or self._resolve(key)
        array[index] = value

    def _lookup(self, key: object) -> _Resolved | None:
        """The cached result of resolving a key, if any."""
        if type(key) is str:
            return self._known.get(key)
        return self._known.get(_frozen(key))

    def _resolve(self, key: object) -> _Resolved:
        """The array and index that a key stands for; cached if the key is hashable in some form."""
        items = key if isinstance(key, tuple) else (key,)
        dimensions = self._field.ndim - self._batch
        if len(items) > dimensions:
            advice = ": leave out `...`, also in a batch" if items[0] is Ellipsis else ""
            raise IndexError(
                f"Index tuple has {len(items)} elements, but array has only {dimensions} "
                f"dimensions: {self._name}[{key!r}]{advice}"
            )
        axes = (*filter(None, self._axes), *(_UNNAMED,) * len(items))
        index = tuple(axis.convert_key_item(item) for axis, item in zip(axes, items, strict=False))
        resolved: _Resolved = self._field, self._in_batch(index) if self._batch else index
        frozen = _frozen(key)
        if frozen is not None and len(self._known) < _MOST_KEYS:
            if any(isinstance(item, (list, np.ndarray)) for item in index):
                resolved = self._flattened(index)
            self._known[frozen] = resolved
        return resolved

    def _in_batch(self, index: tuple) -> tuple:
        """The index for an array with a leading batch axis: `...`, then one item per other axis."""
        rest = self._field.ndim - 1 - sum(map(_axes_taken, index))
        if rest < 0:
            raise IndexError(f"too many indices for a row of {self._name}: {index!r}")
        return (..., *index, *(slice(None),) * rest)

    def _flattened(self, index: tuple) -> _Resolved:
        """The same elements as flat positions in one array, which is the fastest gather."""
        shape = tuple(self._field.shape[self._batch :])
        positions = np.arange(math.prod(shape)).reshape(shape)[index]
        if self._batch:
            flat = self._field.reshape(len(self._field), -1)
            return flat, (..., index_for(flat, positions))
        flat = self._field.reshape(-1)
        return flat, index_for(flat, positions)

    def __getattr__(self, name: str) -> Any:  # Any: attributes of the array
        return getattr(self._field, name)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a named field belongs to its physics: copy or pickle that, or its array")

    def __array__(
        self, dtype: type | np.dtype | None = None, copy: bool | None = None
    ) -> np.ndarray:
        return np.array(self._field, dtype=dtype, copy=copy)

    def __len__(self) -> int:
        return len(self._field)

    def __dir__(self) -> list[str]:
        return sorted(set(object.__dir__(self)) | set(dir(self._field)))

    def __repr__(self) -> str:
        title = f"FieldIndexer({self._name}):"
        if self._batch:
            return f"{title} a batch of shape {self._field.shape}"
        lines = [title]
        if getattr(self._axes.col, "names", None):
            columns = _labels(self._axes.col, self._field.shape[1])
            lines.append(" " * 30 + "".join(f"{column:<11}" for column in columns))
        labels = _labels(self._axes.row, len(self._field))
        for i, (label, row) in enumerate(zip(labels, self._field, strict=True)):
            values = np.array2string(
                np.atleast_1d(row),
                suppress_small=True,
                formatter={"float_kind": "{: < 9.3g}".format},
            )
            lines.append(f"{i:>4} {label:>24} {values}")
        return "\n".join(lines) if len(self._field) else f"{title}\n(empty)"


class _IntegerIndexer(FieldIndexer):
    """Indexer of an integer field of a model, whose writes are checked or refused.

    Reading gives ordinary arrays, as with other indexers, except that a view of a checked field
    checks its writes too. Views of other fields are read-only.
    """

    __slots__ = ()

    def __getitem__(self, key: object) -> np.ndarray:
        value = super().__getitem__(key)
        if not isinstance(value, np.ndarray):
            return value
        is_view = isinstance(value, Checked) and not value.flags.writeable
        return value if is_view else value.view(np.ndarray)


class NamedFields:
    """The fields of one struct as `FieldIndexer`s, created on first use."""

    def __init__(
        self,
        struct_name: str,
        read: Callable[[str], tuple[np.ndarray, bool]],
        names: Names,
        indexer: Callable[[str, np.ndarray, Axes, bool], FieldIndexer] = FieldIndexer,
    ) -> None:
        """Creates the view.

        Args:
          struct_name: 'MjModel' or 'MjData'.
          read: returns a field's live array by name, and whether it has a leading batch axis.
          names: the model's axes.
          indexer: creates the indexer of a field; the arguments are those of `FieldIndexer`.
        """
        self._struct_name = struct_name
        self._read = read
        self._names = names
        self._indexer = indexer

    def __getattr__(self, name: str) -> FieldIndexer:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            field, batch = self._read(name)
        except AttributeError as error:
            hint = did_you_mean(name, dir(getattr(mujoco, self._struct_name)))
            raise AttributeError(f"{self._struct_name} has no field {name!r}.{hint}") from error
        if not hasattr(field, "shape") or getattr(field.dtype, "fields", None):
            raise AttributeError(f"{self._struct_name}.{name} is not an array, so it has no names")
        sizes = fields.axes_of(self._struct_name, name, len(field.shape) - batch)
        axes = Axes(*(self._names.axis(size) for size in sizes or (None,)))
        # The dtype of an array on a device has no kind; integers are not there.
        is_guarded = type(field) is not np.ndarray and getattr(field.dtype, "kind", "f") in "iub"
        create = _IntegerIndexer if is_guarded and not batch else self._indexer
        indexer = create(name, field, axes, batch)
        if sizes[:1] != (None,):
            # Arrays without named rows may be reallocated between steps, so they are not cached.
            self.__dict__[name] = indexer
        return indexer

    def __setattr__(self, name: str, value: object) -> None:
        if name.startswith("_"):
            super().__setattr__(name, value)
            return
        struct = self._struct_name.removeprefix("Mj").lower()
        raise AttributeError(
            f"named.{struct}.{name} cannot be replaced; set its elements: "
            f"named.{struct}.{name}[:] = ..."
        )

    def _asdict(self) -> dict[str, FieldIndexer]:
        """All fields that are arrays, by name."""
        names = dir(getattr(mujoco, self._struct_name))
        found = ((name, getattr(self, name, None)) for name in names if not name.startswith("_"))
        return {name: indexer for name, indexer in found if indexer is not None}

    def __dir__(self) -> list[str]:
        return sorted(self._asdict())


class NamedIndexStructs(NamedTuple):
    """The type of `physics.named`."""

    model: NamedFields
    data: NamedFields


def _refuse(item: object) -> None:
    """Raises IndexError for items that named indexing does not support."""
    if isinstance(item, (list, np.ndarray)):
        for part in item if np.ndim(item) else ():
            _refuse(part)
    elif item is Ellipsis:
        raise IndexError("Ellipsis indexing not supported.")
    elif item is None:
        raise IndexError("None indexing not supported.")
    elif isinstance(item, (str, bytes)) and not item:
        raise IndexError("Empty strings are not allowed.")


def _axes_taken(item: Any) -> int:  # Any: what NumPy indexes with
    """The number of an array's axes that an item of an index selects from."""
    if isinstance(item, bool | list):
        item = np.asarray(item)
    return item.ndim if getattr(item, "dtype", None) == np.dtype(bool) else 1


def _frozen(key: object) -> Hashable:
    """A hashable form of a key; None for a key without one, such as an array.

    The form includes types, because 1, 1.0 and True are different keys, as are `a["x", "y"]` and
    `a[["x", "y"]]`.
    """
    if type(key) is tuple:
        if len(key) == 2 and type(key[0]) is str:
            name, column = key
            if type(column) is str:
                return key
            is_head = type(column) is slice and column.start is column.step is None
            if is_head and type(column.stop) is int:  # fast path for keys such as ["target", :2]
                return name, slice, column.stop
        parts = tuple([part if type(part) is str else _frozen(part) for part in key])
        return None if None in parts else parts
    if type(key) is list:
        return _frozen_list(key)
    if type(key) is str:
        return key
    if type(key) is int:
        return (int, key)
    if type(key) is slice:
        start, stop, step = key.start, key.stop, key.step
        # A loop takes twice as long.
        if type(start) in _ENDS and type(stop) in _ENDS and type(step) in _ENDS:
            return (slice, start, stop, step)
    return None


def _frozen_list(key: list[object]) -> Hashable:
    kinds = set(map(type, key))
    if kinds == {str} or kinds == {int}:
        return (list, *kinds, *key)
    parts = tuple([_frozen(part) for part in key])
    return None if None in parts else (list, *parts)


def _labels(axis: Axis, count: int) -> list[str]:
    """A label for each row or column: the name of the object that it belongs to."""
    labels = [""] * count
    for name in filter(None, getattr(axis, "names", ())):
        for place in axis.convert_key_item([name]):
            labels[place] = name
    return labels
