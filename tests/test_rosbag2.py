"""Recordings that ROS 2's own tools wrote are as good as ours: aligned, trained on, judged."""

import json
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_recordings.alignment.align import load_aligned
from power_recordings.reading.reader import Recording

RECORDED = Path(__file__).resolve().parents[1] / 'bags' / 'walk_small'

pytestmark = pytest.mark.skipif(
    find_spec('rosbag2_py') is None, reason='no rosbag2: its tools come with ROS 2'
)


@pytest.fixture(scope='module')
def of_rosbag2(tmp_path_factory):
    """Our small recording, read and written anew by `ros2 bag convert`, so without a card."""
    folder = tmp_path_factory.mktemp('rosbag2')
    bag = folder / 'walk'
    output = {'uri': str(bag), 'storage_id': 'mcap', 'all_topics': True}
    options = folder / 'options.yaml'
    options.write_text(yaml.safe_dump({'output_bags': [output]}))
    convert = ['ros2', 'bag', 'convert', '-i', str(RECORDED), '-o', str(options)]
    subprocess.run(convert, check=True, stdout=subprocess.DEVNULL)
    return bag


def test_a_bag_of_rosbag2_has_each_message_of_ours(of_rosbag2):
    ours, theirs = Recording.open(RECORDED), Recording.open(of_rosbag2)
    count = {name: topic.count for name, topic in ours.topics.items()}
    assert {name: topic.count for name, topic in theirs.topics.items()} == count
    np.testing.assert_array_equal(theirs.drive_supply().sequence, ours.drive_supply().sequence)


def test_a_bag_of_rosbag2_is_aligned_to_the_same_numbers(of_rosbag2):
    ours, theirs = (load_aligned([bag], rate=100.0) for bag in (RECORDED, of_rosbag2))
    assert theirs.names == ours.names
    for field in ('power', 'position', 'velocity', 'torque', 'supply'):
        np.testing.assert_array_equal(getattr(theirs, field), getattr(ours, field))


def test_a_network_is_trained_and_judged_on_a_bag_of_rosbag2(of_rosbag2, node_process, tmp_path):
    run, table = tmp_path / 'run', tmp_path / 'table.json'
    small = ('--folds', '2', '--segments', '1', '--epochs', '2', '--hidden', '8')
    train = node_process(
        *('power_estimator', 'train', str(of_rosbag2), '-o', str(run)),
        *(*small, '--drives', '*_KFE', '--workers', '1'),
    )
    assert train.wait(240.0) == 0, train.output
    benchmark = node_process(
        *('power_estimator', 'benchmark', str(of_rosbag2), '--drives', '*_KFE'),
        *('--models', f'ppn:{run}', 'torque_squared', '--json', str(table)),
    )
    assert benchmark.wait(120.0) == 0, benchmark.output
    models = json.loads(table.read_text())['models']
    assert len(models) == 2
    assert all(set(model['types']) == {'KFE'} for model in models)
