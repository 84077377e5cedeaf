"""Public logs of real drives as questions: what is left out of the model, and power that is added.

The logs lie in the folder of public logs that WATTWALK_REAL_DATA names; they are read by the
project's own import. The power of a hidden effect is added to the metered power by a formula of
this file, which the lab does not know.
"""

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from power_recordings.alignment.align import RATES, load_aligned
from power_recordings.alignment.dataset import AlignedDataset
from power_recordings.importing.convert import import_logs
from power_recordings.importing.map_file import ImportMap, load_map
from power_recordings.importing.sources import open_source
from power_recordings.reading.reader import Recording
from reliability_questions import Sealed
from truths.families import IN_MOTOR_TORQUE
from wattwalk_core.arrays import Floats
from wattwalk_core.errors import InputError

HERE = Path(__file__).resolve().parent
LOGS = Path(os.environ.get('WATTWALK_REAL_DATA') or HERE.parents[1] / 'shared' / 'real_data')
SIZES = (0.01, 0.02, 0.05, 0.1, 0.2)
"""Rms of the added power, as shares of the rms of the metered power about its mean."""
_OVERSAMPLED = 1.9
_LEAST = 1e-6
_BURST = 0.5  # s; half of what an effect shows in less than this is no motion that shows it


@dataclass(frozen=True)
class DriveLog:
    """A log and what is known of its drives.

    left_out: effects that surely exist; each is left out of the model in one question.
    known: effects of the model. impossible: effects that cannot be missing in this log.
    """

    files: str  # glob below LOGS
    map: str  # ready map by name, or a file of log_maps
    left_out: tuple[str, ...] = ('copper_loss',)
    known: tuple[str, ...] = ('shaft', 'copper_loss', 'idle')
    impossible: frozenset[str] = frozenset()


STALL = frozenset({'iron_loss', 'field_weakening', 'viscous_friction', 'load_friction'})
STEADY = frozenset({'rotor_inertia', 'spring', 'winding_heating', 'cogging'})
DRIVING = frozenset({'regeneration_efficiency', 'regeneration_limit'})
DRIVE_LOGS: Mapping[str, DriveLog] = {
    'hopper': DriveLog('hopper_500_hops.mat', 'hopper.yaml'),
    'hopper_square': DriveLog('hopper_square.mat', 'hopper.yaml'),
    'ur3e': DriveLog('ur3e_move.xlsx', 'ur_rtde'),
    'cobot': DriveLog('yu_cobot.parquet', 'voraus'),
    'hebi': DriveLog('hebi_x.hebilog', 'hebi'),
    'moteus_warm': DriveLog(
        'moteus_dyno/futek_test_24_05_2021_16-20-14.csv',
        'moteus_dyno.yaml',
        ('copper_loss', 'winding_heating'),
        ('shaft', 'copper_loss', 'idle', 'winding_heating'),
        STALL | DRIVING,
    ),
    'moteus_stall': DriveLog(
        'moteus_dyno/futek_test_17_05_2021_17-01-51.csv',
        'moteus_dyno.yaml',
        impossible=STALL | DRIVING,
    ),
    'moteus_damped': DriveLog(
        'moteus_dyno/futek_test_17_05_2021_17-21-15.csv', 'moteus_dyno.yaml'
    ),
    'moteus_driven': DriveLog(  # its load held the shaft still, to 0.08 rad
        'moteus_dyno/futek_test_18_05_2021_12-24-46.csv',
        'moteus_dyno.yaml',
        impossible=STALL | DRIVING,
    ),
    'compact': DriveLog(
        'compact_sspg/SSPG_MN8014_7_2__12.00_*.csv',
        'compact_sspg.yaml',
        known=('shaft', 'copper_loss', 'idle', 'coulomb_friction'),
        impossible=DRIVING,
    ),
    'ev_motor': DriveLog(
        'ev_motor/Motor.csv',
        'ev_motor.yaml',
        known=('shaft', 'copper_loss', 'idle', 'iron_loss'),
        impossible=STEADY,
    ),
    'odrive': DriveLog('odrive_d5065/odrive_D5065.csv', 'odrive_d5065.yaml', impossible=STEADY),
    'vesc_bike': DriveLog('vesc_bike/data.csv', 'vesc_bike.yaml'),
    'thrust': DriveLog('thrust_t7056/*.csv', 'thrust_t7056.yaml', impossible=DRIVING),
}


def log_files(pattern: str) -> list[Path]:
    """Return the files below LOGS that match a glob pattern; InputError where there is none."""
    files = sorted(LOGS.glob(pattern))
    if not files:
        raise InputError(f'{LOGS / pattern} is absent; WATTWALK_REAL_DATA says where logs lie')
    return files


def log_map(name: str) -> ImportMap:
    """Load a ready map by its name, or a file of log_maps."""
    return load_map(str(HERE / 'log_maps' / name) if Path(name).suffix else name)


def imported(pattern: str, mapping: str, folder: Path) -> list[Path]:
    """Import logs into a folder, one recording each; return their paths.

    pattern: glob below LOGS. mapping: see `log_map`. InputError where they are absent.
    """
    files, given = log_files(pattern), log_map(mapping)
    own = folder / Path(mapping).stem
    own.mkdir()
    for file in files:
        import_logs([open_source(file, None)], given, f'map {mapping}', own / file.stem)
    return [own / file.stem for file in files]


@cache
def read_log(name: str) -> AlignedDataset:
    """Import and align a log; InputError where it is absent or cannot be read."""
    log = DRIVE_LOGS[name]
    with tempfile.TemporaryDirectory(prefix='wattwalk') as folder:
        bags = imported(log.files, log.map, Path(folder))
        recordings = [Recording.open(bag) for bag in bags]
        periods = [np.median(np.diff(one.joint_states().stamp_ns)) / 1e9 for one in recordings]
        rate = min((r for r in RATES if r * min(periods) >= _OVERSAMPLED), default=max(RATES))
        return load_aligned(recordings, rate=rate, smooth=False, need_power=False)


@dataclass(frozen=True)
class OfLog:
    """A question about a log: hidden effects are added, or left out of the model (`left_out`)."""

    log: str
    added: str = ''
    size: float = 0.0
    left_out: str = ''

    @property
    def key(self) -> str:
        """Key in a file of results."""
        return f'logs|{self.log}|{self.added}|{self.size:g}|{self.left_out}'

    @cached_property
    def about(self) -> Mapping[str, object]:
        """Properties of the question for the file of results, as of `Question.about`."""
        data = read_log(self.log)
        hidden = [f'{self.added} {self.size:.0%}'] if self.added else []
        hidden += [f'{self.left_out} left out'] if self.left_out else []
        return {
            'family': f'log {self.log}',
            'developed': True,  # some were in view when the procedure was made
            'motion': self.log,
            'seconds': round(len(data.time) / data.rate),
            'drives': len(data.names),
            'hidden': hidden,
            'left_out': self.left_out,
        }

    def seal(self) -> Sealed:
        """Read the log, add the hidden power and return it with the truth."""
        log, data = DRIVE_LOGS[self.log], read_log(self.log)
        known = tuple(name for name in log.known if name != self.left_out)
        impossible = set(log.impossible)
        if data.motor_torque:
            impossible |= {*IN_MOTOR_TORQUE} - {'iron_loss'}
        missing, watts = set(), {}
        if self.left_out:
            missing.add(self.left_out)
            watts[self.left_out] = _left_out_watts(self.left_out, data)
        if self.added:
            power = added_power(self.added, data, self.size)
            data = with_power(data, power)
            names = ADDED[self.added]
            missing |= set(names)
            watts['|'.join(names)] = _unabsorbed(power, data)
        return Sealed(
            data,
            known,
            frozenset(missing),
            watts=watts,
            complete=False,
            impossible=frozenset(impossible - missing),
        )


ADDED: Mapping[str, tuple[str, ...]] = {
    'winding_heating': ('winding_heating',),
    'iron': ('iron_loss',),
    'blocked': ('regeneration_efficiency', 'regeneration_limit'),
    'half_blocked': ('regeneration_efficiency', 'regeneration_limit'),
    'switching': ('inverter_loss',),
    'load_friction': ('load_friction',),
    'line': ('line_resistance',),
}
"""Powers that are added, and the names of which any is right."""


def added_power(name: str, data: AlignedDataset, size: float) -> Floats:
    """Return the power of a hidden effect, W [T, D]; name: a key of ADDED.

    size: RMS as a share of the metered power's; unused by blocked braking, which is whole or half.
    """
    tau = data.torque.astype(np.float64)
    w = data.velocity.astype(np.float64)
    if name in ('blocked', 'half_blocked'):
        share = 1.0 if name == 'blocked' else 0.5
        return share * np.maximum(-data.power.astype(np.float64), 0.0)
    power = _shape(name, data, tau, w)
    meters = metered(data)
    shown = power.sum(axis=1, keepdims=True) if is_whole(data) else power
    return power * (size * rms(meters) / max(rms(shown), _LEAST))


def _shape(name: str, data: AlignedDataset, tau: Floats, w: Floats) -> Floats:
    if name == 'iron':
        return np.abs(w) ** 1.5
    if name == 'switching':
        size = np.sqrt(tau**2 + (0.02 * np.nanmax(np.abs(tau), axis=0)) ** 2)
        return size + 0.3 * size**2 / np.nanmax(size, axis=0)
    if name == 'load_friction':
        return np.abs(tau * w) / (1 + 0.1 * np.abs(w) / np.nanmax(np.abs(w), axis=0))
    if name == 'line':
        return np.square(data.power.astype(np.float64) / data.voltage.astype(np.float64))
    return tau**2 * _rise(data, tau)


def _rise(data: AlignedDataset, tau: Floats) -> Floats:
    """Rise of a winding by two heat capacities in series, up to scale."""
    heat = np.nan_to_num(tau**2)
    winding, housing, rise = np.zeros(heat.shape[1]), np.zeros(heat.shape[1]), []
    step = 1.0 / data.rate
    for row in heat:
        flow = (winding - housing) / 25.0
        winding = winding + step * (row - flow) / 1.0
        housing = housing + step * (flow - housing / 400.0) / 8.0
        rise.append(winding)
    return np.asarray(rise)


def _unabsorbed(power: Floats, data: AlignedDataset) -> float:
    """W rms of an added power, where shaft, copper and idle absorb less than half of it.

    Else what they leave of it.
    """
    left = [residual(column, _model(data, place))[0] for place, column in enumerate(power.T)]
    rest, size = float(np.sqrt(np.mean(np.square(np.concatenate(left))))), rms(power)
    return size if rest >= 0.5 * size else rest


def _shown_s(power: Floats, data: AlignedDataset) -> float:
    """Seconds with half of the squares of what the model's effects leave of an added power."""
    shown = 0.0
    for place, column in enumerate(power.T):
        squares = np.sort(np.square(residual(column, _model(data, place))[0]))[::-1].cumsum()
        half = 0.5 * squares[-1:]  # empty for a drive that is not metered
        shown = max(shown, *(np.searchsorted(squares, half) / data.rate), 0.0)
    return shown


def _left_out_watts(effect: str, data: AlignedDataset) -> float:
    """W rms by which a left-out effect's own column makes the error of the others smaller."""
    gains = []
    for place, power in enumerate(metered(data).T):
        places = range(len(data.names)) if is_whole(data) else (place,)
        model = np.hstack([_model(data, one) for one in places])
        without = np.delete(model, np.s_[1::3], axis=1)
        if effect == 'winding_heating':
            warm = (data.temperature[:, list(places)] - 25.0) * model[:, 1::3]
            model, without = np.hstack([model, warm]), model
        before, after = (residual(power, columns)[0] for columns in (without, model))
        gains.append(np.mean(np.square(before)) - np.mean(np.square(after)))
    return float(np.sqrt(max(np.mean(gains), 0.0)))


def _model(data: AlignedDataset, place: int) -> Floats:
    tau, w = (values[:, place].astype(np.float64) for values in (data.torque, data.velocity))
    return np.stack([tau * w, tau**2, np.ones_like(tau)], axis=1)


def residual(values: Floats, model: Floats) -> tuple[Floats, Floats]:
    """Fit finite rows of values [T] by model [T, K]; return residuals and coefficients [K]."""
    known = np.isfinite(values) & np.isfinite(model).all(axis=1)
    solved = np.linalg.lstsq(model[known], values[known], rcond=None)[0]
    return values[known] - model[known] @ solved, solved


def is_whole(data: AlignedDataset) -> bool:
    """Return whether the whole robot is metered, not its drives."""
    return not data.measured_drives()


def metered(data: AlignedDataset) -> Floats:
    """Return the metered power, W: of the drives [T, D] or of the whole robot [T, 1]."""
    return (data.supply[:, None] if is_whole(data) else data.power).astype(np.float64)


def rms(power: Floats) -> float:
    """Return the RMS of power [T, M] about the mean of each meter, W."""
    return float(np.sqrt(np.nanmean(np.square(power - np.nanmean(power, axis=0)))))


def with_power(data: AlignedDataset, more: Floats) -> AlignedDataset:
    """Return the data with power `more`, W [T, D], added to that of the drives or the robot."""
    if is_whole(data):
        return replace(data, supply=(data.supply + more.sum(axis=1)).astype(np.float32))
    power = (data.power + more).astype(np.float32)
    current = (data.current + more / data.voltage).astype(np.float32)
    return replace(data, power=power, current=current)


def log_questions() -> tuple[list[OfLog], list[str]]:
    """Return questions on all logs present, and the reasons why others are skipped."""
    questions, skipped = [], []
    for name, log in DRIVE_LOGS.items():
        try:
            data = read_log(name)
        except InputError as error:
            skipped.append(f'{name}: {error}')
            continue
        questions.append(OfLog(name))
        questions += [OfLog(name, left_out=effect) for effect in log.left_out]
        questions += [OfLog(name, added, size) for added, size in _fitting(log, data)]
    return questions, skipped


def _fitting(log: DriveLog, data: AlignedDataset) -> list[tuple[str, float]]:
    """Powers that the motion of a log shows, the drive can lack, and physics allows."""
    out = []
    for name, effects in ADDED.items():
        if set(effects) & (log.impossible | set(log.known)):
            continue
        if name == 'load_friction' and data.motor_torque:
            continue
        whole = name in ('blocked', 'half_blocked')
        if (whole or name == 'line') and is_whole(data):
            continue
        power = added_power(name, data, 0.05)
        if not np.isfinite(power).any() or rms(power) < 0.005 * rms(metered(data)):
            continue
        if not data.steady and _shown_s(power, data) < _BURST:
            continue
        sizes = (rms(power) / rms(metered(data)),) if whole else SIZES
        out += [(name, size) for size in sizes]
    return out
