"""A log of one drive as delimited text, and the map that imports it."""

import numpy as np
from power_recordings.commands.arguments import import_logs as main
from power_recordings.reading.reader import Recording

MAP = """
format: import/1
time: {column: t, unit: ms}
drives:
  KNEE:
    position: {from: pos, unit: rev}
    velocity: {from: vel, unit: rpm}
    torque: {from: iq, scale: 0.5, from_unit: A, at: motor}
    voltage: {value: 24, unit: V}
    current: {from: i, unit: mA, positive: fed}
card: {robot: bench}
"""


def table(rows=500, rate=100.0):
    """Half a turn a second at 24 V and 1 A, for `rows` samples."""
    t = np.arange(rows) / rate
    angle = 0.25 * np.sin(2 * np.pi * t)  # turns
    speed = 0.25 * 2 * np.pi * np.cos(2 * np.pi * t) * 60  # rpm
    return np.stack([1e3 * t, angle, speed, np.full(rows, 2.0), np.full(rows, -1e3)], axis=1)


def csv(path, rows, head='t,pos,vel,iq,i'):
    text = '\n'.join(','.join(f'{x:.9g}' for x in row) for row in rows)
    path.write_text(f'{head}\n{text}\n')
    return path


def run(log, mapping, out, *more):
    map_file = out.parent / 'map.yaml'
    map_file.write_text(mapping)
    return main([str(log), '--map', str(map_file), '-o', str(out), *more])


def guessed(folder, capsys, columns):
    log = csv(folder / 'log.csv', np.stack(list(columns.values()), axis=1), ','.join(columns))
    capsys.readouterr()
    assert main([str(log), '--list']) == 0
    text = capsys.readouterr().out
    (folder / 'map.yaml').write_text(
        text.replace('# voltage: {value: VOLTS', 'voltage: {value: 48')
    )
    assert main([str(log), '--map', str(folder / 'map.yaml'), '-o', str(folder / 'bag')]) == 0
    lines = [line.strip() for line in text.splitlines() if not line.startswith('#')]
    return Recording.open(folder / 'bag'), {line.partition(':')[0]: line for line in lines}
