"""Recordings that ROS 2's own tools wrote are as good as ours: aligned, trained on, judged."""

import json
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml
from power_recordings.alignment.align import load_aligned
from power_recordings.quality.check import check_recording
from power_recordings.reading.reader import Recording

RECORDED = Path(__file__).resolve().parents[1] / 'bags' / 'walk_small'

BURSTS = Path(__file__).parent / 'props' / 'bursts.py'

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


def test_what_ros2_bag_record_lost_by_its_short_queue_is_told(node_process, tmp_path):
    bag = tmp_path / 'bag'
    recorder = node_process.ros2(
        *('bag', 'record', '-s', 'mcap', '-o', str(bag), '--topics', '/drive_supply')
    )
    recorder.wait_for_output('Recording')
    # A burst is longer than the queue of ten messages that rosbag2 has by default.
    bursts = node_process.python(BURSTS)
    recorder.wait_for_output("Subscribed to topic '/drive_supply'")
    bursts.wait_for_output('sent (\\d+)')
    recorder.stop()
    sequence = Recording.open(bag).drive_supply().sequence.astype(np.int64)
    steps = np.diff(sequence)
    assert steps.max() > 1
    found = {f.code: f.text for f in check_recording(Recording.open(bag)).findings}
    missing, gaps = (steps - 1).sum(), (steps > 1).sum()
    assert f'{missing} of {len(sequence) + missing} samples' in found['lost']
    assert f'{gaps} gaps' in found['lost']
