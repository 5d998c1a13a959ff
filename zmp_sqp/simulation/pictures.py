"""Pictures of replays, drawn by MuJoCo without a display: a strip of images or an animation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from zmp_sqp.arrays import Array
from zmp_sqp.errors import ProblemError
from zmp_sqp.simulation.engine import load_mujoco, load_pillow, open_canvas
from zmp_sqp.simulation.multibody import multibody_spec
from zmp_sqp.simulation.outcome import Replay
from zmp_sqp.simulation.shapes import Solid, machine_solids

__all__ = ["draw_strip", "draw_video"]

FIELD_OF_VIEW = np.radians(30.0)  # [rad] vertical field of view of the camera
CAMERA_PITCH = np.radians(8.0)  # [rad] angle by which the camera looks down
RATE = 20  # [1/s] frames of an animation
SKY = ((0.93, 0.95, 0.97), (0.80, 0.86, 0.92))  # red, green, blue of the colour gradient
SOIL = ((0.62, 0.60, 0.53), (0.57, 0.55, 0.48))  # red, green, blue of the two kinds of tiles
GROUND_SIZE = 1.6  # half edge of the drawn ground over the half height of the picture
INK = (40, 40, 40)  # red, green, blue of labels, 0 to 255
GEOMS = 1000  # capacity of MuJoCo's scene: largest number of geometries
SHADOW = 1024  # [pixels] edge of the shadow map
SPACE = 1.12  # size of the picture over that of the machine
LINE = 18  # [pixels] height of a label


def draw_strip(
    replays: Mapping[str, Replay], path: str | Path, *, moments: int = 5, width: int = 220
) -> None:
    """Draw one row of images per replay into one file.

    The times of the images are common to all rows and evenly spaced from the start to the end of
    the longest motion. The camera looks along the contour line of the slope, slightly downwards,
    with downhill on the left.

    Args:
        replays: Replays by label, all on one ground.
        path: File to write; its suffix determines the format.
        moments: Number of images in a row.
        width: Width of an image [pixels].

    Raises:
        MissingExtra: MuJoCo or Pillow is not installed, or OpenGL does not work here.
        ProblemError: No replays, or fewer than one moment.
    """
    if not replays or moments < 1:
        raise ProblemError("a strip needs at least one replay and one moment")
    image = load_pillow("Image")
    last = max(replay.trajectory.duration for replay in replays.values())
    times = np.linspace(0.0, last, moments)
    height = width * 5 // 6
    sheet = image.new("RGB", (moments * width, len(replays) * (height + LINE)), "white")
    for row, (label, replay) in enumerate(replays.items()):
        with _Stage.of(replay, width, height) as stage:
            for column, time in enumerate(times):
                picture = _labelled(
                    stage.draw(time), f"{label}, " * (column == 0) + _clock(replay, time)
                )
                sheet.paste(picture, (column * width, row * (height + LINE)))
    sheet.convert("P", palette=image.Palette.ADAPTIVE, colors=128).save(path, optimize=True)


def draw_video(replays: Mapping[str, Replay], path: str | Path, *, width: int = 360) -> None:
    """Draw an animation of replays side by side, in real time.

    Args:
        replays: Replays by label, all on one ground.
        path: File to write, GIF or WebP.
        width: Width of the image of one replay [pixels].

    Raises:
        MissingExtra: MuJoCo or Pillow is not installed, or OpenGL does not work here.
        ProblemError: No replays.
    """
    if not replays:
        raise ProblemError("a video needs at least one replay")
    image = load_pillow("Image")
    last = max(float(replay.times[-1]) for replay in replays.values())
    times = np.arange(0.0, last, 1.0 / RATE)
    height = width * 5 // 6
    frames = [image.new("RGB", (len(replays) * width, height + LINE), "white") for _ in times]
    for column, (label, replay) in enumerate(replays.items()):
        with _Stage.of(replay, width, height) as stage:
            for frame, time in zip(frames, times, strict=True):
                frame.paste(
                    _labelled(stage.draw(time), f"{label}, {_clock(replay, time)}"),
                    (column * width, 0),
                )
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=1000 // RATE, loop=0)


def _clock(replay: Replay, time: float) -> str:
    """Label of an image: its time, and whether the machine has fallen over by then."""
    over = replay.fell and bool(time > replay.times[-1])
    return f"{time:.1f} s" + ": has fallen over" * over


def _labelled(pixels: Array, text: str) -> Any:
    """Image of Pillow from pixels (height, width, 3), with a line of text above."""
    image, font = load_pillow("Image"), load_pillow("ImageFont")
    picture = image.new("RGB", (pixels.shape[1], pixels.shape[0] + LINE), "white")
    picture.paste(image.fromarray(pixels), (0, LINE))
    load_pillow("ImageDraw").Draw(picture).text((4, 1), text, fill=INK, font=font.load_default(13))
    return picture


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """Scene of one replay with an OpenGL context to draw it.

    Attributes:
        replay: Replay to be drawn.
        model: `mujoco.MjModel` of the machine with camera, light and ground.
        data: `mujoco.MjData`, the state that is drawn.
        scene: `mujoco.MjvScene`.
        context: `mujoco.MjrContext`.
        size: Width and height of an image [pixels].
    """

    replay: Replay
    model: Any
    data: Any
    scene: Any
    context: Any
    size: tuple[int, int]

    @classmethod
    @contextmanager
    def of(cls, replay: Replay, width: int, height: int) -> Iterator[_Stage]:
        """Context manager that opens a stage and frees its OpenGL context at the end.

        Args:
            replay: Replay to be drawn.
            width, height: Size of an image [pixels].
        """
        mujoco = load_mujoco()
        machine = replay.machine
        solids = machine_solids(machine)
        spec = multibody_spec(
            machine, replay.ground, time_step=1e-3, friction=(1.0, 1.0), solids=solids
        )
        _furnish(spec, _View.of(replay, solids, width / height), replay.support.height)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        model = spec.compile()
        canvas = open_canvas(width, height)
        try:
            context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
            yield cls(
                replay,
                model,
                mujoco.MjData(model),
                mujoco.MjvScene(model, GEOMS),
                context,
                (width, height),
            )
            context.free()
        finally:
            canvas.free()

    def draw(self, time: float) -> Array:
        """Image of the machine at a time [s], shape (height, width, 3), values 0 to 255."""
        mujoco, replay = load_mujoco(), self.replay
        now = min(int(np.searchsorted(replay.times, time)), len(replay.times) - 1)
        self.data.qpos[:7] = replay.poses[now]
        q = replay.trajectory(min(replay.times[now], replay.trajectory.duration))[0]
        for name, value in zip(replay.machine.joint_names, q, strict=True):
            self.data.joint(name).qpos = value
        mujoco.mj_forward(self.model, self.data)
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = (
            mujoco.mjtCamera.mjCAMERA_FIXED.value,
            self.model.camera("view").id,
        )
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self.model, self.data, mujoco.MjvOption(), None, camera, everything, self.scene
        )
        width, height = self.size
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        whole = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(whole, self.scene, self.context)
        mujoco.mjr_readPixels(pixels, None, whole, self.context)
        return np.ascontiguousarray(pixels[::-1])  # OpenGL's first row is the lowest


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Directions and size of a picture, in the root frame of the machine at rest.

    Attributes:
        up: Vertical unit vector, against gravity, shape (3,).
        left: Horizontal unit vector that points downhill, to the left in the picture, shape (3,).
        ahead: Horizontal unit vector along the contour line, away from the camera, shape (3,).
        middle: Centre of the box around the machine, shape (3,) [m].
        depth: Extent of this box along `ahead`, halved [m].
        half: Half height of the picture at the box's centre [m].
    """

    up: Array
    left: Array
    ahead: Array
    middle: Array
    depth: float
    half: float

    @classmethod
    def of(cls, replay: Replay, solids: Sequence[Solid], aspect: float) -> _View:
        """View that shows the machine in all its positions.

        Args:
            replay: Replay to be drawn.
            solids: Solids of the machine.
            aspect: Width of the picture over its height.
        """
        gravity = np.array(replay.ground.gravity())
        up = -gravity / np.linalg.norm(gravity)
        downhill = gravity[:2]
        downhill = (
            downhill / np.linalg.norm(downhill)
            if np.linalg.norm(downhill) > 1e-9  # [m/s^2] on level ground any direction will do
            else np.array([0.0, 1.0])
        )
        left = np.array([*downhill, 0.0])
        left = left - (left @ up) * up
        left /= np.linalg.norm(left)
        ahead = np.cross(left, up)
        axes = np.column_stack([left, up, ahead])
        seen = _reach(replay, solids) @ axes  # (P, 3)
        middle = axes @ (0.5 * (seen.min(axis=0) + seen.max(axis=0)))
        size = 0.5 * np.ptp(seen, axis=0)
        half = SPACE * max(size[0] / aspect, size[1])
        return cls(up, left, ahead, middle, float(size[2]), float(half))


def _furnish(spec: Any, view: _View, floor: float) -> None:
    """Add a camera, light, sky and soil to the description of a machine.

    Args:
        spec: `mujoco.MjSpec` of the machine.
        view: Directions and size of the picture.
        floor: z of the ground in the root frame at rest [m].
    """
    _add_camera(spec, view)
    _add_light(spec, view)
    _add_sky_and_soil(spec, view, floor)


def _add_camera(spec: Any, view: _View) -> None:
    look = np.cos(CAMERA_PITCH) * view.ahead - np.sin(CAMERA_PITCH) * view.up
    distance = view.half / np.tan(0.5 * FIELD_OF_VIEW) + 0.5 * view.depth
    position = view.middle - distance * look
    # right, up, backwards
    frame = np.column_stack([-view.left, np.cross(-look, -view.left), -look])
    turn = pin.Quaternion(frame)
    spec.worldbody.add_camera(
        name="view",
        pos=position,
        quat=[turn.w, turn.x, turn.y, turn.z],
        fovy=float(np.degrees(FIELD_OF_VIEW)),
    )


def _add_light(spec: Any, view: _View) -> None:
    mujoco = load_mujoco()
    spec.visual.map.zfar, spec.visual.quality.shadowsize = 1e3, SHADOW
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.35] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=list(10.0 * view.half * view.up),
        diffuse=[0.45] * 3,
        dir=list(-view.up - 0.3 * view.left + 0.4 * view.ahead),
        castshadow=True,
    )


def _add_sky_and_soil(spec: Any, view: _View, floor: float) -> None:
    mujoco = load_mujoco()
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=64,
        height=384,
        rgb1=SKY[0],
        rgb2=SKY[1],
    )
    spec.add_texture(
        name="soil",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        width=256,
        height=256,
        rgb1=SOIL[0],
        rgb2=SOIL[1],
    )
    soil = spec.add_material(name="soil", texrepeat=[0.5, 0.5], texuniform=True)
    soil.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "soil"
    edge, thickness = GROUND_SIZE * view.half, 0.05 * view.half
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[edge, edge, thickness],
        pos=[*view.middle[:2], floor - thickness],
        material="soil",
        contype=0,
        conaffinity=0,
    )


def _reach(replay: Replay, solids: Sequence[Solid]) -> Array:
    """Corners of boxes around the solids at 12 times of the motion, root frame, (P, 3) [m]."""
    machine = replay.machine
    data = machine.model.createData()
    states = machine.configuration(
        replay.trajectory(np.linspace(0.0, replay.trajectory.duration, 12))[0]
    )
    points = []
    for state in states:
        pin.forwardKinematics(machine.model, data, state)
        for solid in solids:
            placement = data.oMi[solid.joint] * solid.placement
            size = np.array([*solid.size, solid.size[0], solid.size[0]])[:3]
            half = size if solid.kind == "box" else np.array([size[0], size[0], size[1]])
            reach = np.abs(placement.rotation) @ half
            points += [placement.translation - reach, placement.translation + reach]
    return np.array(points)
