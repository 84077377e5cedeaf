"""Certified power analyser at the terminals of one drive's meter, with a CSV log."""

import io
from math import pi
from pathlib import Path
from typing import Annotated, Final

import numpy as np
from scipy.interpolate import CubicSpline
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError
from wattwalk_core.files import write_whole
from wattwalk_core.schema import Quantity, schema

from sim_bridge.plant.simulation import PlantBlock
from sim_bridge.sensors.sensors import DeviceClock

_RIPPLE_PER_TURN: Final = 6 * 21 * 50
"""Commutations of the inverter, poles in pairs and gear: periods per turn of the joint."""
_LOWEST, _FULL = 2000.0, 4000.0  # Hz, between which the ripple sets in


@schema
class AnalyserParameters:
    """Parameters of the power analyser and its clock.

    Rows are means over their period, stamped at the middle of it. ripple: current that the
    inverter's commutation adds, as a share of the current; it is left out under 2 kHz, for there
    the plant's steps could not show it to the meter. Noise and ripple are assumed.
    """

    rate: Annotated[float, Quantity(100.0, 1e6, 'Hz', 'rows per second')] = 20_000.0
    clock_offset: Annotated[float, Quantity(-1e10, 1e10, 's', 'at the start of the run')] = 0.0
    clock_drift: Annotated[float, Quantity(-500.0, 500.0, 'ppm', 'of its clock, fast')] = 0.0
    voltage_noise: Annotated[float, Quantity(0.0, 5.0, 'V', 'standard deviation')] = 0.004
    current_noise: Annotated[float, Quantity(0.0, 5.0, 'A', 'standard deviation')] = 0.004
    ripple: Annotated[float, Quantity(0.0, 1.0, '', 'share of the current')] = 0.1


class Analyser:
    """Logger of the voltage, current and power of the first drive.

    Between the plant's steps of 0.5 ms, which are means, voltage and current follow a spline that
    keeps every mean; the ripple within a step has none, so that meter and analyser see one truth.
    """

    def __init__(self, parameters: AnalyserParameters, clock: DeviceClock, seed: int = 0) -> None:
        """Make an analyser; clock: times the plant's steps; seed: of noise and ripple."""
        self._given = parameters
        self._clock = clock
        self._random = np.random.default_rng([seed, 0xA7A1])
        self._blocks: list[tuple[Floats, Floats, Floats]] = []

    def watch(self, block: PlantBlock) -> None:
        """Add the next block of the plant; only the first drive is logged."""
        current = block.power[:, 0] / block.voltage
        self._blocks.append((block.voltage.copy(), current, block.position[:, 0].copy()))

    def rows(self) -> Floats:
        """Return the log [N, 4]: time in s of the analyser's clock, V, A, W."""
        given = self._given
        voltage, current, angle = (
            np.concatenate(parts) for parts in zip(*self._blocks, strict=True)
        )
        edges = 1e-9 * self._clock.elapsed_ns(np.arange(len(voltage) + 1)).astype(np.float64)
        inside = max(1, round(20_000.0 / given.rate))
        period = 1.0 / given.rate / (1.0 + 1e-6 * given.clock_drift)
        count = int(edges[-1] / period)
        middles = np.arange(count * inside, dtype=np.float64) + 0.5
        fine: Floats = np.asarray(middles * (period / inside), np.float64)
        volts = _between(edges, voltage)(fine)
        amps = _between(edges, current)(fine)
        amps += given.ripple * self._ripple(edges, angle, current, fine)
        amps, volts, watts = (
            values.reshape(count, inside).mean(axis=1) for values in (amps, volts, volts * amps)
        )
        volt_noise = given.voltage_noise * self._random.standard_normal(count)
        amp_noise = given.current_noise * self._random.standard_normal(count)
        watts += volts * amp_noise + amps * volt_noise
        shown = given.clock_offset + (np.arange(count) + 0.5) / given.rate
        return np.column_stack((shown, volts + volt_noise, amps + amp_noise, watts))

    def _ripple(self, edges: Floats, angle: Floats, current: Floats, fine: Floats) -> Floats:
        """Ripple current over the amplitude of a share, A, without a mean in any step."""
        joint = np.concatenate([[angle[0]], angle])
        phase = np.interp(fine, edges, joint) * _RIPPLE_PER_TURN
        step = np.minimum(np.searchsorted(edges, fine, side='right') - 1, len(current) - 1)
        frequency = np.abs(np.diff(joint) / np.diff(edges)) * _RIPPLE_PER_TURN / (2.0 * pi)
        size = np.abs(current) * np.clip((frequency - _LOWEST) / (_FULL - _LOWEST), 0.0, 1.0)
        raw = size[step] * np.sin(phase)
        seen = np.bincount(step, minlength=len(current))
        mean = np.bincount(step, raw, minlength=len(current)) / np.maximum(seen, 1)
        return np.asarray(raw - mean[step], np.float64)

    def save(self, path: Path) -> int:
        """Write the log as CSV and return its number of rows; RecordingError if that fails."""
        rows = self.rows()
        text = io.StringIO()
        text.write(
            'Power analyser (simulated),1 channel,DC coupled\n'
            f'Rate,{self._given.rate:g} Hz\n\n'
            'Time [s],U [V],I [A],P [W]\n'
        )
        np.savetxt(text, rows, '%.6f,%.4f,%.5f,%.4f')
        write_whole(path, text.getvalue())
        return len(rows)


def _between(edges: Floats, means: Floats) -> CubicSpline:
    """Return a smooth curve with given means between edges."""
    whole = np.concatenate([[0.0], np.cumsum(means * np.diff(edges))])
    return CubicSpline(edges, whole).derivative()


def check_output(path: Path) -> None:
    """Raise InputError unless a path ends in .csv and lies in an existing folder."""
    if path.suffix.lower() != '.csv':
        raise InputError(f'--analyser {str(path)!r}: end it in .csv')
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f'--analyser {str(path)!r}: there is no such folder, create it first')
