from pathlib import Path

import numpy as np
import pytest
from power_estimator.evaluation import benchmark
from power_estimator.evaluation.benchmark import RecordedEstimate
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.messages import cdr
from power_recordings.writing.writer import BagWriter
from wattwalk_core.errors import InputError

SECOND = 1_000_000_000
NAMES = ('A', 'B')


def write_estimates(path, stamps, power, status):
    with BagWriter(path) as bag:
        topic = bag.add_topic('power_estimate', cdr.POWER_ESTIMATE)
        for stamp, watts, state in zip(stamps, power, status, strict=True):
            message = cdr.message(
                cdr.POWER_ESTIMATE,
                header=cdr.message(
                    'std_msgs/msg/Header',
                    stamp=cdr.message(
                        'builtin_interfaces/msg/Time',
                        sec=int(stamp // SECOND),
                        nanosec=int(stamp % SECOND),
                    ),
                    frame_id='',
                ),
                model='m',
                name=list(NAMES),
                power=np.asarray(watts, np.float32),
                total=float(np.sum(watts)),
                status=state,
            )
            bag.write(topic, int(stamp), cdr.serialize(cdr.POWER_ESTIMATE, message))
    return path


def dataset(time, names=NAMES):
    return AlignedDataset.blank(200.0, names, time, 'bag')


def test_an_estimate_lies_in_the_middle_of_the_time_it_stands_for(tmp_path):
    stamps = [100 * SECOND + k * 20_000_000 for k in range(3)]
    bag = write_estimates(tmp_path / 'bag', stamps, [[10, 1], [20, 1], [40, 1]], [0, 0, 0])
    power = RecordedEstimate([bag]).predict(dataset([99.99, 100.0, 100.01, 100.02, 100.04]))
    np.testing.assert_allclose(power[:4, 0], [10, 15, 20, 30], rtol=1e-4)
    assert np.isnan(power[4]).all(), 'nothing is known after the last estimate'


def test_a_benchmark_calls_recorded_estimates_as_they_were_recorded(monkeypatch):
    class Live(RecordedEstimate):
        def __init__(self, bags):
            pass

        def predict(self, data):
            return data.torque * data.velocity

    monkeypatch.setattr(benchmark, 'RecordedEstimate', Live)
    walk = Path(__file__).resolve().parents[3] / 'bags' / 'walk_small'
    assert benchmark.run([walk], ['recorded']).held_out == ('as it was recorded',)


def test_estimates_that_are_not_good_and_drives_without_one_are_unknown(tmp_path):
    stamps = [100 * SECOND + k * 20_000_000 for k in range(6)]
    watts = [[10, 1]] * 6
    bag = write_estimates(tmp_path / 'bag', stamps, watts, [0, 0, 1, 2, 0, 0])
    power = RecordedEstimate([bag]).predict(dataset([100.0, 100.03, 100.08], ('B', 'C')))
    np.testing.assert_array_equal(np.isfinite(power[:, 0]), [True, False, True])
    assert np.isnan(power[:, 1]).all()


def test_a_recording_without_estimates_is_refused_by_name(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        topic = bag.add_topic('joint_states', cdr.JOINT_STATE)
        for stamp, data in enumerate(
            cdr.in_a_list(cdr.joint_state_block(np.arange(1, 5), ['A'], np.zeros((4, 1))))
        ):
            bag.write(topic, stamp, data)
    with pytest.raises(InputError, match=r'bag has no power_estimate topic'):
        RecordedEstimate([tmp_path / 'bag'])
