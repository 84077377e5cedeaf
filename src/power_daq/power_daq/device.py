"""Measuring devices of the DAQ node, a CAN bus or an EtherCAT segment, by its parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from power_recordings.calibration import Calibration
from power_recordings.card import Card
from wattwalk_core.errors import InputError, quoted
from wattwalk_core.nodes.diagnostics import LogTarget, Report
from wattwalk_core.nodes.parameters import DeviceParameters
from wattwalk_core.worker import Worker

from power_daq.acquisition.bus_acquisition import Acquisition, BusHealth, QueryRounds, SampleQueue
from power_daq.acquisition.receiver import Receiver
from power_daq.bus.connection import BusSettings
from power_daq.bus.description import READY, BusDescription
from power_daq.clock.mapping import RosTime
from power_daq.ethercat.acquisition import SegmentAcquisition, SegmentHealth
from power_daq.ethercat.mapping import SegmentMapping
from power_daq.ethercat.soem import SoemSegment, longest_call

ETHERCAT = 'ethercat'


@dataclass(frozen=True)
class MeasuringDevice:
    """A measuring device: its name, drives by group, thread and reports.

    part: its name in diagnostics; report takes the time in s on a steady clock; ending: s that
    the thread may take to end; abandoned: the consequence if it takes longer, for the log; card:
    what is known of its drives.
    """

    device: str
    part: str
    hardware: str
    drives: Mapping[str, tuple[str, ...]]
    acquisition: Worker
    report: Callable[[float], Report]
    ending: float = 1.0
    abandoned: str = 'the bus may be left open'
    card: Card = field(default_factory=Card)


def open_device(given: DeviceParameters, queue: SampleQueue, log: LogTarget) -> MeasuringDevice:
    """Declare the parameters and return the device that they name; InputError for bad ones."""
    interface = given.text(
        'interface', 'socketcan', 'python-can interface, unixsocket, or ethercat'
    )
    channel = given.text('channel', 'can0', 'bus or network interface, such as can0 or a path')
    mapping = given.path('mapping', 'YAML file from signals to drives; empty for the shipped one')
    calibration = given.path('calibration', 'YAML file of gains and offsets; empty for none')
    if interface == ETHERCAT:
        return _ethercat(channel, mapping, calibration, queue, log)
    ready = given.text('bus', '', f'ready description instead of a DBC: {", ".join(READY)}')
    nodes = _nodes(given.text('drives', '', 'node numbers of drives, as hip=0,knee=1'))
    dbc = given.path('dbc', 'DBC file of the bus; empty for the shipped one')
    if ready and dbc is not None:
        raise InputError(f'give bus {ready} or dbc {dbc}, not both')
    if ready:
        bus = BusDescription.ready(ready, mapping, nodes)
    else:
        bus = BusDescription.load(dbc, mapping, nodes)
    settings = BusSettings(
        interface,
        channel,
        given.whole('bitrate', 1_000_000, 'bit/s, arbitration phase', 10_000, 1_000_000),
        given.whole('data_bitrate', 5_000_000, 'bit/s, data phase', 10_000, 10_000_000),
        bus.is_fd,
    )
    delay = given.real('transport_delay', 0.0, 's from sample to arrival, at best', 0.0, 0.1)
    corrections = None
    if calibration is not None and 'electrical' in bus.groups:
        corrections = Calibration.load(calibration, bus.groups['electrical'].drives)
    receiver = Receiver(bus, RosTime(), corrections, int(1e9 * delay))
    queries = None if bus.polled is None else QueryRounds(bus.polled.queries, 1 / bus.rate)
    acquisition = Acquisition(receiver, settings.open, queue.put, log, None, queries)
    health = BusHealth(acquisition, queue, bus, settings)
    drives = {name: group.drives for name, group in bus.groups.items()}
    hardware = f'{settings.interface} {settings.channel}'
    card = Card.of_source(bus.torque_at, bus.torque_unit)
    return MeasuringDevice(
        bus.device, 'bus', hardware, drives, acquisition, health.report, card=card
    )


def _nodes(text: str) -> dict[str, int]:
    """Return node numbers by drive of `hip=0,knee=1`; InputError for another form."""
    nodes: dict[str, int] = {}
    for part in filter(None, text.replace(',', ' ').split()):
        drive, equals, number = part.partition('=')
        if not equals or not drive or not number.isdecimal() or len(number) > 9 or drive in nodes:
            raise InputError(
                f'drives: expected names with node numbers, each once, as hip=0,knee=1; there is '
                f'{quoted(part)}'
            )
        nodes[drive] = int(number)
    return nodes


def _ethercat(
    channel: str, path: Path | None, calibration: Path | None, queue: SampleQueue, log: LogTarget
) -> MeasuringDevice:
    if path is None:
        raise InputError(
            'interface ethercat needs a mapping: -p mapping:=ethercat.yaml says which terminal '
            'measures what (docs/how-to/instruments.md has one)'
        )
    mapping = SegmentMapping.load(path)
    corrections = None if calibration is None else Calibration.load(calibration, mapping.names)
    segment = partial(SoemSegment, channel, mapping.frame_timeout)
    segment()
    acquisition = SegmentAcquisition(mapping, segment, queue.put, log, corrections)
    return MeasuringDevice(
        mapping.device,
        'segment',
        f'{ETHERCAT} {channel}',
        {'electrical': mapping.names},
        acquisition,
        SegmentHealth(acquisition, queue, channel).report,
        longest_call(len(mapping.segment), mapping.frame_timeout),
        'the slaves stay in the state that they are in: power them off and on',
    )
