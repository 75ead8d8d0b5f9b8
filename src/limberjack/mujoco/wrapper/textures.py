"""Models with other textures: none, for simulations that are never drawn, or others to draw.

    light = without_textures(model)     # 0.06 MB instead of 12; steps are bitwise equal
    other = with_textures(model, {0: np.zeros((256, 256, 3), np.uint8)})

Nearly all of a suite model is its sky texture, and MuJoCo copies the model into each batch.
Allocating and freeing blocks of this size with each batch fragments the heap: the process grows by
tens of megabytes although nothing leaks.

MuJoCo compiles textures into the model and can neither remove nor resize them, so they are replaced
in its binary format (`mj_saveModel`): a header, the sizes, the options, then the arrays. The result
is compared with the original. If anything differs from what is expected, for example with a later
MuJoCo, `without_textures` returns the model unchanged, which only costs memory, and `with_textures`
raises.
"""

import mmap
from collections.abc import Mapping

import mujoco
import numpy as np

from limberjack.mujoco.allocating import allocating

__all__ = ["with_textures", "without_textures"]

_FEWEST_BYTES = 2**18  # minimum size of textures worth removing
_NAME = "model.mjb"
_ALIGNMENT = 64  # bytes; alignment of each array in a model's memory

# The file's header, as ints: format id, bytes per float, number of sizes, version, number of
# arrays. The sizes follow.
_HEADER = np.dtype("i4")
_HEADER_LENGTH = 5
_NUM_SIZES = 2
_SIZE = np.dtype("i8")

# The arrays directly before `tex_data`, and those of all textures' pixels and sizes.
_BEFORE_DATA = ("tex_height", "tex_width", "tex_nchannel", "tex_adr")
_CHANGED = (*_BEFORE_DATA, "tex_data")


def without_textures(model: mujoco.MjModel) -> mujoco.MjModel:
    """An equivalent model for simulation whose textures have no pixels.

    `tex_data` is empty, and `tex_height`, `tex_width` and `tex_adr` are zero; everything else is a
    copy. Returns `model` itself if its textures are small or cannot be removed.
    """
    if model.ntexdata < _FEWEST_BYTES:
        return model
    none = np.zeros_like(model.tex_height)
    sizes = {"tex_height": none, "tex_width": none, "tex_nchannel": model.tex_nchannel}
    light = _replaced(model, {**sizes, "tex_adr": np.zeros_like(model.tex_adr)}, b"")
    return model if light is None else light


def with_textures(model: mujoco.MjModel, textures: Mapping[int, np.ndarray]) -> mujoco.MjModel:
    """A copy of a model with other textures, by number: (height, width, channels) uint8.

    Raises:
      RuntimeError: the textures are not where they are expected.
    """
    fields = {name: getattr(model, name).copy() for name in _BEFORE_DATA}
    pixels, start = [], 0
    for number in range(model.ntex):
        other = textures.get(number)
        first, size = int(model.tex_adr[number]), _size_of(model, number)
        part = model.tex_data[first : first + size] if other is None else other.reshape(-1)
        if other is not None:
            sizes = zip(("tex_height", "tex_width", "tex_nchannel"), other.shape, strict=True)
            for name, value in sizes:
                fields[name][number] = value
        fields["tex_adr"][number] = start
        start += part.size
        pixels.append(part.tobytes())
    made = _replaced(model, fields, b"".join(pixels))
    if made is None:
        raise RuntimeError(f"MuJoCo {mujoco.__version__} keeps textures in another place than 4.0")
    return made


def _size_of(model: mujoco.MjModel, number: int) -> int:
    """Bytes of a texture."""
    rest = model.tex_adr[model.tex_adr > model.tex_adr[number]]
    end = rest.min() if rest.size else model.ntexdata
    return int(end - model.tex_adr[number])


def _replaced(
    model: mujoco.MjModel, fields: Mapping[str, np.ndarray], pixels: bytes
) -> mujoco.MjModel | None:
    """A copy with other textures; None if they are not where expected."""
    size = mujoco.mj_sizeModel(model)
    with allocating("a copy of the model in binary format", size):
        binary = np.frombuffer(_mapped(size), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    changed = _spliced(binary, model, fields, pixels)
    if changed is None:
        return None
    try:
        with allocating("a copy of the model with other textures", len(changed)):
            made = mujoco.MjModel.from_binary_path(_NAME, {_NAME: changed})
    except ValueError:
        return None
    return made if _is_like(made, model) else None


def _mapped(size: int) -> mmap.mmap:
    """Memory that returns to the system; blocks of this size would fragment the heap.

    It is private where the system tells that from shared memory, whose pages take twice as long.
    """
    if hasattr(mmap, "MAP_PRIVATE"):
        return mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return mmap.mmap(-1, size)


def _spliced(
    binary: np.ndarray, model: mujoco.MjModel, fields: Mapping[str, np.ndarray], pixels: bytes
) -> bytes | None:
    """A model's binary format with other textures; None if they are not where expected."""
    before = b"".join(getattr(model, name).tobytes() for name in _BEFORE_DATA)
    old = model.tex_data
    # Everything that can precede the pixels, and the first pixels.
    head = binary[: len(binary) - old.nbytes + _ALIGNMENT].tobytes()
    start = head.find(before + old[:_ALIGNMENT].tobytes())
    if start < 0:
        return None
    arrays = b"".join(fields[name].tobytes() for name in _BEFORE_DATA)
    tail = binary[start + len(before) + old.nbytes :].tobytes()
    changed = bytearray(head[:start] + arrays + pixels + tail)
    count = np.frombuffer(changed, _HEADER, _HEADER_LENGTH)[_NUM_SIZES]
    sizes = np.frombuffer(changed, _SIZE, count, _HEADER_LENGTH * _HEADER.itemsize)
    is_textures, is_memory = sizes == model.ntexdata, sizes == model.nbuffer
    if is_textures.sum() != 1 or is_memory.sum() != 1:
        return None
    sizes[is_textures] = len(pixels)
    sizes[is_memory] += _aligned(len(pixels)) - _aligned(old.nbytes)
    return bytes(changed)


def _aligned(nbytes: int) -> int:
    return -(-nbytes // _ALIGNMENT) * _ALIGNMENT


def _is_like(made: mujoco.MjModel, model: mujoco.MjModel) -> bool:
    """Whether all arrays are bytewise equal, except for those of the textures."""
    for name in dir(model):
        if name.startswith("_") or name in _CHANGED:
            continue
        value = getattr(model, name)
        if isinstance(value, np.ndarray) and value.tobytes() != getattr(made, name).tobytes():
            return False
    return True
