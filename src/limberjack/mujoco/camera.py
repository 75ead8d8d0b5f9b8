"""Cameras: pictures of a physics in colours, as distances or as object numbers.

    camera = Camera(physics, height=240, width=320, camera_id="side")
    rgb = camera.render()
    metres = camera.render(depth=True)
    numbers = camera.render(segmentation=True)[..., 0]

The pixels are dm_control's. Every picture is an array of its own that nothing changes later. A
camera can be made and moved, and its matrix asked for, where there is no OpenGL: only a picture
needs that (`rendering`).
"""

import threading
import weakref
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from limberjack.mujoco.overlays import TextOverlay
from limberjack.mujoco.pictures import Overlay, Style, draw, finished
from limberjack.mujoco.rendering import Contexts, RenderingError, call, contexts
from limberjack.mujoco.viewpoints import FREE_CAMERA, Drawable, checked_size, view_of
from limberjack.mujoco.wrapper import MjvCamera, MjvOption, MjvScene
from limberjack.mujoco.wrapper.visual import RenderFlag

__all__ = [
    "Camera",
    "CameraMatrices",
    "Contexts",
    "Drawable",
    "MovableCamera",
    "Pose",
    "RenderingError",
    "Selected",
    "TextOverlay",
    "contexts",
    "render",
]

# Called with the physics and the scene.
_SceneCallback = Callable[..., None]

_EVERYTHING = mujoco.mjtCatBit.mjCAT_ALL.value
# What `render` draws unless told otherwise.
_DEFAULT_OPTION = MjvOption()
# Scenes for `render`, by model: making one takes much longer than filling it.
_spare_scenes: weakref.WeakKeyDictionary[mujoco.MjModel, list[MjvScene]] = (
    weakref.WeakKeyDictionary()
)
_MOST_SPARE_SCENES = 4


class Selected(NamedTuple):
    """What is seen at a point of a picture: object numbers, None for none."""

    body: int | None
    geom: int | None
    flex: int | None
    skin: int | None
    world_position: np.ndarray | None


class Pose(NamedTuple):
    """Where a free camera is: the point it looks at, metres from it, and two angles in degrees."""

    lookat: np.ndarray
    distance: float
    azimuth: float
    elevation: float


class CameraMatrices(NamedTuple):
    """The factors of a camera matrix: `image @ focal @ rotation @ translation`."""

    image: np.ndarray
    focal: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Camera:
    """A view of a physics, of a fixed size.

    `camera.scene.flags` and `camera.option` change how it is drawn, for good.
    """

    def __init__(
        self,
        physics: Drawable,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = FREE_CAMERA,
        max_geom: int | None = None,
        scene_callback: _SceneCallback | None = None,
    ) -> None:
        """Makes a camera; does not need OpenGL.

        Args:
          physics: what to look at.
          height: pixels.
          width: pixels.
          camera_id: name or number of a camera of the model; -1 is the free camera.
          max_geom: the most geoms that can be drawn; by default enough for the model with its
            decorations.
          scene_callback: called with the physics and the scene before the scene is drawn; it may
            add geoms.

        Raises:
          ValueError: there is no such camera, or the size is none or more than the model's
            off-screen buffer has.
        """
        self._height, self._width = checked_size(physics, height, width)
        self._physics = physics
        self._scene_callback = scene_callback
        self._render_camera = view_of(physics, camera_id)
        self._scene = MjvScene(model=physics.model, max_geom=max_geom)
        self._scene_option = MjvOption()
        self._lock = threading.RLock()

    @property
    def width(self) -> int:
        """Width of the picture, pixels."""
        return self._width

    @property
    def height(self) -> int:
        """Height of the picture, pixels."""
        return self._height

    @property
    def option(self) -> MjvOption:
        """What is drawn, unless `render` is told otherwise."""
        return self._scene_option

    @property
    def scene(self) -> MjvScene:
        """The geoms, lights and flags that are drawn."""
        return self._scene

    @property
    def matrix(self) -> np.ndarray:
        """The camera matrix, (3, 4): from homogeneous world coordinates to pixels, times depth."""
        image, focal, rotation, translation = self.matrices()
        return image @ focal @ rotation @ translation

    def matrices(self) -> CameraMatrices:
        """The factors of the camera matrix."""
        model, data = self._physics.model._model, self._physics.data._data
        number = self._render_camera.fixedcamid
        if number == FREE_CAMERA:
            # Known to the scene only, for a left and a right eye; the camera is between the two.
            self.update()
            eyes = self.scene.camera
            position = np.mean([eye.pos for eye in eyes], axis=0)
            backward = -np.mean([eye.forward for eye in eyes], axis=0)
            up = np.mean([eye.up for eye in eyes], axis=0)
            axes = np.vstack((np.cross(up, backward), up, backward))
            fovy = model.vis.global_.fovy
        else:
            position = data.cam_xpos[number]
            axes = data.cam_xmat[number].reshape(3, 3).T
            fovy = model.cam_fovy[number]
        image, rotation, translation = np.eye(3), np.eye(4), np.eye(4)
        image[:2, 2] = (self.width - 1) / 2.0, (self.height - 1) / 2.0
        rotation[:3, :3] = axes
        translation[:3, 3] = -position
        # As dm_control, operation by operation, for the last bit.
        scale = (1.0 / np.tan(np.deg2rad(fovy) / 2)) * self.height / 2.0
        focal = np.diag([-scale, scale, 1.0, 0])[:3]
        return CameraMatrices(image, focal, rotation, translation)

    def update(self, scene_option: mujoco.MjvOption | None = None) -> None:
        """Takes the physics' present state into the scene.

        Args:
          scene_option: a `wrapper.MjvOption` to use instead of the camera's.
        """
        with self._lock:
            mujoco.mjv_updateScene(*self._contents(scene_option), self._scene)

    def _contents(self, scene_option: mujoco.MjvOption | None) -> tuple:
        return _contents(self._physics, self._render_camera, scene_option or self._scene_option)

    def render(
        self,
        overlays: Iterable[Overlay] = (),
        depth: bool = False,
        segmentation: bool = False,
        scene_option: mujoco.MjvOption | None = None,
        render_flag_overrides: Mapping[RenderFlag, bool] | None = None,
        quality: str = "full",
    ) -> np.ndarray:
        """A picture of the physics' present state.

        Args:
          overlays: texts to draw on it, in colours only.
          depth: distances instead of colours.
          segmentation: object numbers instead of colours.
          scene_option: a `wrapper.MjvOption` to use instead of the camera's.
          render_flag_overrides: rendering flags for this picture, by name ('wireframe', 'shadow')
            or `mujoco.mjtRndFlag`, in colours only.
          quality: 'full', whose pixels are dm_control's, or 'fast', without shadows, reflections
            and sky: several times as fast with a software renderer.

        Returns:
          (height, width, 3) uint8 colours; or (height, width) float32 distances in metres along the
          camera's axis; or (height, width, 2) int32 of an object's number and its `mjtObj` type, -1
          and -1 for the background.

        Raises:
          ValueError: what cannot be combined, or an unknown flag or quality.
          RenderingError: OpenGL cannot be had.
        """
        style = Style.of(overlays, depth, segmentation, render_flag_overrides, quality)
        model, size = self._physics.model._model, (self._height, self._width)
        with self._lock:
            contents = self._contents(scene_option)
            if self._scene_callback:
                contents = _with_callback(
                    contents, self._physics, self._scene, self._scene_callback
                )
            with self._scene.override_flags(style.flags):
                raw = call(
                    model,
                    draw,
                    *(self._scene, style, *size, contents),
                    size=size,
                    may_have_changed=_may_have_changed(self._physics),
                )
            return finished(raw, style, model, self._scene)

    def select(self, cursor_position: tuple[float, float]) -> Selected:
        """What is seen at a point of the picture.

        Args:
          cursor_position: x and y from 0 to 1, from the lower left corner.
        """
        model, data = self._physics.model._model, self._physics.data._data
        position = np.empty(3)
        geom, flex, skin = (np.full(1, -1, np.intc) for _ in range(3))
        with self._lock:
            self.update()
            body = mujoco.mjv_select(
                model,
                data,
                self._scene_option,
                self._width / self._height,
                *cursor_position,
                self._scene,
                position,
                geom,
                flex,
                skin,
            )
        found = (body, geom[0], flex[0], skin[0])
        body, geom, flex, skin = (None if number == -1 else number for number in found)
        is_nothing = body is geom is skin is None  # As dm_control, which asks for no flex.
        return Selected(body, geom, flex, skin, None if is_nothing else position)


class MovableCamera(Camera):
    """A free camera that can be moved."""

    def __init__(
        self,
        physics: Drawable,
        height: int = 240,
        width: int = 320,
        max_geom: int | None = None,
        scene_callback: _SceneCallback | None = None,
    ) -> None:
        """Makes a camera where the model's free camera is; arguments are those of `Camera`."""
        super().__init__(physics, height, width, FREE_CAMERA, max_geom, scene_callback)

    def get_pose(self) -> Pose:
        """Where the camera is."""
        camera = self._render_camera
        return Pose(camera.lookat.copy(), camera.distance, camera.azimuth, camera.elevation)

    def set_pose(
        self, lookat: np.ndarray, distance: float, azimuth: float, elevation: float
    ) -> None:
        """Moves the camera.

        Args:
          lookat: the point it looks at, (3,), metres.
          distance: from that point, metres.
          azimuth: degrees about the vertical.
          elevation: degrees above the horizontal.
        """
        np.copyto(self._render_camera.lookat, lookat)
        self._render_camera.distance = distance
        self._render_camera.azimuth = azimuth
        self._render_camera.elevation = elevation


def render(
    physics: Drawable,
    height: int = 240,
    width: int = 320,
    camera_id: int | str = FREE_CAMERA,
    overlays: Iterable[Overlay] = (),
    depth: bool = False,
    segmentation: bool = False,
    scene_option: mujoco.MjvOption | None = None,
    render_flag_overrides: Mapping[RenderFlag, bool] | None = None,
    scene_callback: _SceneCallback | None = None,
    quality: str = "full",
) -> np.ndarray:
    """A picture, as by a new `Camera`; what it needs is kept for the next one.

    Arguments, result and errors are those of `Camera` and `Camera.render`.
    """
    size = checked_size(physics, height, width)
    view = view_of(physics, camera_id)
    style = Style.of(overlays, depth, segmentation, render_flag_overrides, quality)
    model = physics.model._model
    spares = _spare_scenes.setdefault(model, [])
    # A callback may keep the scene or change it for good. Flexible bodies and skins that an option
    # hides would stay in it.
    is_reusable = scene_callback is None and (
        scene_option is None or not (model.nflex or model.nskin)
    )
    scene = _renewed(spares.pop()) if spares and is_reusable else MjvScene(model=physics.model)
    contents = _contents(physics, view, scene_option or _DEFAULT_OPTION)
    if scene_callback:
        contents = _with_callback(contents, physics, scene, scene_callback)
    with scene.override_flags(style.flags):
        what = scene, style, *size, contents
        is_new = _may_have_changed(physics)
        raw = call(model, draw, *what, size=size, may_have_changed=is_new)
    picture = finished(raw, style, model, scene)
    if is_reusable and len(spares) < _MOST_SPARE_SCENES:
        spares.append(scene)
    return picture


def _may_have_changed(physics: Drawable) -> bool:
    """Whether the model's height fields, textures or meshes may have changed since they were drawn.

    They cannot until somebody is given them.
    """
    return physics.model._is_lent


def _contents(physics: Drawable, view: MjvCamera, option: mujoco.MjvOption) -> tuple:
    """What `mjv_updateScene` takes into a scene: the physics' present state."""
    return physics.model._model, physics.data._data, option, None, view, _EVERYTHING


def _with_callback(
    contents: tuple, physics: Drawable, scene: MjvScene, callback: _SceneCallback
) -> None:
    """Takes the contents into the scene and has the callback change it, in the caller's thread."""
    mujoco.mjv_updateScene(*contents, scene)
    callback(physics, scene)


def _renewed(scene: MjvScene) -> MjvScene:
    """The scene as if it had never been filled."""
    # MuJoCo centres infinite planes, and with them their textures, where the camera was before.
    for eye in scene.camera:
        eye.pos[:] = 0.0
    return scene
