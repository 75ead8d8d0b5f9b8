"""`Shown`: the copies of a viewed environment's model and state that a viewer draws.

    shown = Shown(environment)
    model = shown.copy_model()
    data = mujoco.MjData(model)
    shown.copy_state(model, data)  # after each step
    if shown.version != version:  # a new look, other numbers or another quality
        ...  # copy the model again, or its fields with `copy_fields`

The environment's own model and state are read, never written: other environments may share them.
"""

import copy
import zlib
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.dressing import dressed, look_of
from limberjack.mujoco.recompiling import spec_of
from limberjack.utils.suggest import did_you_mean
from limberjack.worlds.appearance.looks import Look

__all__ = ["AUTO", "QUALITIES", "Shown", "Viewed"]

AUTO = "auto"  # the quality that depends on what draws
QUALITIES = (AUTO, "full", "fast")

# Any: a `control.Environment`, a wrapper of one or another library's, by its attributes.
Viewed = Any

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


def _simplify(model: mujoco.MjModel) -> None:
    """Makes a model quick to draw by viewers that draw it by themselves."""
    model.light_castshadow[:] = False
    model.mat_reflectance[:] = 0.0
    model.vis.quality.shadowsize = model.vis.quality.offsamples = 0


def _with_fields_of(model: mujoco.MjModel, flagged: mujoco.MjModel) -> mujoco.MjModel | None:
    """A copy of a model with flags that has the fields of another; None if those do not fit."""
    made = copy.copy(flagged)
    for name in dir(model):
        value = getattr(model, name)
        if isinstance(value, np.ndarray) and not name.startswith(("_", "name", "numeric_")):
            mine = getattr(made, name)
            if mine.shape != value.shape:
                return None
            mine[...] = value
    return made


class Shown:
    """The copies that a viewer draws of an environment; see the module's docstring."""

    def __init__(self, environment: Viewed, quality: str = AUTO) -> None:
        """Shows the model as it is.

        Args:
          environment: a `control.Environment`, or a wrapper of one that has its attributes.
          quality: 'fast' shows the model without shadows, reflections, darkened corners and smooth
            edges, 'full' with them, and 'auto' with them unless a browser draws without a GPU.

        Raises:
          ValueError: the quality is unknown.
        """
        self._environment = environment
        self._digest: int | None = None
        self._version = 0
        self._copied_version = (0, 0)  # which model has which version
        self._flagged: mujoco.MjModel | None = None  # compiled for the quality 'fast'
        self._quality, self._is_drawn_by_software = AUTO, False
        self.set_quality(quality)

    @property
    def quality(self) -> str:
        """The quality that was asked for."""
        return self._quality

    @property
    def version(self) -> int:
        """A number that grows when there is something else to copy: a model, a look, a quality."""
        return self._version

    def note_start(self) -> None:
        """Notices whether the start has changed the model, by its bytes, or its look."""
        model = self._model
        content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        digest = zlib.crc32(content.data)
        self._version += digest != self._digest or self._look is not None
        self._digest = digest

    def set_quality(self, quality: str) -> None:
        """Shows the model in another quality from now on; see `__init__`.

        Raises:
          ValueError: the quality is unknown; nothing changes.
        """
        if quality not in QUALITIES:
            raise ValueError(
                f"quality is {quality!r}; expected {', '.join(QUALITIES)}."
                f"{did_you_mean(quality, QUALITIES)}"
            )
        was_fast, self._quality = self._is_fast, quality
        self._show_quality(was_fast)

    def drawn_by_software(self) -> None:
        """Notices that a browser draws without a GPU, which decides on the quality 'auto'."""
        was_fast, self._is_drawn_by_software = self._is_fast, True
        self._show_quality(was_fast)

    def copy_model(self) -> mujoco.MjModel:
        """A copy of the model, for the viewer to keep, in the look of this moment."""
        model, look = self._model, self._look
        if self._is_fast and self._flagged is not None:
            model = _with_fields_of(model, self._flagged) or model
        model = copy.copy(model) if look is None else dressed(look, model, self._data)
        if self._is_fast:
            _simplify(model)
        return model

    def copy_fields(self, model: mujoco.MjModel) -> list[str]:
        """Writes the fields that an episode has changed into a viewer's copy; returns their names.

        Args:
          model: of `copy_model`.
        """
        if self._copied_version == (id(model), self._version):
            return []
        is_as_it_is = self._look is None and not self._is_fast
        now, changed = self._model if is_as_it_is else self.copy_model(), []
        for name in dir(now):
            mine = getattr(now, name)
            if isinstance(mine, np.ndarray) and not np.array_equal(getattr(model, name), mine):
                getattr(model, name)[...] = mine
                changed.append(name)
        self._copied_version = id(model), self._version
        return changed

    def copy_state(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Writes the state into a viewer's data, without the pushes, which are the viewer's own.

        Args:
          model: of `copy_model`.
          data: a `mujoco.MjData` of that model; quantities derived from the state are not computed.
        """
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        mujoco.mj_setState(model, data, state, _STATE)
        data.xfrc_applied[:] = 0.0

    @property
    def _model(self) -> mujoco.MjModel:
        return self._environment.physics.model._official

    @property
    def _data(self) -> mujoco.MjData:
        return self._environment.physics.data._data

    @property
    def _look(self) -> Look | None:
        """The appearance of the episode; None for that of the model."""
        return look_of(self._environment.physics)

    @property
    def _is_fast(self) -> bool:
        return self._quality == "fast" or (self._quality == AUTO and self._is_drawn_by_software)

    def _show_quality(self, was_fast: bool) -> None:
        """Shows the model again if the quality has become another one."""
        if self._is_fast == was_fast:
            return
        if self._is_fast and self._flagged is None:
            self._flagged = self._compiled_without_occlusion()
        self._version += 1

    def _compiled_without_occlusion(self) -> mujoco.MjModel | None:
        """The model with a flag for the viewer; None if it cannot be compiled again.

        MuJoCo Studio then darkens no corners, which takes half of its time.
        """
        mjcf = getattr(self._environment.physics.model, "_mjcf", None)
        if mjcf is None:
            return None
        try:
            spec = spec_of(*mjcf)
            spec.add_numeric(name="filament.ao.enabled", data=[0.0])
            return spec.compile()
        except ValueError:  # it has the flag, or a file that it refers to is not there any more
            return None
