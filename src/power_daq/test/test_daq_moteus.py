"""Emulated moteus servos are polled: units, faults, and what diagnostics say."""

import math
import time

import can
import numpy as np
import pytest
import yaml
from kept_log import KeptLog
from moteus_emulator import POSITION, POWER, VELOCITY, MoteusEmulator, ServoBus, turns
from power_daq.acquisition.bus_acquisition import (
    Acquisition,
    BusHealth,
    Level,
    Patience,
    QueryRounds,
    SampleQueue,
)
from power_daq.acquisition.receiver import Receiver
from power_daq.bus.connection import BusSettings
from power_daq.bus.description import DEFAULT_MAPPING, DEVICE_ERROR, STALE, BusDescription
from power_daq.clock.mapping import RosTime
from wattwalk_core.errors import InputError

NODES = {'hip': 1, 'knee': 12}


class Bench:
    """Servos on a virtual bus, and an acquisition that polls them."""

    def __init__(self, channel, nodes, *servos):
        self.samples = []
        self.settings = BusSettings('virtual', channel)
        self.bus = BusDescription.ready('moteus', nodes=nodes)
        self.receiver = Receiver(self.bus, RosTime())
        self.acquisition = Acquisition(
            self.receiver,
            self.settings.open,
            self.samples.append,
            KeptLog(),
            Patience(0.01, 0.02, silence=0.3, read=0.02),
            QueryRounds(self.bus.polled.queries, 1 / self.bus.rate),
        )
        self.health = BusHealth(self.acquisition, SampleQueue(10), self.bus, self.settings)
        self.servos = ServoBus(can.Bus(interface='virtual', channel=channel), *servos)

    def __enter__(self):
        self.servos.start()
        self.acquisition.start()
        return self

    def __exit__(self, *_):
        self.acquisition.stop()
        self.acquisition.join()
        self.servos.stop.set()
        self.servos.join()
        self.servos._bus.shutdown()

    def until(self, condition):
        end = time.monotonic() + 30
        while not condition():
            assert time.monotonic() < end, 'never happened'
            time.sleep(0.01)

    def until_said(self, words):
        """Return the first report whose sentence has the words."""
        end = time.monotonic() + 30
        while words not in (report := self.health.report(time.monotonic())).sentence:
            assert time.monotonic() < end, report.sentence
            time.sleep(0.3)
        return report

    def of(self, group):
        return [sample for sample in self.samples if sample.group == group]


def test_registers_become_si_units_and_power_over_voltage_the_current(request):
    hip, knee = MoteusEmulator(1), MoteusEmulator(12)
    with Bench(request.node.name, NODES, hip, knee) as bench:
        bench.until(lambda: len(bench.of('electrical')) > 100)
        report = bench.until_said('stamped on receipt')
    joints, electrical = bench.of('joints'), bench.of('electrical')
    late = np.array([s.values[0, 0] / (2 * math.pi) - turns(s.stamp / 1e9) for s in joints])
    assert abs(np.median(late)) < 0.25 * 0.005, 'stamped within 5 ms of the reading'
    for sample in joints[5:50]:
        assert sample.values[1] == pytest.approx([0.5 * math.pi] * 2)
        assert sample.values[2] == pytest.approx([0.1, 1.2])
        assert sample.values[0, 1] == pytest.approx(sample.values[0, 0], abs=0.1)
    assert electrical[10].values[:2] == pytest.approx(np.array([[24.0, 24.0], [0.5, 6.0]]))
    assert not electrical[10].values[2].any()
    assert report.figures['unknown'] == '0'


def test_only_mapped_registers_are_asked_for_and_nothing_is_written(request):
    hip = MoteusEmulator(1)
    with Bench(request.node.name, {'hip': 1}, hip) as bench:
        bench.until(lambda: len(hip.queries) > 5)
    query = hip.queries[0]
    assert query.arbitration_id == 0x8000 | 16 << 8 | 1
    assert query.is_extended_id
    assert query.is_fd
    assert bytes(query.data).rstrip(b'\x50').hex() == '1c03011c01071c010d'


def test_replies_to_another_host_are_not_taken_for_one_s_own(request):
    hip = MoteusEmulator(1)
    with (
        Bench(request.node.name, {'hip': 1}, hip) as bench,
        can.Bus(interface='virtual', channel=request.node.name) as controller,
    ):
        for _ in range(50):
            controller.send(
                can.Message(arbitration_id=0x8001, is_fd=True, data=bytes.fromhex('1c0101505050'))
            )
        bench.until(lambda: bench.receiver.unknown_ids[0x100] == 50)
        bench.until(lambda: len(bench.of('electrical')) > 20)
    assert all(np.isfinite(s.values).all() for s in bench.samples)


def test_a_register_that_the_firmware_lacks_is_named(request):
    hip = MoteusEmulator(1, missing={POWER})
    with Bench(request.node.name, {'hip': 1}, hip) as bench:
        report = bench.until_said('Power refused')
        bench.until(lambda: len(bench.of('joints')) > 20)
    assert report.level is Level.WARN
    assert np.isfinite(bench.of('joints')[-1].values).all()
    assert bench.of('electrical')[-1].values[2] == [DEVICE_ERROR]


def test_a_servo_that_does_not_answer_is_named_and_the_other_goes_on(request):
    hip, knee = MoteusEmulator(1), MoteusEmulator(12, is_deaf=True)
    with Bench(request.node.name, NODES, hip, knee) as bench:
        report = bench.until_said('no frames of')
        assert 'knee REGISTERS (does not answer' in report.sentence
        assert report.sentence.count('knee') == 1
        assert 'hip' not in report.sentence
        bench.until(lambda: bench.of('electrical'))
        sample = bench.of('electrical')[-1]
        assert sample.values[2].tolist() == [0, STALE]
        knee.is_deaf = False
        bench.until(lambda: not bench.of('electrical')[-1].values[2].any())


@pytest.mark.parametrize(
    'form',
    [lambda reply: reply[:7], lambda reply: b'\x2c\xff\x01' + reply[:13], lambda reply: b'\x2f'],
    ids=['cut', 'more than there is', 'head only'],
)
def test_replies_that_cannot_be_read_are_counted(request, form):
    hip = MoteusEmulator(1, form=form)
    with Bench(request.node.name, {'hip': 1}, hip) as bench:
        report = bench.until_said('wrong length')
    assert report.level is Level.ERROR
    assert bench.samples == []


def test_numbers_that_are_none_are_flagged(request):
    hip = MoteusEmulator(1, broken={POWER: math.nan, VELOCITY: math.inf, POSITION: math.nan})
    with Bench(request.node.name, {'hip': 1}, hip) as bench:
        bench.until_said('not finite')
        bench.until(lambda: bench.of('electrical'))
    assert bench.of('electrical')[-1].values[2] == [DEVICE_ERROR]


def test_a_bus_that_takes_no_frames_is_read_on_and_said():
    class Full:
        def send(self, message, timeout):
            raise can.CanOperationError('Transmit buffer full')

    bus = BusDescription.ready('moteus')
    rounds = QueryRounds(bus.polled.queries, 0.0)
    rounds.send_due(Full())
    rounds.send_due(Full())
    assert (rounds.sent, rounds.unsent) == (0, 2)


def test_a_signal_that_is_no_register_is_refused(tmp_path):
    mapping = yaml.safe_load(DEFAULT_MAPPING.with_name('moteus.yaml').read_text())
    mapping['joints']['frames'][0]['drives'][0]['torque'] = 'Torqe'
    (tmp_path / 'leg.yaml').write_text(yaml.safe_dump(mapping))
    with pytest.raises(InputError, match="signal 'Torqe' is not in message 'REGISTERS'"):
        BusDescription.ready('moteus', tmp_path / 'leg.yaml')
    del mapping['nodes']
    (tmp_path / 'leg.yaml').write_text(yaml.safe_dump(mapping))
    with pytest.raises(InputError, match='poll needs nodes'):
        BusDescription.ready('moteus', tmp_path / 'leg.yaml')
