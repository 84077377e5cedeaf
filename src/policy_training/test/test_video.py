"""Pictures of a walk; drawn offscreen, so only where OpenGL works."""

import os

os.environ.setdefault('MUJOCO_GL', 'egl')  # before mujoco is imported

import mujoco
import numpy as np
import pytest
from PIL import Image
from policy_training.evaluation.measured_walk import measure_walk
from policy_training.evaluation.tasks import TASKS
from policy_training.evaluation.video import Clip, frames, write_video
from sim_bridge.plant.parameters import Plant
from wattwalk_core.errors import InputError


@pytest.fixture(scope='module')
def recording():
    try:
        with mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8):
            pass
    except Exception as error:  # each OpenGL has its own
        pytest.skip(f'no offscreen OpenGL: {error}')
    walk = measure_walk('trot', TASKS[0], Plant.load('anymal_c'), duration=5.0, seed=1)
    return walk.recording


def test_a_picture_shows_a_robot_that_moves_and_watts_that_change(recording, tmp_path):
    path = tmp_path / 'walk.webp'
    assert write_video(path, recording, Clip(start=3.0, seconds=1.0, frames=4)) == 4
    with Image.open(path) as picture:
        assert picture.n_frames == 4
        assert picture.size == (960, 400)
        shown = []
        for index in range(4):
            picture.seek(index)
            shown.append(np.asarray(picture.convert('RGB'), np.int16))
    robot, watts = np.s_[:, :480], np.s_[:, 480:]
    for part in (robot, watts):
        assert np.abs(shown[0][part] - shown[2][part]).max() > 50


def test_the_robot_walks_ahead_and_stays_in_view(recording):
    first, *_, last = frames(recording, Clip(start=3.0, seconds=1.5, frames=3))
    for picture in (first, last):
        dark = (picture[:, :480].sum(axis=2) < 300).mean()
        assert 0.005 < dark < 0.5


def test_a_walk_that_is_shorter_than_the_clip_is_refused(recording):
    with pytest.raises(InputError, match='needs 10 s'):
        next(frames(recording, Clip(start=4.0, seconds=6.0)))
