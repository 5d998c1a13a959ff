"""Pictures of replays, drawn by MuJoCo without a display: a strip of moments, or a moving picture."""

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

FIELD = np.radians(30.0)  # of view, upright
ABOVE = np.radians(8.0)  # how far the camera looks down
RATE = 20  # [1/s] frames of a moving picture
SKY = ((0.93, 0.95, 0.97), (0.80, 0.86, 0.92))
SOIL = ((0.62, 0.60, 0.53), (0.57, 0.55, 0.48))
GROUND, INK = 1.6, (40, 40, 40)  # half edge of the drawn ground as a share of the view's
GEOMS = 1000  # room for what is drawn
SHADOW = 1024  # [pixels] of the map that shadows are read from
ROOM = 1.12  # around the machine, as a share of the view
LINE = 18  # [pixels] of a label


def draw_strip(
    replays: Mapping[str, Replay], path: str | Path, *, moments: int = 5, width: int = 220
) -> None:
    """A row of moments per replay, at the same times in all rows, from start to end of the longest motion.

    The camera looks level along the contour of the slope, from the side that shows downhill to the
    left.

    Args:
        replays: By label; of machines on the same ground.
        path: File to write; its ending chooses the format.
        moments: How many pictures a row has.
        width: Of each [pixels].

    Raises:
        MissingExtra: MuJoCo or Pillow is not installed, or there is no way to draw on this machine.
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
    """A moving picture (GIF or WebP) of replays side by side, in real time; arguments as in `draw_strip`."""
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
    over = replay.fell and bool(time > replay.times[-1])
    return f"{time:.1f} s" + ": has fallen over" * over


def _labelled(pixels: Array, text: str) -> Any:
    image, font = load_pillow("Image"), load_pillow("ImageFont")
    picture = image.new("RGB", (pixels.shape[1], pixels.shape[0] + LINE), "white")
    picture.paste(image.fromarray(pixels), (0, LINE))
    load_pillow("ImageDraw").Draw(picture).text((4, 1), text, fill=INK, font=font.load_default(13))
    return picture


@dataclass(frozen=True, slots=True, eq=False)
class _Stage:
    """The scene of one replay, on a canvas of OpenGL."""

    replay: Replay
    model: Any
    data: Any
    scene: Any
    context: Any
    size: tuple[int, int]

    @classmethod
    @contextmanager
    def of(cls, replay: Replay, width: int, height: int) -> Iterator[_Stage]:
        """Open it, and close its canvas at the end."""
        mujoco = load_mujoco()
        machine = replay.machine
        solids = machine_solids(machine)
        spec = multibody_spec(
            machine, replay.ground, time_step=1e-3, friction=(1.0, 1.0), solids=solids
        )
        _furnish(mujoco, spec, replay, solids, width / height)
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
        """The machine at a time, shape (height, width, 3), 0 to 255."""
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
        return np.ascontiguousarray(pixels[::-1])  # OpenGL's rows run upwards


def _furnish(
    mujoco: Any, spec: Any, replay: Replay, solids: Sequence[Solid], aspect: float
) -> None:
    """Sky, soil, light and a camera that sees the machine wherever it moves to."""
    gravity = np.array(replay.ground.gravity())
    up = -gravity / np.linalg.norm(gravity)
    downhill = gravity[:2]
    downhill = (
        downhill / np.linalg.norm(downhill)
        if np.linalg.norm(downhill) > 1e-9
        else np.array([0.0, 1.0])
    )
    left = np.array([*downhill, 0.0])
    left = left - (left @ up) * up
    left /= np.linalg.norm(left)
    ahead = np.cross(left, up)  # level, along the contour
    axes = np.column_stack([left, up, ahead])
    seen = _reach(replay, solids) @ axes  # (P, 3)
    middle, size = axes @ (0.5 * (seen.min(axis=0) + seen.max(axis=0))), 0.5 * np.ptp(seen, axis=0)
    half = ROOM * max(size[0] / aspect, size[1])
    look = np.cos(ABOVE) * ahead - np.sin(ABOVE) * up
    place = middle - (half / np.tan(0.5 * FIELD) + 0.5 * size[2]) * look
    frame = np.column_stack([-left, np.cross(-look, -left), -look])  # right, up, backwards
    turn = pin.Quaternion(frame)
    spec.worldbody.add_camera(
        name="view", pos=place, quat=[turn.w, turn.x, turn.y, turn.z], fovy=float(np.degrees(FIELD))
    )
    spec.visual.map.zfar, spec.visual.quality.shadowsize = 1e3, SHADOW
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.45] * 3, [0.35] * 3
    spec.visual.headlight.specular = [0.0] * 3
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=list(10.0 * half * up),
        diffuse=[0.45] * 3,
        dir=list(-up - 0.3 * left + 0.4 * ahead),
        castshadow=True,
    )
    sky, checker = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtTexture.mjTEXTURE_2D
    spec.add_texture(
        name="sky",
        type=sky,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=64,
        height=384,
        rgb1=SKY[0],
        rgb2=SKY[1],
    )
    spec.add_texture(
        name="soil",
        type=checker,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        width=256,
        height=256,
        rgb1=SOIL[0],
        rgb2=SOIL[1],
    )
    soil = spec.add_material(name="soil", texrepeat=[0.5, 0.5], texuniform=True)
    soil.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "soil"
    width = GROUND * half
    centre = [*middle[:2], replay.support.height - 0.05 * half]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[width, width, 0.05 * half],
        pos=centre,
        material="soil",
        contype=0,
        conaffinity=0,
    )


def _reach(replay: Replay, solids: Sequence[Solid]) -> Array:
    """Points that the machine's solids come to, standing, root frame, shape (P, 3) [m]."""
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
