"""Models without their textures, for simulations that are never drawn.

    light = without_textures(model)     # 0.06 MB instead of 12: the same steps in every bit

Nearly all of a model of the suite is the picture of its sky, and MuJoCo copies the model into each
batch. Blocks of that size, allocated and freed with each batch, leave the heap in pieces: the
process grows by tens of megabytes, though nothing leaks.

MuJoCo compiles textures into the model and cannot remove them, so they are cut out of its binary
form (`mj_saveModel`): a header, the sizes, the options and, one after the other, the arrays. What
is loaded is compared with the original. Where anything is not as expected, as with a later MuJoCo,
the model is returned as it is, which costs memory and nothing else.
"""

import mujoco
import numpy as np

__all__ = ["without_textures"]

_FEWEST_BYTES = 2**18  # of textures, for which it is worth while
_NAME = "model.mjb"
_ALIGNMENT = 64  # bytes; of each array in a model's memory

# The file's header, ints: the format's number, bytes of a float, number of sizes, version, number
# of arrays. The sizes follow.
_HEADER = np.dtype("i4")
_HEADER_LENGTH = 5
_NUM_SIZES = 2
_SIZE = np.dtype("i8")

# The arrays that precede `tex_data`, and those of them that become zero.
_BEFORE_DATA = ("tex_height", "tex_width", "tex_nchannel", "tex_adr")
_ZERO = ("tex_height", "tex_width", "tex_adr")
_CHANGED = ("tex_data", *_ZERO)


def without_textures(model: mujoco.MjModel) -> mujoco.MjModel:
    """A model whose simulations are the same, with textures of no pixels; or the model itself.

    The latter where there is little to be gained. `tex_data` is empty, and `tex_height`,
    `tex_width` and `tex_adr` are zero; all else is as in the model, of which nothing is shared.
    """
    if model.ntexdata < _FEWEST_BYTES:
        return model
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    cut = _cut(binary, model)
    if cut is None:
        return model
    try:
        light = mujoco.MjModel.from_binary_path(_NAME, {_NAME: cut})
    except ValueError:
        return model
    return light if _is_like(light, model) else model


def _cut(binary: np.ndarray, model: mujoco.MjModel) -> bytes | None:
    """A model's binary form without textures; None unless they were where they should be."""
    before = b"".join(getattr(model, name).tobytes() for name in _BEFORE_DATA)
    pixels = model.tex_data
    # All that can precede the pixels, and the first of them.
    head = binary[: len(binary) - pixels.nbytes + _ALIGNMENT].tobytes()
    start = head.find(before + pixels[:_ALIGNMENT].tobytes())
    if start < 0:
        return None
    empty = [
        np.zeros_like(getattr(model, n)) if n in _ZERO else getattr(model, n) for n in _BEFORE_DATA
    ]
    tail = binary[start + len(before) + pixels.nbytes :].tobytes()
    cut = bytearray(head[:start] + b"".join(array.tobytes() for array in empty) + tail)
    count = np.frombuffer(cut, _HEADER, _HEADER_LENGTH)[_NUM_SIZES]
    sizes = np.frombuffer(cut, _SIZE, count, _HEADER_LENGTH * _HEADER.itemsize)
    is_textures, is_memory = sizes == model.ntexdata, sizes == model.nbuffer
    if is_textures.sum() != 1 or is_memory.sum() != 1:
        return None
    sizes[is_textures] = 0
    sizes[is_memory] -= -(-pixels.nbytes // _ALIGNMENT) * _ALIGNMENT
    return bytes(cut)


def _is_like(light: mujoco.MjModel, model: mujoco.MjModel) -> bool:
    """Whether all arrays are equal, byte by byte, apart from those that were cut."""
    for name in dir(model):
        if name.startswith("_") or name in _CHANGED:
            continue
        value = getattr(model, name)
        if isinstance(value, np.ndarray) and value.tobytes() != getattr(light, name).tobytes():
            return False
    return True
