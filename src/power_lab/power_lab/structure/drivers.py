"""Drivers that missing power may depend on, and the families of shapes over them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from power_estimator.effects import Signals, smooth_sign
from wattwalk_core.arrays import Floats

from power_lab.structure.memory import after_rest, by_stretch, lagged, play


@dataclass(frozen=True)
class Driver:
    """A quantity of a drive, or of another one, that missing power may depend on."""

    name: str
    kind: str
    symbol: str
    unit: str
    code: str  # Python expression over signals and column, the index of the drive
    given: tuple[float, ...] = ()  # parameters of a state with memory
    other: str = ''  # drive that it is of
    memory: str = ''  # 'lag', 'rest' or 'play'


@dataclass(frozen=True)
class Factor:
    """Multiplier of the function of a driver."""

    name: str
    symbol: str  # '' for one
    unit: str
    code: str  # Python expression over what effect files name, '1.0' for one


_SIGN = 'smooth_sign(velocity, standstill)'
FACTORS = {
    name: Factor(name, symbol, unit, code)
    for name, symbol, unit, code in (
        ('one', '', '', '1.0'),
        ('sign', 'sgn w', '', _SIGN),
        ('velocity', 'w', 'rad/s', 'velocity'),
        ('speed', '|w|', 'rad/s', 'np.abs(velocity)'),
        ('torque_size', '|torque|', 'N·m', 'np.abs(torque)'),
        ('torque_square', 'torque²', '(N·m)²', 'np.square(torque)'),
        ('load_sign', '|torque|·sgn w', 'N·m', f'np.abs(torque) * {_SIGN}'),
    )
}


@dataclass(frozen=True)
class Family:
    """Functions s(driver)·factor of one driver and factor, which act on motor torque or power."""

    driver: Driver
    factor: Factor
    acts_on: Literal['torque', 'power']

    @property
    def kind(self) -> str:
        """Kind of quantity of the driver, such as `position`."""
        return self.driver.kind

    @property
    def group(self) -> tuple[str, ...]:
        """Key that a family shares with its variants: other memories, other drives."""
        return (self.driver.name, self.factor.name, self.acts_on)


def driver_values(driver: Driver, signals: Signals, drive: int) -> Floats:
    """Values of the driver at each sample [T]; drive: index of its drive."""
    other = signals.names.index(driver.other) if driver.other else drive
    return evaluated(driver.code, signals, drive, other=other, given=driver.given)


def evaluated(code: str, signals: Signals, drive: int, **more: object) -> Floats:
    """Values [T] of a Python expression that the lines above it in an effect file give names."""
    scope = {
        'np': np,
        'smooth_sign': smooth_sign,
        'signals': signals,
        'column': drive,
        'rate': signals.rate,
        'standstill': float(signals.scale.standstill[drive]),
        'velocity': signals.motor_velocity[:, drive],
        'torque': signals.torque[:, drive],
        **{state.__name__: state for state in (by_stretch, lagged, after_rest, play)},
        **more,
    }
    return np.asarray(eval(code, scope), dtype=np.float64)


def families(signals: Signals, drive: int) -> Iterator[Family]:
    """Yield all families that this drive's recording can show."""
    yield from _of_state(signals, drive)
    yield from _with_memory(signals, drive)
    yield from _of_others(signals, drive)


def _on(driver: Driver, torque: str = '', power: str = '') -> Iterator[Family]:
    """Yield families of a driver; torque, power: names of factors, by what the family acts on.

    Names are separated by spaces.
    """
    for name in torque.split():
        yield Family(driver, FACTORS[name], 'torque')
    for name in power.split():
        yield Family(driver, FACTORS[name], 'power')


def _of_state(signals: Signals, drive: int) -> Iterator[Family]:
    travel = float(np.ptp(signals.position[:, drive]))
    if np.isfinite(travel) and travel > 1e-3:
        place = 'signals.position[:, column]'
        places = [Driver('position', 'position', 'q', 'rad', place)]
        if travel > 2.0 * np.pi:
            place = f'np.mod({place}, 2.0 * np.pi)'
            places.append(Driver('angle', 'position', 'q within its turn', 'rad', place))
        for position in places:
            yield from _on(position, torque='one sign velocity load_sign', power='one')
    for size in (False, True):
        speed, torque, rate = (_signed_or_size(*quantity, size=size) for quantity in _SIGNED)
        yield from _on(speed, torque='sign' if size else 'one', power='one')
        yield from _on(torque, power='one velocity torque_square')
        yield from _on(torque, torque='sign')
        if size:
            yield from _on(rate, power='one')
        else:
            yield from _on(rate, torque='one')
    if float(np.ptp(signals.voltage[:, drive])) > 0.05:
        volts = Driver('voltage', 'voltage', 'V', 'V', 'signals.voltage[:, column]')
        yield from _on(volts, power='one torque_size speed')
    warmth = signals.temperature[:, drive]
    if np.isfinite(warmth).all() and float(np.ptp(warmth)) > 1.0:
        warm = Driver('temperature', 'temperature', 'T', '°C', 'signals.temperature[:, column]')
        yield from _on(warm, torque='sign velocity', power='one torque_square')


_AFTER_REST = (
    (0.15, 0.0),
    (0.5, 0.0),
    (1.5, 0.0),
    (5.0, 0.0),
    (0.0, 0.05),
    (0.0, 0.2),
    (0.0, 0.8),
)
"""Seconds, or else rad of travel, over which a rest is forgotten."""
_SIGNED = (
    ('speed', 'w', 'rad/s', 'signals.motor_velocity[:, column]'),
    ('torque', 'torque', 'N·m', 'signals.torque[:, column]'),
    ('acceleration', 'a', 'rad/s²', 'signals.acceleration[:, column]'),
)


def _signed_or_size(kind: str, symbol: str, unit: str, code: str, *, size: bool) -> Driver:
    """A quantity, or its magnitude for shapes that are even in it."""
    if size:
        return Driver(f'{kind}_size', kind, f'|{symbol}|', unit, f'np.abs({code})')
    return Driver(kind, kind, symbol, unit, code)


def _with_memory(signals: Signals, drive: int) -> Iterator[Family]:
    stroke = np.quantile(signals.position[:, drive], (0.05, 0.95))
    width = float(np.clip(stroke[1] - stroke[0], 1e-3, 2.0))
    for share in (0.02, 0.06, 0.2):
        code = 'by_stretch(signals, column, signals.position[:, column], play, *given)'
        lost = Driver('play', 'position', 'h', '', code, (share * width,), memory='play')
        yield from _on(lost, torque='one sign')
    still = np.abs(signals.velocity[:, drive]) < signals.scale.standstill[drive]
    if 0.02 < still.mean() < 0.98:
        for fades in _AFTER_REST:
            code = (
                'by_stretch(signals, column, signals.velocity[:, column], after_rest, '
                'rate, standstill, *given)'
            )
            rest = Driver('rest', 'speed', 'rest', '', code, fades, memory='rest')
            yield from _on(rest, torque='sign', power='one')
    for seconds in (20.0, 90.0, 300.0):
        heat = 'np.square(signals.torque[:, column])'
        code = f'by_stretch(signals, column, {heat}, lagged, rate, *given)'
        warm = Driver('heat', 'temperature', 'heat', '(N·m)²', code, (seconds,), memory='lag')
        yield from _on(warm, torque='sign velocity')


def _of_others(signals: Signals, drive: int) -> Iterator[Family]:
    for other, name in enumerate(signals.names):
        if other == drive:
            continue
        for quantity, symbol, unit, code in _OTHERS:
            words = f'{symbol} of {name}'
            driver = Driver(quantity, 'other_drive', words, unit, code, other=name)
            yield from _on(driver, power='one')


_OTHERS = (
    ('power_of', 'P', 'W', 'signals.drawn[:, other]'),
    ('speed_of', 'w', 'rad/s', 'signals.velocity[:, other]'),
    ('torque_of', 'torque', 'N·m', 'signals.torque[:, other]'),
)
