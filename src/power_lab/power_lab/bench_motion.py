"""Executes a motion file on the simulated bench: one drive that swings a pendulum."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from power_daq.cli import InputError
from sim_bridge.drive import JointCommand
from sim_bridge.simulation import Simulation
from sim_bridge.world import Stand

from power_lab.next_recording import FORMAT

_GRAVITY = 9.81
_LENGTH = 0.45  # m, of the pendulum
_INERTIA = 0.03  # kg·m², of the disc beside it
_SPARE = 1.15  # the pendulum carries this much more than the largest load
_LEAST_LOAD = 3.0  # N·m, so that there is something to swing
_NUMBERS = ('seconds', 'speed', 'load', 'torque', 'low', 'high', 'frequency', 'amplitude')
_MODES = ('rest', 'velocity', 'position', 'torque')


class BenchMotion:
    """
    The segments of a motion file as commands to the drive of a stand, at 400 Hz.

    The pendulum is as heavy as the largest load asks for. A held load is an angle at which the
    pendulum pulls as much; at speed the load swings between plus and minus the largest one.
    """

    period = 5
    velocity = None

    def __init__(self, path: Path) -> None:
        """InputError for a file that is no motion, with the entry that is wrong."""
        content = _content(path)
        self.name = f'motion {path.stem}'
        self.drives: tuple[str, ...] = tuple(map(str, content.get('drives', ())))
        self._segments = [
            _checked(s, f'{path}: segment {i}') for i, s in enumerate(_list(content))
        ]
        self._ends = np.cumsum([segment['seconds'] for segment in self._segments])
        self._place, self._since, self._from = -1, 0.0, 0.0
        self.load = max([_LEAST_LOAD, *(_largest(segment) for segment in self._segments)])

    @property
    def seconds(self) -> float:
        """Length of all segments."""
        return float(self._ends[-1])

    @property
    def stand(self) -> Stand:
        """The pendulum that can put on the loads."""
        mass = _SPARE * self.load / (_GRAVITY * _LENGTH)
        return Stand(_INERTIA, mass, _LENGTH)

    def command(self, simulation: Simulation) -> JointCommand:
        """The target now."""
        place = int(np.searchsorted(self._ends, simulation.time, side='right'))
        place = min(place, len(self._segments) - 1)
        if place != self._place:
            self._place, self._since = place, simulation.time
            self._from = float(simulation.joint_position[0])
        segment = self._segments[place]
        if segment['mode'] == 'velocity':
            speed = float(segment.get('speed', 0.0))
            target = self._from + speed * (simulation.time - self._since)
            return JointCommand(position=np.array([target]), velocity=np.array([speed]))
        down = 2.0 * math.pi * round(self._from / (2.0 * math.pi))
        angle = 0.0 if segment['mode'] == 'rest' else self._angle(segment, simulation.time)
        return JointCommand(position=np.array([down + angle]))

    def reset(self) -> None:
        """Begin the segment anew from where the drive is."""
        self._place = -1

    def _angle(self, segment: Mapping[str, Any], time: float) -> float:
        frequency = segment.get('frequency', 0.0)
        if segment['mode'] == 'position':
            middle = self._holds(segment.get('load', 0.0))
            swing = math.sin(2.0 * math.pi * frequency * time)
            return middle + float(segment.get('amplitude', 0.0)) * swing
        if frequency > 0.0:
            high = math.sin(2.0 * math.pi * frequency * time) >= 0.0
            return self._holds(segment.get('high' if high else 'low', 0.0))
        return self._holds(segment.get('torque', 0.0))

    def _holds(self, torque: float) -> float:
        """The angle at which the pendulum pulls with a torque, rad."""
        return math.asin(max(-1.0, min(1.0, torque / (_SPARE * self.load))))


def _content(path: Path) -> Mapping[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: cannot be read ({error.strerror})') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: not YAML ({str(error).splitlines()[0]})') from error
    if not isinstance(content, Mapping) or content.get('format') != FORMAT:
        raise InputError(f'{path}: no motion; it must say format: {FORMAT}')
    return content


def _list(content: Mapping[str, Any]) -> Sequence[object]:
    segments = content.get('segments')
    if not isinstance(segments, list) or not segments:
        raise InputError('a motion needs segments: a list with at least one entry')
    return segments


def _checked(segment: object, where: str) -> Mapping[str, Any]:
    if not isinstance(segment, Mapping) or segment.get('mode') not in _MODES:
        raise InputError(f'{where}: mode must be one of {", ".join(_MODES)}, in {segment!r}')
    for key, value in segment.items():
        if key == 'mode':
            continue
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if key not in _NUMBERS or not number or not math.isfinite(value):
            raise InputError(f'{where}: {key} = {value!r} is not a number that a segment has')
    if not 0.0 < segment.get('seconds', 0.0) <= 36_000.0:
        raise InputError(f'{where}: seconds must lie above 0, in {dict(segment)!r}')
    return segment


def _largest(segment: Mapping[str, Any]) -> float:
    return max(abs(float(segment.get(key, 0.0))) for key in ('load', 'torque', 'low', 'high'))
