import json
import math
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from drive_bench.motion.file import MotionFile
from drive_bench.motion.joint_limits import JointLimits
from drive_bench.motion.segments import Segment
from drive_bench.run.recording import file_away
from drive_bench.run.recording_check import check
from power_recordings.card import Card
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter

START = 1_700_000_000_000_000_000
COUNT = 200
STALE = 8
MOTION = MotionFile('next', ('B',), (Segment('rest', 2.0),))
LIMITS = JointLimits(-2.0, 2.0, 5.0, 25.0)


def bag_with(path, stale=(), flagged=(), unread=(), lost_joints=(), torque=3.0):
    """2 s of 24 W; stale: samples without values, by design of the meter, flagged as such."""
    stamps = START + np.arange(COUNT) * 10_000_000
    voltage, current = np.full((COUNT, 1), 48.0), np.full((COUNT, 1), 0.5)
    status = np.zeros((COUNT, 1), np.uint8)
    voltage[list(stale)], status[list(stale)] = math.nan, STALE
    current[list(flagged)], status[list(flagged)] = 50.0, 2
    voltage[list(unread)] = math.nan
    position, effort = np.full((COUNT, 1), 0.1), np.full((COUNT, 1), torque)
    position[list(lost_joints)] = math.nan
    supply = cdr.in_a_list(
        *cdr.drive_supply_blocks(
            stamps, 0, np.arange(COUNT), ('B',), voltage, current, status=status
        )
    )
    joints = cdr.in_a_list(
        cdr.joint_state_block(stamps, ('B',), position, np.zeros((COUNT, 1)), effort)
    )
    with BagWriter(path) as bag:
        topics = (
            bag.add_topic('drive_supply', cdr.DRIVE_SUPPLY),
            bag.add_topic('joint_states', cdr.JOINT_STATE),
        )
        for at, *messages in zip(stamps, supply, joints, strict=True):
            for topic, message in zip(topics, messages, strict=True):
                bag.write(topic, int(at), message)
    return path


def amiss(found, name):
    return next(row.amiss for row in found.rows if row.name == name)


def test_samples_that_the_meter_flags_are_counted_and_not_averaged(tmp_path):
    bag = bag_with(tmp_path / 'bag', stale=[7], flagged=[8, 9], unread=[20])
    found = check(bag, MOTION, 'B', LIMITS)
    assert found.figures['power_mean'] == pytest.approx(24.0)
    assert found.figures['power_peak'] == pytest.approx(24.0)
    assert (found.figures['flagged'], found.figures['without_value']) == (3, 1)
    assert amiss(found, 'meter') == '3 flagged, 1 without a value'
    assert found.usable


def test_a_recording_without_one_good_sample_has_no_power_and_is_of_no_use(tmp_path):
    found = check(bag_with(tmp_path / 'bag', stale=range(COUNT)), MOTION, 'B', LIMITS)
    assert found.figures['power_mean'] is None
    assert amiss(found, 'power') == 'no good sample'
    assert not found.usable


def test_joint_readings_that_are_not_finite_are_counted_and_left_out(tmp_path):
    bag = bag_with(tmp_path / 'bag', lost_joints=[3, 4], torque=math.nan)
    found = check(bag, MOTION, 'B', LIMITS)
    assert found.figures['position_low'] == pytest.approx(0.1)
    assert found.figures['torque_reached'] is None
    assert found.figures['unread'] == 2
    assert amiss(found, 'readings') == '2 without position or speed'


def test_what_is_filed_is_json_and_yaml_whatever_the_meter_said(tmp_path):
    bag = bag_with(tmp_path / 'bag', stale=range(COUNT), torque=math.nan)
    Card(robot='bench').save(bag)
    run = SimpleNamespace(
        code=0, drives=('B',), motion=MOTION, limits={'B': LIMITS}, notes=(), repetition=''
    )
    recorder = SimpleNamespace(ended='', bag=bag, stop=lambda: ())
    report = tmp_path / 'check.json'
    out = StringIO()
    assert file_away(run, recorder, 'done', report, out) == 1

    def refuse(word):
        raise AssertionError(f'{word} is no JSON')

    read = json.loads(report.read_text(), parse_constant=refuse)
    assert read['figures']['power_mean'] is None
    assert yaml.safe_load((bag / 'card.yaml').read_text())['check']['power_peak'] is None
    assert 'no good sample' in out.getvalue()
