"""Animated pictures of a walk: the robot beside the watts of its drives.

The robot is drawn offscreen, in the poses of the recording; its watts are those of the meter.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image as Pictures
from power_estimator.model import PowerModel
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from sim_bridge.plant.anymal_model import build_spec
from wattwalk_core.anymal import JOINT_NAMES, JOINT_TYPES, LEGS
from wattwalk_core.arrays import Floats, Singles
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole

from policy_training.evaluation.measured_walk import columns_of, values_at

_WINDOW: Final = 2.0  # s of power in view
_MEAN: Final = 0.6  # s, about a stride, of the numbers
_ROBOT: Final = (400, 480)  # pixels, height and width
_COLOURS: Final = {'HAA': '#0072b2', 'HFE': '#d55e00', 'KFE': '#009e73'}  # Okabe-Ito
_PARTS: Final = {'HAA': 'HIP', 'HFE': 'THIGH', 'KFE': 'SHANK'}  # which these drives move
_PLACES: Final = {'HAA': 'hip, sideways', 'HFE': 'hip, forward', 'KFE': 'knee'}
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Clip:
    """Part of a walk that is shown; as long as a number of strides it can go round in a loop."""

    start: float = 3.0  # s
    seconds: float = 6.0
    frames: int = 96
    title: str = ''


def _poses(walk: Recording, times: Floats) -> Floats:
    """Return MuJoCo's qpos [T, 19] at these times, from odometry and joint states."""
    odom, joints = walk.odom(), walk.joint_states()
    columns = [joints.names.index(name) for name in JOINT_NAMES]
    base = np.hstack([odom.position, odom.orientation[:, [3, 0, 1, 2]]])
    angles = values_at(times, joints.stamp_ns * 1e-9, joints.position[:, columns])
    return np.hstack([values_at(times, odom.stamp_ns * 1e-9, base), angles])


def _robot_images(qpos: Floats) -> Iterator[Image]:
    """Yield the robot in each pose, seen by a camera that goes along."""
    spec = build_spec()
    spec.add_texture(
        name='tiles',
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.84, 0.86, 0.88],
        rgb2=[0.72, 0.75, 0.78],
        width=256,
        height=256,
    )
    material = spec.add_material(name='tiles', texrepeat=[2, 2], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = 'tiles'
    sky = spec.add_texture(name='sky', type=mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    sky.builtin, sky.width, sky.height = mujoco.mjtBuiltin.mjBUILTIN_FLAT, 64, 384
    sky.rgb1 = sky.rgb2 = [1.0, 1.0, 1.0]
    spec.geom('floor').material, spec.geom('floor').rgba = 'tiles', [1.0, 1.0, 1.0, 1.0]
    spec.geom('base').rgba = [0.24, 0.27, 0.30, 1.0]
    for leg, kind in product(LEGS, JOINT_TYPES):
        spec.geom(f'{leg}_{_PARTS[kind]}').rgba = to_rgba(_COLOURS[kind])
    model = spec.compile()
    model.vis.global_.offwidth, model.vis.global_.offheight = _ROBOT[1], _ROBOT[0]
    model.vis.headlight.ambient[:] = 0.38
    model.vis.headlight.diffuse[:] = 0.22
    model.vis.map.zfar = 40.0
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 1.75, 128.0, -14.0
    with mujoco.Renderer(model, *_ROBOT) as renderer:
        # The map of shadows is centred on the origin, which the robot leaves.
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        for pose in qpos:
            data.qpos[:] = pose
            mujoco.mj_forward(model, data)
            camera.lookat[:] = (pose[0], pose[1], 0.33)
            renderer.update_scene(data, camera)
            yield renderer.render().copy()


def _by_type(data: AlignedDataset, power: Singles) -> dict[str, Floats]:
    """Return the power of the drives of each type, W [T, 4]."""
    return {kind: power[:, columns_of(data, kind)].astype(np.float64) for kind in _COLOURS}


class _Panels:
    """Watts of the last seconds, a panel for each type of drive."""

    def __init__(self, figure: Any, highest: float, estimated: bool) -> None:
        words = 'bold: the four together, metered   thin: each drive'
        words = 'bold: metered at 1 kHz   dashed: estimated by the model' if estimated else words
        figure.text(0.56, 0.835, words, fontsize=8.5, color='#57606a')
        self.total = figure.text(0.56, 0.895, '', fontsize=18, weight='bold', color='#24292f')
        self._sums, self._dashes, self._labels = {}, {}, {}
        self._each: dict[str, list[Any]] = {}
        half = 50 * int(highest / 100)
        for row, (kind, colour) in enumerate(_COLOURS.items()):
            axes = figure.add_axes((0.56, 0.565 - 0.235 * row, 0.3, 0.205))
            axes.set(xlim=(-_WINDOW, 0.0), ylim=(min(0.0, -0.06 * highest), highest))
            axes.set(yticks=(0, half, 2 * half), xticks=(-2, -1, 0))
            axes.tick_params(labelsize=8, labelbottom=row == 2)
            axes.spines[['top', 'right']].set_visible(False)
            axes.grid(axis='y', alpha=0.3)
            (self._sums[kind],) = axes.plot([], [], color=colour, linewidth=2.2)
            (self._dashes[kind],) = axes.plot([], [], color='black', linewidth=0.9, dashes=(2, 2))
            self._each[kind] = [
                axes.plot([], [], color=colour, linewidth=0.7, alpha=0.6)[0]
                for _ in range(0 if estimated else 4)
            ]
            place = {'transform': axes.transAxes, 'color': colour, 'va': 'center'}
            self._labels[kind] = axes.text(1.03, 0.62, '', fontsize=11, weight='bold', **place)
            axes.text(1.03, 0.3, _PLACES[kind], fontsize=8, weight='normal', **place)
        words = 'time in s, power in W of four drives each'
        axes.set_xlabel(words, fontsize=8.5, color='#57606a')

    def show(
        self, time: Floats, measured: dict[str, Floats], estimated: dict[str, Floats] | None
    ) -> None:
        """Show what was measured up to time 0, s [T] before now, W [T, 4] by type."""
        seen, last = (time > -_WINDOW) & (time <= 0.0), (time > -_MEAN) & (time <= 0.0)
        power = 0.0
        for kind, watts in measured.items():
            self._sums[kind].set_data(time[seen], watts[seen].sum(axis=1))
            for line, drive in zip(self._each[kind], watts[seen].T, strict=False):
                line.set_data(time[seen], drive)
            if estimated is not None:
                self._dashes[kind].set_data(time[seen], estimated[kind][seen].sum(axis=1))
            mean = watts[last].sum(axis=1).mean()
            self._labels[kind].set_text(f'{kind} {mean:.0f} W')
            power += mean
        self.total.set_text(f'12 drives: {power:.0f} W')


def frames(walk: Recording, clip: Clip, model: PowerModel | None = None) -> Iterator[Image]:
    """Yield the picture's frames: the robot on the left, its watts on the right.

    model: whose estimate is drawn over the measured power, or None. InputError for a walk that is
    shorter than the clip.
    """
    data = align(walk)
    time = data.time - data.time[0]
    if time[-1] < clip.start + clip.seconds:
        raise InputError(
            f'the walk is {time[-1]:.1f} s long; its picture needs {clip.start + clip.seconds:g} s'
        )
    measured = _by_type(data, data.power)
    estimated = None if model is None else _by_type(data, model.predict(data))
    highest = max(float(np.nanmax(watts.sum(axis=1))) for watts in measured.values())
    shown = clip.start + np.arange(clip.frames) * clip.seconds / clip.frames
    figure = Figure(figsize=(9.6, 4.0), dpi=100, facecolor='white')
    canvas = FigureCanvasAgg(figure)
    left = figure.add_axes((0.0, 0.0, 0.5, 1.0))
    left.axis('off')
    robot = left.imshow(np.full((*_ROBOT, 3), 255, np.uint8))
    figure.text(0.02, 0.93, clip.title, fontsize=11, color='#57606a')
    panels = _Panels(figure, max(320.0, 1.05 * min(highest, 800.0)), estimated is not None)
    images = _robot_images(_poses(walk, data.time[0] + shown))
    for now, image in zip(shown, images, strict=True):
        robot.set_data(image)
        panels.show(time - now, measured, estimated)
        canvas.draw()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


def write_video(path: Path, walk: Recording, clip: Clip, model: PowerModel | None = None) -> int:
    """Write an animated .webp or .gif that plays in real time; return the number of frames.

    model: whose estimate is drawn, or None. InputError for a walk that is shorter than the clip.
    """
    pictures = [Pictures.fromarray(frame) for frame in frames(walk, clip, model)]
    stream = io.BytesIO()
    pictures[0].save(
        stream,
        format=path.suffix[1:],
        save_all=True,
        append_images=pictures[1:],
        duration=round(1000 * clip.seconds / clip.frames),
        loop=0,
        quality=45,
        method=4,
    )
    write_whole(path, stream.getvalue())
    return len(pictures)
