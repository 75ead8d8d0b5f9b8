"""Cameras: RGB, depth and segmentation images of a physics.

    camera = Camera(physics, height=240, width=320, camera_id="side")
    rgb = camera.render()
    metres = camera.render(depth=True)
    numbers = camera.render(segmentation=True)[..., 0]
    physics.render(overlays=[TextOverlay("reward", "0.93", position="bottom left")])

The pixels equal dm_control's. Every picture is a fresh array. Creating and moving a camera and
computing its matrix do not need OpenGL; only pictures do (see `rendering`).
"""

import inspect
import operator
import threading
import weakref
from collections.abc import Callable, Generator, Iterable, Mapping
from typing import Any, NamedTuple, Protocol, TypeVar

import mujoco
import numpy as np

from limberjack.mujoco.dressing import behind, dress, flags_for, look_of, staged
from limberjack.mujoco.pictures import Contents, Overlay, Style, draw, finished
from limberjack.mujoco.rendering import Contexts, Pending, RenderingError, contexts, prepare
from limberjack.mujoco.wrapper import MjData, MjModel, MjvCamera, MjvOption, MjvScene
from limberjack.mujoco.wrapper.util import to_binary_string
from limberjack.mujoco.wrapper.visual import RenderFlag
from limberjack.utils import suggest

__all__ = [
    "FREE_CAMERA",
    "Camera",
    "CameraMatrices",
    "Contexts",
    "Drawable",
    "Drawing",
    "MovableCamera",
    "Pose",
    "RenderingError",
    "SceneCallback",
    "Selected",
    "TextOverlay",
    "begin_render",
    "check_names",
    "checked_size",
    "completed",
    "contexts",
    "picture_spec",
    "render",
    "view_of",
]

_T = TypeVar("_T")
# A picture in two steps: yields the call that draws it, and returns the picture.
Drawing = Generator[Pending[np.ndarray], None, np.ndarray]
# Called with the physics and the scene.
SceneCallback = Callable[..., None]

FREE_CAMERA = -1  # used in place of a camera id
_EVERYTHING = mujoco.mjtCatBit.mjCAT_ALL.value
# The default visualisation options of `render`.
_DEFAULT_OPTION = MjvOption()
# Scenes for reuse by `render`, per model: creating one takes much longer than filling it.
_spare_scenes: weakref.WeakKeyDictionary[mujoco.MjModel, list[MjvScene]] = (
    weakref.WeakKeyDictionary()
)
_MOST_SPARE_SCENES = 4
_FONTS = {
    "normal": mujoco.mjtFont.mjFONT_NORMAL,
    "shadow": mujoco.mjtFont.mjFONT_SHADOW,
    "big": mujoco.mjtFont.mjFONT_BIG,
}
_POSITIONS = {
    "top left": mujoco.mjtGridPos.mjGRID_TOPLEFT,
    "top right": mujoco.mjtGridPos.mjGRID_TOPRIGHT,
    "bottom left": mujoco.mjtGridPos.mjGRID_BOTTOMLEFT,
    "bottom right": mujoco.mjtGridPos.mjGRID_BOTTOMRIGHT,
}


class Drawable(Protocol):
    """A simulation that can be drawn, such as `mujoco.Physics`."""

    @property
    def model(self) -> MjModel: ...

    @property
    def data(self) -> MjData: ...


class Selected(NamedTuple):
    """Ids of the objects visible at a point of a picture, None for none."""

    body: int | None
    geom: int | None
    flex: int | None
    skin: int | None
    world_position: np.ndarray | None


class Pose(NamedTuple):
    """Pose of a free camera: the point it looks at, the distance (metres), two angles (degrees)."""

    lookat: np.ndarray
    distance: float
    azimuth: float
    elevation: float


class CameraMatrices(NamedTuple):
    """Factors of a camera matrix: `image @ focal @ rotation @ translation`."""

    image: np.ndarray
    focal: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray


class Camera:
    """A view of a physics, with a fixed size.

    Changes to `camera.scene.flags` and `camera.option` apply to all later pictures.
    """

    def __init__(
        self,
        physics: Drawable,
        height: int = 240,
        width: int = 320,
        camera_id: int | str = FREE_CAMERA,
        max_geom: int | None = None,
        scene_callback: SceneCallback | None = None,
    ) -> None:
        """Makes a camera; does not need OpenGL.

        Args:
          physics: the simulation to draw.
          height: pixels.
          width: pixels.
          camera_id: name or number of a camera of the model; -1 is the free camera.
          max_geom: maximum number of geoms in the scene; by default enough for the model and its
            decorations.
          scene_callback: called with the physics and the scene before the scene is drawn; it may
            add geoms.

        Raises:
          ValueError: there is no such camera, or the size is not positive or exceeds the model's
            off-screen buffer.
          TypeError: the physics is of a batch.
        """
        if getattr(physics, "num_envs", None) is not None:
            raise TypeError(
                "a camera cannot show the physics of a batch: call render(rows, ...) of its "
                "BatchEnvironment"
            )
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
        """Visualisation options used unless `render` is given others."""
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
        model, data = self._physics.model._official, self._physics.data._data
        number = self._render_camera.fixedcamid
        if number == FREE_CAMERA:
            # Only the scene knows the pose, for a left and a right eye; the camera is in between.
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
        # The same order of operations as in dm_control, for bitwise equality.
        scale = (1.0 / np.tan(np.deg2rad(fovy) / 2)) * self.height / 2.0
        focal = np.diag([-scale, scale, 1.0, 0])[:3]
        return CameraMatrices(image, focal, rotation, translation)

    def update(self, scene_option: mujoco.MjvOption | None = None) -> None:
        """Updates the scene to the physics' current state.

        Args:
          scene_option: a `wrapper.MjvOption` to use instead of the camera's.
        """
        with self._lock:
            mujoco.mjv_updateScene(*self._contents(scene_option), self._scene)

    def _contents(self, scene_option: mujoco.MjvOption | None) -> Contents:
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
        """A picture of the physics' current state.

        Args:
          overlays: text to draw on the picture, RGB only.
          depth: return depth instead of RGB.
          segmentation: return object ids instead of RGB.
          scene_option: a `wrapper.MjvOption` to use instead of the camera's.
          render_flag_overrides: rendering flags for this picture, by name ('wireframe', 'shadow')
            or `mujoco.mjtRndFlag`, RGB only.
          quality: 'full', whose pixels equal dm_control's, or 'fast', without shadows, reflections
            and sky: several times as fast with a software renderer.

        Returns:
          (height, width, 3) uint8 RGB; or (height, width) float32 depth in metres along the
          camera's axis; or (height, width, 2) int32 object id and `mjtObj` type, both -1 for the
          background.

        Raises:
          ValueError: incompatible arguments, or an unknown flag or quality.
          RenderingError: OpenGL is not available.
        """
        style = Style.of(overlays, depth, segmentation, render_flag_overrides, quality)
        size = self._height, self._width
        with self._lock:
            contents = self._contents(scene_option)
            what = self._scene, style, size, contents, self._scene_callback
            return completed(_drawing(self._physics, *what))

    def select(self, cursor_position: tuple[float, float]) -> Selected:
        """Objects visible at a point of the picture.

        Args:
          cursor_position: x and y from 0 to 1, measured from the lower left corner.
        """
        model, data = self._physics.model._official, self._physics.data._data
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
        is_nothing = body is geom is skin is None  # as in dm_control, which ignores flexes
        return Selected(body, geom, flex, skin, None if is_nothing else position)


class MovableCamera(Camera):
    """A movable free camera."""

    def __init__(
        self,
        physics: Drawable,
        height: int = 240,
        width: int = 320,
        max_geom: int | None = None,
        scene_callback: SceneCallback | None = None,
    ) -> None:
        """Starts at the pose of the model's free camera; arguments are those of `Camera`."""
        super().__init__(physics, height, width, FREE_CAMERA, max_geom, scene_callback)

    def get_pose(self) -> Pose:
        """The camera's pose."""
        camera = self._render_camera
        return Pose(camera.lookat.copy(), camera.distance, camera.azimuth, camera.elevation)

    def set_pose(
        self, lookat: np.ndarray, distance: float, azimuth: float, elevation: float
    ) -> None:
        """Moves the camera.

        Args:
          lookat: the point to look at, (3,), metres.
          distance: distance from that point, metres.
          azimuth: angle about the vertical axis, degrees.
          elevation: angle above the horizontal, degrees.
        """
        np.copyto(self._render_camera.lookat, lookat)
        self._render_camera.distance = distance
        self._render_camera.azimuth = azimuth
        self._render_camera.elevation = elevation


class TextOverlay:
    """A title and text drawn in a corner of a picture."""

    __slots__ = ("body", "position", "style", "title")

    def __init__(
        self,
        title: str = "",
        body: str = "",
        style: str = "normal",
        position: str = "top left",
    ) -> None:
        """Creates an overlay.

        Args:
          title: the left column.
          body: the right column.
          style: 'normal', 'shadow' or 'big'.
          position: 'top left', 'top right', 'bottom left' or 'bottom right'.

        Raises:
          ValueError: an unknown style or position.
        """
        self.title = title
        self.body = body
        self.style = _one_of("style", style, _FONTS)
        self.position = _one_of("position", position, _POSITIONS)

    def draw(self, context: mujoco.MjrContext, rect: mujoco.MjrRect) -> None:
        """Draws the text; called on the rendering thread."""
        title, body = to_binary_string(self.title), to_binary_string(self.body)
        mujoco.mjr_overlay(self.style, self.position, rect, title, body, context)


def _one_of(what: str, name: str, values: Mapping[str, _T]) -> _T:
    """The value with the given name; raises ValueError if there is none."""
    if name not in values:
        choices = ", ".join(map(repr, values))
        raise ValueError(
            f"{what} is {name!r}; expected one of: {choices}.{suggest.did_you_mean(name, values)}"
        )
    return values[name]


def checked_size(physics: Drawable, height: int, width: int) -> tuple[int, int]:
    """Height and width as ints; ValueError unless they fit the model's off-screen buffer."""
    limits = physics.model._official.vis.global_
    sizes = []
    for name, value, limit in (("height", height, "offheight"), ("width", width, "offwidth")):
        most = getattr(limits, limit)
        try:
            size = operator.index(value)
        except TypeError:
            size = 0
        if size < 1:
            raise ValueError(
                f"image {name} is {value!r}; expected a whole number of pixels, from 1 to {most}"
            )
        if size > most:
            raise ValueError(
                f"image {name} {size} > {most}, the {name} of the model's off-screen buffer. Use "
                f'less, or enlarge it: <visual><global {limit}="{size}"/></visual> in the MJCF'
            )
        sizes.append(size)
    return sizes[0], sizes[1]


def view_of(physics: Drawable, camera_id: int | str) -> MjvCamera:
    """The view of a camera, given by name or number, or of the free camera.

    Raises:
      TypeError: it is neither a name nor a number.
      ValueError: there is no such camera.
    """
    model = physics.model._official
    if isinstance(camera_id, str):
        number: int = physics.model.name2id(camera_id, "camera")
    else:
        try:
            number = operator.index(camera_id)
        except TypeError:
            raise TypeError(
                f"camera_id is {camera_id!r}; expected the name or the number of a camera, or -1, "
                "the free camera"
            ) from None
    if not FREE_CAMERA <= number < model.ncam:
        expected = f"a name, or a number from -1, the free camera, to {model.ncam - 1}"
        if not model.ncam:
            expected = "-1, the free camera"
        raise ValueError(
            f"camera_id is {number}; expected {expected}: the model has {model.ncam} cameras"
        )
    view = MjvCamera()
    view.fixedcamid = number
    if number == FREE_CAMERA:
        view.type = mujoco.mjtCamera.mjCAMERA_FREE
        mujoco.mjv_defaultFreeCamera(model, view)
    else:
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    return view


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
    scene_callback: SceneCallback | None = None,
    quality: str = "full",
) -> np.ndarray:
    """A picture as from a new `Camera`; scenes are cached for later pictures.

    Arguments, result and errors are those of `Camera` and `Camera.render`.
    """
    size = checked_size(physics, height, width)
    view = view_of(physics, camera_id)
    style = Style.of(overlays, depth, segmentation, render_flag_overrides, quality)
    return completed(_as_new(physics, size, view, style, scene_option, scene_callback))


# Any: each keyword of `render` has its own type.
def begin_render(physics: Drawable, given: Mapping[str, Any], thread: int) -> Drawing:
    """The picture that `render` returns, in two steps, drawn on one of several threads.

        drawing = begin_render(physics, {"quality": "fast"}, thread=1)
        next(drawing).start()
        ...                              # the physics must not change
        picture = completed(drawing)

    Args:
      physics: the simulation to draw.
      given: keyword arguments of `render`.
      thread: number of the rendering thread; see `rendering.prepare`.
    """
    how = {**_KEYWORDS, **given}
    size = checked_size(physics, how["height"], how["width"])
    style = Style.of(**{name: how[name] for name in _OF_STYLE})
    what = view_of(physics, how["camera_id"]), style, how["scene_option"], how["scene_callback"]
    return _as_new(physics, size, *what, thread)


def completed(drawing: Drawing) -> np.ndarray:
    """The picture of a drawing, as soon as there is one."""
    while True:
        try:
            next(drawing)
        except StopIteration as end:
            return end.value


def _as_new(
    physics: Drawable,
    size: tuple[int, int],
    view: MjvCamera,
    style: Style,
    scene_option: mujoco.MjvOption | None,
    scene_callback: SceneCallback | None,
    thread: int = 0,
) -> Drawing:
    """The picture of a new camera, whose scene may be one that was used before."""
    model = physics.model._official
    spares = _spare_scenes.setdefault(model, [])
    # A callback may keep the scene or change it permanently, and flexes and skins hidden by an
    # option would stay in it.
    is_reusable = scene_callback is None and (
        scene_option is None or not (model.nflex or model.nskin)
    )
    scene = _renewed(spares.pop()) if spares and is_reusable else MjvScene(model=physics.model)
    contents = _contents(physics, view, scene_option or _DEFAULT_OPTION)
    picture = yield from _drawing(physics, scene, style, size, contents, scene_callback, thread)
    if is_reusable and len(spares) < _MOST_SPARE_SCENES:
        spares.append(scene)
    return picture


# The keyword arguments of `render`, with their defaults.
_KEYWORDS = {p.name: p.default for p in list(inspect.signature(render).parameters.values())[1:]}
_OF_STYLE = ("overlays", "depth", "segmentation", "render_flag_overrides", "quality")


def check_names(given: Iterable[str]) -> None:
    """Raises TypeError for the name of a keyword that `render` does not accept."""
    suggest.check_names("render got an unexpected keyword argument", given, _KEYWORDS)


def picture_spec(
    physics: Drawable, given: Mapping[str, object]
) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and dtype of the picture that `render` returns for these arguments; draws nothing.

    Args:
      physics: a single simulation.
      given: keyword arguments of `render`.

    Raises:
      ValueError: there is no such camera or quality, the size is not positive or too large for the
        model, or the arguments are incompatible.
      TypeError: there is no such keyword.
    """
    check_names(given)
    how = {**_KEYWORDS, **given}
    Style.of(**{name: how[name] for name in _OF_STYLE})  # validates these arguments
    size = how["height"], how["width"]
    Camera(physics, *size, camera_id=how["camera_id"], max_geom=1)  # validates the others
    if how["depth"]:
        return size, np.dtype(np.float32)
    if how["segmentation"]:
        return (*size, 2), np.dtype(np.int32)
    return (*size, 3), np.dtype(np.uint8)


def _drawing(
    physics: Drawable,
    scene: MjvScene,
    style: Style,
    size: tuple[int, int],
    contents: Contents | None,
    callback: SceneCallback | None,
    thread: int = 0,
) -> Drawing:
    """A picture of a scene, which is updated first; a callback runs in the caller's thread."""
    model, look = physics.model._official, look_of(physics)
    stage, flags = None, style.flags
    if callback or look:
        assert contents is not None
        mujoco.mjv_updateScene(*contents, scene)
        if look:
            dress(look, scene, contents)
        if callback:
            callback(physics, scene)
        contents = None
    data = physics.data._data
    if look and style.is_rgb:
        stage, flags = staged(look, model, data), flags_for(look, flags)
    # Height fields, textures and meshes cannot change until user code has obtained them.
    is_new = physics.model._is_lent
    with scene.override_flags(flags):
        what = scene, style, *size, contents
        drawn = stage or model
        is_new = is_new or drawn is stage
        pending = prepare(drawn, draw, *what, size=size, may_have_changed=is_new, thread=thread)
        try:
            yield pending
            raw = pending.result()
        finally:  # also if the drawing is closed
            pending.settle()
    picture = finished(raw, style, model, scene)
    return behind(look, picture, data.time) if look and style.is_rgb else picture


def _contents(physics: Drawable, view: MjvCamera, option: mujoco.MjvOption) -> Contents:
    """Arguments of `mjv_updateScene` for the physics' current state."""
    return physics.model._official, physics.data._data, option, None, view, _EVERYTHING


def _renewed(scene: MjvScene) -> MjvScene:
    """The scene, reset to its state before it was first filled."""
    # MuJoCo centres infinite planes, and so their textures, on the camera's previous position.
    for eye in scene.camera:
        eye.pos[:] = 0.0
    return scene
