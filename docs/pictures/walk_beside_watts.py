"""
Animated picture of the simulated robot walking beside the watts of its drives.

example: MUJOCO_GL=egl python docs/pictures/walk_beside_watts.py -o walk_beside_watts.webp
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from power_estimator.loader import load_model
from power_recordings.alignment.align import align
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.reading.reader import Recording
from sim_bridge.offline.run import simulate_recording, walking_run
from sim_bridge.plant.anymal_model import build_spec
from sim_bridge.plant.parameters import Plant
from wattwalk_core.anymal import JOINT_NAMES
from wattwalk_core.command import command

STRIDE = 1.0 / 1.7  # s, of the shipped policies
STRIDES, FRAMES = 10, 96  # in a loop
START = 4.0  # s; the robot stands up and gains speed before
WINDOW = 2.0  # s of power in view
ROBOT = (400, 480)  # pixels, height and width
COLOURS = {'HAA': '#0072b2', 'HFE': '#d55e00', 'KFE': '#009e73'}  # Okabe-Ito
PLACES = {'HAA': 'hip, sideways', 'HFE': 'hip, forward', 'KFE': 'knee'}
Image = NDArray[np.uint8]


def poses(walk: Recording, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return MuJoCo's qpos [T, 19] at these times, from odometry and joint states."""
    odom, joints = walk.odom(), walk.joint_states()
    columns = [joints.names.index(name) for name in JOINT_NAMES]
    stamps, joint_stamps = odom.stamp_ns * 1e-9, joints.stamp_ns * 1e-9
    parts = (*odom.position.T, *odom.orientation[:, [3, 0, 1, 2]].T)
    base = [np.interp(times, stamps, part) for part in parts]
    angles = [np.interp(times, joint_stamps, joints.position[:, i]) for i in columns]
    return np.stack([*base, *angles], axis=1)


def robot_images(qpos: NDArray[np.float64]) -> Iterator[Image]:
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
    for geom in spec.geoms:
        if geom.name == 'floor':
            geom.material, geom.rgba = 'tiles', [1.0, 1.0, 1.0, 1.0]
        for kind, colour in COLOURS.items():
            part = {'HAA': 'HIP', 'HFE': 'THIGH', 'KFE': 'SHANK'}[kind]
            if geom.name.endswith(part):
                rgb = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
                geom.rgba = [*rgb, 1.0]
        if geom.name == 'base':
            geom.rgba = [0.24, 0.27, 0.30, 1.0]
    model = spec.compile()
    model.vis.global_.offwidth, model.vis.global_.offheight = ROBOT[1], ROBOT[0]
    model.vis.headlight.ambient[:] = 0.38
    model.vis.headlight.diffuse[:] = 0.22
    model.vis.map.zfar = 40.0
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 1.75, 128.0, -14.0
    with mujoco.Renderer(model, *ROBOT) as renderer:
        # The map of shadows is centred on the origin, which the robot leaves.
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        for pose in qpos:
            data.qpos[:] = pose
            mujoco.mj_forward(model, data)
            camera.lookat[:] = (pose[0], pose[1], 0.33)
            renderer.update_scene(data, camera)
            yield renderer.render().copy()


def by_type(data: AlignedDataset, power: NDArray[np.float32]) -> dict[str, NDArray[np.float64]]:
    """Return the power of the four drives of each type, W [T]."""
    return {
        kind: power[:, [i for i, name in enumerate(data.names) if name.endswith(kind)]].sum(
            axis=1, dtype=np.float64
        )
        for kind in COLOURS
    }


def frames(walk: Recording, model: str) -> Iterator[Image]:
    """Yield the picture's frames: the robot on the left, its watts on the right."""
    import matplotlib.pyplot as plt

    data = align(walk)
    measured = by_type(data, data.power)
    estimated = by_type(data, load_model(model).predict(data))
    time = data.time - data.time[0]
    shown = START + np.arange(FRAMES) * STRIDES * STRIDE / FRAMES
    images = robot_images(poses(walk, data.time[0] + shown))
    figure = plt.figure(figsize=(9.6, 4.0), dpi=100, facecolor='white')
    left = figure.add_axes((0.0, 0.0, 0.5, 1.0))
    left.axis('off')
    canvas = left.imshow(np.full((*ROBOT, 3), 255, np.uint8))
    total = figure.text(0.56, 0.895, '', fontsize=18, weight='bold', color='#24292f')
    legend = 'solid: metered at 1 kHz   dashed: estimated by the network'
    figure.text(0.56, 0.835, legend, fontsize=8.5, color='#57606a')
    lines, dashes, labels = {}, {}, {}
    for row, (kind, colour) in enumerate(COLOURS.items()):
        axes = figure.add_axes((0.56, 0.565 - 0.235 * row, 0.3, 0.205))
        axes.set(xlim=(-WINDOW, 0.0), ylim=(0.0, 320.0), yticks=(0, 150, 300), xticks=(-2, -1, 0))
        axes.tick_params(labelsize=8, labelbottom=row == 2)
        axes.spines[['top', 'right']].set_visible(False)
        axes.grid(axis='y', alpha=0.3)
        (lines[kind],) = axes.plot([], [], color=colour, linewidth=2.2)
        (dashes[kind],) = axes.plot([], [], color='black', linewidth=0.9, dashes=(2, 2))
        place = {'transform': axes.transAxes, 'color': colour, 'weight': 'bold', 'va': 'center'}
        labels[kind] = axes.text(1.03, 0.62, '', fontsize=11, **place)
        axes.text(1.03, 0.3, PLACES[kind], fontsize=8, **{**place, 'weight': 'normal'})
    axes.set_xlabel('time in s, power in W of four drives each', fontsize=8.5, color='#57606a')
    for now, image in zip(shown, images, strict=True):
        canvas.set_data(image)
        seen = (time > now - WINDOW) & (time <= now)
        stride = (time > now - STRIDE) & (time <= now)
        for kind in COLOURS:
            lines[kind].set_data(time[seen] - now, measured[kind][seen])
            dashes[kind].set_data(time[seen] - now, estimated[kind][seen])
            labels[kind].set_text(f'{kind} {measured[kind][stride].mean():.0f} W')
        power = sum(measured[kind][stride].mean() for kind in COLOURS)
        total.set_text(f'12 drives: {power:.0f} W')
        figure.canvas.draw()
        yield np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()
    plt.close(figure)


@command
def main(args: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='F.webp')
    parser.add_argument('--policy', default='pmp', help='that walks (pmp)')
    parser.add_argument('--model', default='ppn:bags/ppn_small')
    options = parser.parse_args(args)
    import matplotlib as mpl
    from PIL import Image as Pictures

    mpl.use('Agg')
    run = walking_run(
        Plant.load('anymal_c'),
        duration=START + STRIDES * STRIDE + 0.5,
        seed=5,
        controller=options.policy,
        velocity=(0.6, 0.0, 0.0),
    )
    walk = simulate_recording(run)
    pictures = [Pictures.fromarray(frame) for frame in frames(walk, options.model)]
    pictures[0].save(
        options.output,
        save_all=True,
        append_images=pictures[1:],
        duration=round(1000 * STRIDES * STRIDE / FRAMES),
        loop=0,
        quality=45,
        method=4,
    )
    print(
        f'{options.output}: {len(pictures)} frames, {options.output.stat().st_size / 1e6:.2f} MB'
    )


if __name__ == '__main__':
    raise SystemExit(main())
