"""Recordings read as tasks: the same as those read in this process."""

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from power_estimator.judge.read_recordings import (
    JudgedDrives,
    read_here,
    read_on_workers,
)
from power_estimator.judge.recordings import load
from power_lab.commands.arguments import compare
from power_recordings.commands.arguments import import_logs
from wattwalk_core.engine.options import Workplace
from wattwalk_core.engine.task_engine import TaskEngine
from wattwalk_core.errors import InputError

MODEL = """\
format: power_model/1
name: base
effects: [shaft, idle]
"""


MAP = """\
format: import/1
time: {column: t, unit: s}
drives:
  'J*':
    position: {from: q*, unit: rad}
    velocity: {from: w*, unit: rad/s}
    torque: {from: tau*, unit: N*m, at: motor}
    voltage: {value: 48, unit: V}
    power: {from: p*, unit: W, positive: drawn}
card: {robot: made}
"""


def recording(folder, joints, rate, seconds=40.0):
    """Joints by number that swing and draw shaft power, copper loss and 2 W."""
    time = np.arange(round(seconds * rate)) / rate
    table, names = [time], ['t']
    for joint in joints:
        angle = 2 * np.pi * (0.4 + 0.1 * joint) * time
        torque, velocity = 8.0 * np.sin(angle), 3.0 * np.cos(1.3 * angle)
        power = torque * velocity + 0.05 * torque**2 + 2.0
        table += [np.cumsum(velocity) / rate, velocity, torque, power]
        names += [f'{name}{joint}' for name in ('q', 'w', 'tau', 'p')]
    folder.mkdir()
    log, chart, bag = folder / 'log.csv', folder / 'map.yaml', folder / 'bag'
    np.savetxt(log, np.column_stack(table), delimiter=',', header=','.join(names), comments='')
    chart.write_text(MAP)
    assert import_logs([str(log), '--map', str(chart), '-o', str(bag)]) == 0
    return bag


@pytest.fixture(scope='module')
def swings(tmp_path_factory):
    """Swings of joints 0, 1 and 2 at 100 Hz, of 2 and 1 at 200 Hz, and of 5."""
    folder = tmp_path_factory.mktemp('swings')
    given = [((0, 1, 2), 100.0), ((2, 1), 200.0), ((5,), 100.0)]
    return [recording(folder / f'swing_{i}', *each) for i, each in enumerate(given)]


def differing(one, other):
    pairs = {own.name: (getattr(one, own.name), getattr(other, own.name)) for own in fields(one)}
    pairs |= {name: (one.extras[name], other.extras[name]) for name in pairs.pop('extras')[0]}
    return [
        name
        for name, (a, b) in pairs.items()
        if not (np.array_equal(a, b, equal_nan=True) if isinstance(a, np.ndarray) else a == b)
    ]


def test_recordings_of_different_joints_and_rates_are_read_as_in_this_process(swings, monkeypatch):
    monkeypatch.chdir(swings[0].parent)
    paths = [Path('bag'), swings[1]]
    data, here = read_here(paths, JudgedDrives())
    with TaskEngine(Workplace(workers=1)) as engine:
        same_data, there = read_on_workers(engine, paths, JudgedDrives())
    assert data.names == ('J1', 'J2')
    assert differing(data, same_data) == []
    for one, other in zip(here, there, strict=True):
        assert one.described == other.described
        assert (one.doubt, one.changes) == (other.doubt, other.changes)


def test_two_processes_come_to_the_same_comparison(swings, tmp_path):
    model = tmp_path / 'base.yaml'
    model.write_text(MODEL)
    told = [tmp_path / 'one.json', tmp_path / 'two.json']
    for workers, file in zip('12', told, strict=True):
        arguments = [*map(str, swings[:2]), '--models', str(model), '--json', str(file)]
        assert compare([*arguments, '--workers', workers]) == 0
    assert json.loads(told[0].read_text()) == json.loads(told[1].read_text())


def test_what_takes_smoothed_signals_gets_them_after_reading_by_workers(swings):
    with TaskEngine(Workplace(workers=1)) as engine:
        there = load(swings[:2], engine=engine)
    assert all(one.path == path for one, path in zip(there.recordings, swings[:2], strict=True))
    assert all(one.whole() is not one for one in there.recordings)
    assert differing(load(swings[:2]).smooth, there.smooth) == []


def test_what_workers_cannot_read_or_join_is_refused_in_one_line(swings, tmp_path):
    broken = tmp_path / 'broken'
    broken.mkdir()
    (broken / 'broken_0.mcap').write_bytes(b'no bag')
    with TaskEngine(Workplace(workers=2)) as engine:
        with pytest.raises(InputError, match='broken'):
            load([swings[0], broken], engine=engine)
        with pytest.raises(
            InputError, match=r'\(J0, J1, J2\) and .* \(J5\) have no joint in common'
        ):
            load([swings[0], swings[2]], engine=engine)
        with pytest.raises(InputError, match="drive 'J0' was not measured; measured are J1, J2"):
            load(swings[:2], ['J0'], engine=engine)
