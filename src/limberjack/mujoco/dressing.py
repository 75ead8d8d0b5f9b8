"""Draws a `Look`: the appearance of an episode, given to a scene after it was filled.

    look = look_of(physics)                             # None: as the model is
    mujoco.mjv_updateScene(*contents, scene)
    dress(look, scene, contents)                        # colours, and the camera's pose
    stage = staged(look, model, data)                   # the model whose textures are drawn
    picture = behind(look, picture, time)               # a video in place of green pixels
    model = dressed(look, model, data)                  # for a viewer that draws a model by itself

Neither the model nor the data changes: simulations share the model, and tasks measure the data.
Textures belong to OpenGL, which takes them from a model, so those that differ are in a `stage`, a
copy of the model with small textures. The appearance is described in `limberjack.worlds`.
"""

import copy
import weakref
from collections.abc import Mapping

import mujoco
import numpy as np

from limberjack.mujoco.pictures import Contents
from limberjack.mujoco.rendering import share_changing
from limberjack.mujoco.rendering.uploads import FIELDS
from limberjack.mujoco.wrapper import MjvScene
from limberjack.mujoco.wrapper.textures import with_textures
from limberjack.mujoco.wrapper.visual import RenderFlag
from limberjack.worlds.appearance.backdrop import on_green_screen
from limberjack.worlds.appearance.colors import GREEN, repainted_floor, repainted_sky
from limberjack.worlds.appearance.looks import Look
from limberjack.worlds.appearance.viewpoint import Pose, distracted, sphere_of, turned

__all__ = ["behind", "dress", "dressed", "flags_for", "look_of", "staged"]

_SKY = mujoco.mjtTexture.mjTEXTURE_SKYBOX.value
_FLAT = mujoco.mjtTexture.mjTEXTURE_2D.value
_TRACKS = mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM.value
_COLOURS = mujoco.mjtTextureRole.mjTEXROLE_RGB.value
_FLOOR, _BODY = "grid", "self"  # materials of the suite's common/materials.xml
_SAMPLED = 4099  # bytes from one to the next; a prime, so that they are of all channels
_MOST_SKY = 256  # pixels of a side of a sky that is repainted; a film of 480 shows half of a side
# Opacity of the floor before a background: DCS has 0 for the reacher, whose camera looks straight
# down, 1 where the camera follows the body (walker, cheetah), and 0.3 for the other three domains.
_SEEN_FROM_ABOVE, _WALKED_ON, _OTHERWISE = 0.0, 1.0, 0.3

# Of models: the centre of mass of the first body's tree in the model's initial pose, (3,).
_centres: weakref.WeakKeyDictionary[mujoco.MjModel, np.ndarray] = weakref.WeakKeyDictionary()
# Of models: bytes from all over the sky, by which an edit is noticed, and the sky in few pixels.
_small_skies: weakref.WeakKeyDictionary[mujoco.MjModel, tuple[bytes, np.ndarray]] = (
    weakref.WeakKeyDictionary()
)
# Of looks: the model, and its textures in the colours of the palette.
_palettes: weakref.WeakKeyDictionary[
    Look, tuple[weakref.ref[mujoco.MjModel], dict[int, np.ndarray]]
] = weakref.WeakKeyDictionary()
# Of simulations: two that share a model may be drawn at the same time.
_stages: weakref.WeakKeyDictionary[mujoco.MjData, "_Stage"] = weakref.WeakKeyDictionary()


def look_of(physics: object) -> Look | None:
    """The look with which a physics is drawn; None for that of the model."""
    simulation = getattr(physics, "simulation", None)
    return None if simulation is None else getattr(simulation, "look", None)


def flags_for(look: Look, flags: Mapping[RenderFlag, bool]) -> Mapping[RenderFlag, bool]:
    """Overrides of rendering flags with which a background is seen."""
    if look.options.background is None:
        return flags
    return {**flags, "skybox": True}


def dress(look: Look, scene: MjvScene, contents: Contents) -> None:
    """Changes the colours and the camera of a scene that was just filled."""
    model, data, _, _, view, _ = contents
    _color(look, scene, model, data.time)
    _aim(look, scene, model, data, view)


def behind(look: Look, picture: np.ndarray, time: float) -> np.ndarray:
    """The finished picture, with the background in place of green pixels if it belongs there."""
    if look.options.place != "picture":
        return picture
    frame = look.background(time)
    return picture if frame is None else on_green_screen(picture, frame)


def staged(look: Look, model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjModel | None:
    """A model with the textures of a look, valid until the next call; None if they are its own."""
    textures = _textures(look, model, data.time)
    if not textures:
        return None
    stage = _stages.get(data)
    if stage is None or not stage.fits(model, textures):
        stage = _stages[data] = _Stage(model, textures)
    stage.paint(textures)
    stage.follow(model)
    return stage.model


def dressed(look: Look, model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjModel:
    """A copy of the model in the look of this moment, for a viewer that draws a model by itself.

    It has the colours, the textures and the poses of the model's cameras. A background in the
    finished picture is on the sky, and the floor that it would cover is not there.
    """
    textures, sky = dict(_of_palette(look, model)), _sky(model)
    frame = look.background(data.time)
    if frame is not None and sky is not None:
        textures[sky] = frame
    made = with_textures(model, textures) if textures else copy.copy(model)
    made.mat_rgba[:] = _materials(look, model, data.time)
    floor, options = _material(model, _FLOOR), look.options
    if options.place == "picture" and options.floor is not None and floor >= 0:
        made.mat_rgba[floor, 3] = options.floor
    for number in range(model.ncam):
        _place(made, data, number, _aimed(look, _pose_in(data, number), model, data, number))
    return made


def _place(model: mujoco.MjModel, data: mujoco.MjData, number: int, pose: Pose) -> None:
    """Gives a camera of a model a pose in the world, which it then keeps in its own mode."""
    body = model.cam_bodyid[number]
    axes = data.xmat[body].reshape(3, 3)
    offset = pose.position - data.xpos[body]
    model.cam_pos[number] = axes.T @ offset
    mujoco.mju_mat2Quat(model.cam_quat[number], np.ravel(axes.T @ pose.axes))
    # Of cameras that follow a body without turning with it.
    model.cam_pos0[number], model.cam_mat0[number] = offset, np.ravel(pose.axes)
    model.cam_poscom0[number] = pose.position - data.subtree_com[body]


class _Stage:
    """A copy of a model with textures of other sizes."""

    def __init__(self, model: mujoco.MjModel, textures: Mapping[int, np.ndarray]) -> None:
        self.model = with_textures(model, textures)
        share_changing(self.model)
        self._original, self._shapes = weakref.ref(model), _shapes(textures)

    def fits(self, model: mujoco.MjModel, textures: Mapping[int, np.ndarray]) -> bool:
        """Whether it was made of this model, for textures of these sizes."""
        return self._original() is model and self._shapes == _shapes(textures)

    def paint(self, textures: Mapping[int, np.ndarray]) -> None:
        """Sets the textures; the next picture uploads those that changed."""
        for number, pixels in textures.items():
            start = self.model.tex_adr[number]
            self.model.tex_data[start : start + pixels.size] = pixels.reshape(-1)

    def follow(self, model: mujoco.MjModel) -> None:
        """Takes the height fields and meshes of the model, which an episode may have changed."""
        for name in FIELDS:
            if not name.startswith("tex_") and getattr(model, name).size:
                np.copyto(getattr(self.model, name), getattr(model, name))


def _shapes(textures: Mapping[int, np.ndarray]) -> dict[int, tuple[int, ...]]:
    return {number: pixels.shape for number, pixels in textures.items()}


def _textures(look: Look, model: mujoco.MjModel, time: float) -> dict[int, np.ndarray]:
    """Textures of the model by number that look otherwise, (height, width, 3) uint8."""
    options = look.options
    textures = dict(_of_palette(look, model))
    sky, floor = _sky(model), _floor_texture(model)
    if options.background is None or sky is None:
        return textures
    if options.place == "picture":
        # One colour needs no more pixels.
        green = np.full((8, 8, 3), GREEN)
        if floor is not None and options.floor == 0.0:
            textures[floor] = green
        return {**textures, sky: green}
    frame = look.background(time)
    return textures if frame is None else {**textures, sky: frame}


def _of_palette(look: Look, model: mujoco.MjModel) -> dict[int, np.ndarray]:
    """Textures of the model by number in the colours of a palette, drawn once for an episode."""
    palette = look.palette
    if palette is None:
        return {}
    kept = _palettes.get(look)
    if kept is not None and kept[0]() is model:
        return kept[1]
    sky, floor = _sky(model), _floor_texture(model)
    textures = {}
    if sky is not None:
        textures[sky] = repainted_sky(_small_sky(model, sky), palette.sky)
    if floor is not None:
        colors = palette.floor, palette.second_floor
        textures[floor] = repainted_floor(_pixels(model, floor), *colors)
    _palettes[look] = weakref.ref(model), textures
    return textures


def _color(look: Look, scene: MjvScene, model: mujoco.MjModel, time: float) -> None:
    """Colours the geoms whose colour is that of their material."""
    wanted = _materials(look, model, time)
    changed = (wanted != model.mat_rgba).any(axis=-1)
    for geom in scene.geoms if changed.any() else ():
        number = geom.matid
        # A geom may have a colour of its own, which hides that of its material.
        if number >= 0 and changed[number] and (geom.rgba == model.mat_rgba[number]).all():
            geom.rgba[:] = wanted[number]


def _materials(look: Look, model: mujoco.MjModel, time: float) -> np.ndarray:
    """Colours and opacities of the model's materials with a look, (n, 4), 0 to 1."""
    wanted = model.mat_rgba.copy()
    colors = look.colors(wanted[:, :3].astype(float), time)
    if colors is not None:
        wanted[:, :3] = colors
    if look.palette is not None and (body := _material(model, _BODY)) >= 0:
        wanted[body, :3] = look.palette.body
    floor = _material(model, _FLOOR)
    opacity = _opacity(look, model)
    if opacity is not None and floor >= 0:
        wanted[floor, 3] = opacity
    return wanted


def _opacity(look: Look, model: mujoco.MjModel) -> float | None:
    """Opacity of the floor before a background in the scene; None for the model's."""
    options = look.options
    if options.background is None or options.place == "picture":
        return None
    if options.floor is not None:
        return float(options.floor)
    if not model.ncam:
        return _OTHERWISE
    if model.cam_mode[0] == _TRACKS:
        return _WALKED_ON
    place = sphere_of(model.cam_pos[0])
    return _SEEN_FROM_ABOVE if place.vertical == 0.0 else _OTHERWISE


def _aim(
    look: Look,
    scene: MjvScene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    view: mujoco.MjvCamera,
) -> None:
    """Moves and turns the camera of the scene, which has an eye on the left and on the right."""
    options = look.options
    if options.camera is None and options.shift is None and options.rotate is None:
        return
    eyes = scene.camera
    pose = _aimed(look, _pose(scene, data, view.fixedcamid), model, data, view.fixedcamid)
    apart = model.vis.global_.ipd / 2 * pose.axes[:, 0]
    for eye, side in zip(eyes, (-apart, apart), strict=True):
        eye.pos[:], eye.forward[:], eye.up[:] = (
            pose.position + side,
            -pose.axes[:, 2],
            pose.axes[:, 1],
        )


def _aimed(look: Look, pose: Pose, model: mujoco.MjModel, data: mujoco.MjData, number: int) -> Pose:
    """The pose of a camera with a look, from that without one."""
    if look.options.camera is not None:
        pose = _moved(look, pose, model, data, number)
    for turn in look.turns(model.names.split(b"\0", 1)[0].decode()):
        pose = turned(pose, turn)
    return pose


def _pose(scene: MjvScene, data: mujoco.MjData, number: int) -> Pose:
    """The pose of a camera; only the scene knows that of the free one."""
    if number >= 0:
        return _pose_in(data, number)
    eyes = scene.camera
    position = np.mean([eye.pos for eye in eyes], axis=0, dtype=float)
    forward, up = (np.asarray(part, float) for part in (eyes[0].forward, eyes[0].up))
    return Pose(position, np.stack([np.cross(forward, up), up, -forward], axis=-1))


def _pose_in(data: mujoco.MjData, number: int) -> Pose:
    """The pose of a model's camera."""
    return Pose(data.cam_xpos[number].copy(), data.cam_xmat[number].reshape(3, 3).copy())


def _moved(
    look: Look,
    pose: Pose,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    number: int,
) -> Pose:
    """The pose of a camera on its sphere, around the world's origin or the body that it follows."""
    body = min(1, model.nbody - 1)  # of the first tree, as in DCS
    is_fixed = number < 0 or model.cam_bodyid[number] == 0
    centre = np.zeros(3) if is_fixed else data.subtree_com[body]
    # DCS begins with the camera's place at the start of the episode. The model's initial pose gives
    # the same place to its cameras, which are fixed or keep their distance from the body.
    begin = sphere_of(pose.position if is_fixed else model.cam_poscom0[number])
    distance = np.linalg.norm(pose.position - (_centre(model) if is_fixed else centre))
    lookat = pose.position - pose.axes[:, 2] * distance
    found = look.place(number, begin, data.time)
    assert found is not None
    return distracted(pose, *found, begin, centre, lookat)


def _centre(model: mujoco.MjModel) -> np.ndarray:
    """Centre of mass of the first body's tree in the model's initial pose, (3,)."""
    centre = _centres.get(model)
    if centre is None:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        centre = _centres[model] = data.subtree_com[min(1, model.nbody - 1)].copy()
    return centre


def _sky(model: mujoco.MjModel) -> int | None:
    """The number of the sky's texture."""
    found = np.flatnonzero(model.tex_type == _SKY)
    return int(found[0]) if found.size else None


def _material(model: mujoco.MjModel, name: str) -> int:
    """The number of a material; -1 if there is none."""
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_MATERIAL.value, name)


def _floor_texture(model: mujoco.MjModel) -> int | None:
    """The number of the floor's texture."""
    material = _material(model, _FLOOR)
    number = int(model.mat_texid[material, _COLOURS]) if material >= 0 else -1
    return number if number >= 0 and model.tex_type[number] == _FLAT else None


def _pixels(model: mujoco.MjModel, number: int) -> np.ndarray:
    """A texture of the model, (height, width, 3) uint8."""
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    start, channels = int(model.tex_adr[number]), int(model.tex_nchannel[number])
    pixels = model.tex_data[start : start + height * width * channels]
    return pixels.reshape(height, width, channels)[..., :3]


def _small_sky(model: mujoco.MjModel, number: int) -> np.ndarray:
    """The sky with sides of a few pixels, each the mean of those that it stands for."""
    pixels = _pixels(model, number)
    sample = pixels.reshape(-1)[::_SAMPLED].tobytes()
    kept = _small_skies.get(model)
    if kept is not None and kept[0] == sample:
        return kept[1]
    width = pixels.shape[1]
    share = -(-width // _MOST_SKY)
    while width % share:
        share += 1
    blocks = pixels.reshape(-1, share, width // share, share, 3)
    small = blocks.mean(axis=(1, 3)).astype(np.uint8)
    _small_skies[model] = sample, small
    return small
