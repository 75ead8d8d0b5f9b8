"""`Recompiler`: compiles a model's MJCF again with changes, for the fields that they set.

    recompiler = physics.recompiler()
    names = recompiler.names([shorter, longer])     # ("body_inertia", "body_mass", ...)
    fields = recompiler.fields(shorter, names)

A length in MJCF determines sizes, masses, inertias, bounding volumes and more. The compiler
computes them here as it does for a file with the change. The sky, which takes most of the time, is
replaced by a small one. `stat`, of which the solver uses the mean inertia to scale its tolerance,
belongs to the nominal model and is not among the fields.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from xml.etree import ElementTree

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco.model_values import array_names
from limberjack.mujoco.wrapper.util import to_native_string

__all__ = ["Recompiler", "spec_of"]

_Edit = Callable[[ElementTree.Element], None]

_SMALL = "8"  # pixels of a side of the sky


def spec_of(mjcf: str | bytes, assets: Mapping[str, bytes]) -> mujoco.MjSpec:
    """An MJCF, parsed; it does not become the last one, which MuJoCo can save as XML.

    Args:
      mjcf: the MJCF.
      assets: contents of the files it refers to, by name.

    Raises:
      ValueError: MuJoCo's error message about the MJCF.
    """
    text, files = to_native_string(mjcf), dict(assets)
    return mujoco.MjSpec.from_string(text, include=files, assets=files)


class Recompiler:
    """See the module's docstring."""

    def __init__(self, mjcf: str | bytes, assets: Mapping[str, bytes]) -> None:
        """Takes the MJCF, and the contents of the files it refers to by name."""
        self._mjcf = _with_small_sky(mjcf)
        self._assets = {
            name: _with_small_sky(content) if name.endswith(".xml") else content
            for name, content in assets.items()
        }
        self._nominal = self._compiled(lambda root: None)

    def _compiled(self, edit: _Edit) -> mujoco.MjModel:
        root = ElementTree.fromstring(self._mjcf)
        edit(root)
        return spec_of(ElementTree.tostring(root), self._assets).compile()

    def names(self, edits: Iterable[_Edit]) -> tuple[str, ...]:
        """The fields in which the model with one of the changes differs from the nominal one.

        Raises:
          ValueError: a change is invalid, or adds or removes elements.
        """
        found = {name for edit in edits for name in self._differences(self._compiled(edit))}
        return tuple(sorted(found))

    def fields(self, edit: _Edit, names: Sequence[str]) -> dict[str, np.ndarray]:
        """The values of fields with a change, by name.

        Raises:
          ValueError: the change is invalid, or other fields differ from the nominal model's.
        """
        model = self._compiled(edit)
        others = [name for name in self._differences(model) if name not in names]
        if others:
            raise ValueError(f"a change of the model sets {', '.join(others)}, unlike others")
        return {name: np.array(getattr(model, name)) for name in names}

    def _differences(self, model: mujoco.MjModel) -> list[str]:
        """The array fields that differ from the nominal model's."""
        found = []
        for name in array_names():
            one, other = getattr(self._nominal, name), getattr(model, name)
            if one.shape != other.shape or one.tobytes() != other.tobytes():
                if one.shape != other.shape or name not in mujoco.batch.MODEL_FIELDS:
                    raise ValueError(
                        f"a change of the model changes {name}, which must be the same in all "
                        "episodes"
                    )
                found.append(name)
        return found


def _with_small_sky(mjcf: str | bytes) -> bytes:
    root = ElementTree.fromstring(mjcf)
    for texture in root.iter("texture"):
        if texture.get("type") == "skybox":
            texture.set("width", _SMALL)
            texture.set("height", _SMALL)
    return ElementTree.tostring(root)
