"""Reference motions of one drive on the bench (Section III-A of the paper)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import copysign, log, pi, sin
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray
from power_daq.cli import InputError

from sim_bridge.drive import JointCommand
from sim_bridge.simulation import Simulation

Floats = NDArray[np.float64]
MODES: Final[Mapping[str, tuple[float, float, str]]] = MappingProxyType(
    {
        'position': (1.5, 6.0, 'rad'),
        'velocity': (5.0, 20.0, 'rad/s'),
        'torque': (10.0, 80.0, 'N·m'),
    }
)
"""By mode: default and greatest amplitude, and their unit."""

_LADDER: Final = (0.25, -0.25, 0.5, -0.5, 0.75, -0.75, 1.0, -1.0, 0.0)
_RUNG: Final = 2.0  # s
_CHIRP_SPAN: Final = 20.0  # highest frequency over lowest
_CHIRP_TIME: Final = 20.0  # s


@dataclass(frozen=True)
class Shape:
    """A motion of amplitude 1: its value at a time (s) for a frequency (Hz)."""

    text: str
    frequency: float  # Hz, default
    value: Callable[[float, float], float]


def _sine(time: float, frequency: float) -> float:
    return sin(2.0 * pi * frequency * time)


def _square(time: float, frequency: float) -> float:
    return copysign(1.0, sin(2.0 * pi * frequency * time + 1e-9))


def _chirp(time: float, frequency: float) -> float:
    share = (time % _CHIRP_TIME) / _CHIRP_TIME
    rate = log(_CHIRP_SPAN)
    lowest = frequency / _CHIRP_SPAN
    return sin(2.0 * pi * lowest * _CHIRP_TIME * (_CHIRP_SPAN**share - 1.0) / rate)


def _ladder(time: float, frequency: float) -> float:
    return _LADDER[int(time / _RUNG) % len(_LADDER)]


def _still(time: float, frequency: float) -> float:
    return 0.0


SHAPES: Final[Mapping[str, Shape]] = MappingProxyType(
    {
        'sine': Shape('sine of one frequency; the paper: position, 4 Hz, 1.5 rad', 4.0, _sine),
        'square': Shape('jumps between plus and minus the amplitude', 0.5, _square),
        'chirp': Shape('sine that rises to the frequency within 20 s, from a 20th', 4.0, _chirp),
        'ladder': Shape('holds 1/4, 1/2, 3/4 and all of the amplitude, both signs', 1.0, _ladder),
        'still': Shape('holds zero', 1.0, _still),
    }
)


class Motion:
    """Commands a motion to the one drive of a stand, at 400 Hz."""

    period = 5
    velocity: Floats | None = None

    def __init__(
        self,
        shape: str,
        mode: str = 'position',
        amplitude: float | None = None,
        frequency: float | None = None,
    ) -> None:
        """InputError for unknown names and values out of range."""
        if shape not in SHAPES:
            raise InputError(f'no motion {shape!r}; there are {", ".join(SHAPES)}')
        if mode not in MODES:
            raise InputError(f'no mode {mode!r}; there are {", ".join(MODES)}')
        default, most, unit = MODES[mode]
        self.amplitude = default if amplitude is None else amplitude
        if not 0.0 <= self.amplitude <= most:
            raise InputError(f'amplitude is {amplitude!r}; it must lie in 0..{most:g} {unit}')
        self.frequency = SHAPES[shape].frequency if frequency is None else frequency
        if not 0.01 <= self.frequency <= 100.0:
            raise InputError(f'frequency is {frequency!r}; it must lie in 0.01..100 Hz')
        self.name = f'{shape}, {mode} mode, {self.amplitude:g} {unit}, {self.frequency:g} Hz'
        self._value = SHAPES[shape].value
        self._mode = mode

    def command(self, simulation: Simulation) -> JointCommand:
        """The target now."""
        target = np.array([self.amplitude * self._value(simulation.time, self.frequency)])
        if self._mode == 'position':
            return JointCommand(position=target)
        if self._mode == 'velocity':
            return JointCommand(velocity=target)
        return JointCommand(effort=target)

    def reset(self) -> None:
        """Nothing to forget."""
