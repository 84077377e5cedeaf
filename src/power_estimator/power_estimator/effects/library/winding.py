"""Heat in the winding, and what it does to the resistance."""

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import Effect, Excitation, Shape, Term, share_of_top
from power_estimator.effects.signals.state import Signals

REFERENCE = 25.0  # °C at which the copper loss has its nominal coefficient

COPPER = 0.0039  # relative growth of copper's resistance per kelvin
_SHOWS = 0.1  # growth of a resistance, by a temperature that was measured, that should show


def _saturation(signals: Signals, **_: float) -> Floats:
    """A torque constant that saturates under load."""
    return np.square(signals.motor_torque) * np.square(share_of_top(signals.motor_torque))


def _heating(signals: Signals, *, time_constant: float = 0.0, **_: float) -> Floats:
    """Copper loss per unit coefficient times the winding's rise in temperature."""
    squared = np.square(signals.motor_torque)
    if time_constant <= 0.0:
        rise = np.nan_to_num(signals.temperature - REFERENCE)
        return np.stack([squared * COPPER * rise, np.zeros_like(squared)], axis=-1)
    if signals.steady:
        return np.zeros((*squared.shape, 2))
    rise, remaining = _thermal_state(signals, time_constant)
    return np.stack([squared * COPPER * rise, squared * COPPER * remaining], axis=-1)


def _temperature_moved(signals: Signals, *, time_constant: float = 0.0, **_: float) -> bool:
    """Return whether this shape's temperature was recorded and changed."""
    if time_constant > 0.0:
        return not signals.steady
    seen = np.isfinite(signals.temperature)
    return bool(seen.all() and np.ptp(signals.temperature, axis=0).max() > 1.0)


def _warmed(signals: Signals, shape: Shape) -> bool:
    """Return whether a measured temperature moved so far that the loss has to show it."""
    if shape['time_constant'] > 0.0:
        return False
    return bool(np.ptp(signals.temperature, axis=0).max() * COPPER >= _SHOWS)


def _thermal_state(signals: Signals, time_constant: float) -> tuple[Floats, Floats]:
    """First-order response to the torque squared, and the decay of the initial state [T, D].

    Gaps inside a recording count as time without load; a new recording starts anew.
    """
    from scipy.signal import lfilter  # slow to import; few models have this effect

    of = signals if signals.past is None else signals.past
    states = np.zeros((2, *of.torque.shape))
    decay = np.exp(-1.0 / (signals.rate * time_constant))
    heat = np.square(of.torque)
    key, carried = ('winding_heating', time_constant), signals.carried
    begun = None if carried is None else carried.before(key, float(of.time[0]))
    last, state = (0.0, states[:, 0]) if begun is None else begun
    previous = -1 if begun is None else int(of.recording[0])
    for part in of.stretches():
        recording = int(of.recording[part.start])
        time = of.time[part]
        if recording != previous:
            state, last = np.stack([np.zeros_like(state[0]), np.ones_like(state[1])]), time[0]
        gap = np.exp(-max(0.0, time[0] - last - 1.0 / signals.rate) / time_constant)
        states[0, part], _ = lfilter(
            [1.0 - decay], [1.0, -decay], heat[part], axis=0, zi=(decay * gap * state[0])[None]
        )
        states[1, part] = np.exp(-(time - last) / time_constant)[:, None] * state[1]
        previous, last, state = recording, time[-1], states[:, part.stop - 1]
    if carried is not None:
        carried.keep(key, of.time, states.swapaxes(0, 1), unknown=float(state[1].max()))
    rise, remaining = states if signals.past is None else states[:, signals.past.rows]
    return rise, remaining


COPPER_LOSS = Effect(
    name='copper_loss',
    physics='the current that makes the torque heats the winding and whatever is in line with it',
    formula='k·motor_torque², motor_torque = torque + friction + J·acceleration',
    terms=(Term('k', 'W/(N·m)²', 0.0, 1.0),),
    scaling={'gear_ratio': (-2.0,), 'winding_resistance': (1.0,)},
    regressors=lambda signals, **_: np.square(signals.motor_torque)[..., None],
    torque_slope=lambda signals, k: 2.0 * k[..., 0] * signals.motor_torque,
    discrepancy=_saturation,
    discrepancy_limit=0.12,
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    ties=('inverter_resistance',),
    near=('line_resistance', 'winding_heating'),
    excitation=Excitation(
        'static loads at standstill',
        mode='torque',
        speeds=(0.0,),
        loads=(-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0),
    ),
)
WINDING_HEATING = Effect(
    name='winding_heating',
    physics='a warm winding has more resistance: +0.39 % copper loss per kelvin',
    formula="c·motor_torque²·0.0039/K·dT; dT in K, or in (N·m)²: time_constant·dT' = torque² − dT",
    terms=(
        Term('c', 'W/(N·m)²', formerly='W/((N·m)²·K)'),
        Term('c0', 'W/(N·m)²', of_recording=True),
    ),
    scaling={'gear_ratio': (-4.0, -4.0), 'winding_resistance': (2.0, 2.0)},
    regressors=_heating,
    recorded=_temperature_moved,
    enough=_warmed,
    part_of='copper_loss',
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    shapes=tuple(
        {'time_constant': seconds}
        for seconds in (0.0, 8.0, 20.0, 50.0, 120.0, 300.0, 700.0, 1500.0)
    ),
    near=('copper_loss',),
    excitation=Excitation(
        'a hot soak longer than three thermal time constants, then cooling under light load',
        mode='torque',
        speeds=(0.0,),
        loads=(30.0, 5.0),
        seconds=900.0,
    ),
)


_LOADS = (-40.0, -30.0, -20.0, -10.0, 10.0, 20.0, 30.0, 40.0)
_MOST_PER_KELVIN = 0.005  # ferrite loses 0.002/K, neodymium 0.001/K


def _less_torque(signals: Signals, **_: float) -> Floats:
    """Minus the shaft's power times the torque squared, of a torque by its current."""
    return (-(signals.torque**3) * signals.motor_velocity * signals.at_motor)[..., None]


def _weaker(signals: Signals, **_: float) -> Floats:
    """Minus the shaft's power times the rise in temperature, of a torque by its current."""
    rise = np.nan_to_num(signals.temperature - REFERENCE)
    return (-rise * signals.torque * signals.motor_velocity * signals.at_motor)[..., None]


def _warmed_motor(signals: Signals, **_: float) -> bool:
    """Return whether a torque is known by its current, and its motor's temperature moved."""
    return bool((np.ptp(signals.temperature, axis=0) * signals.at_motor > 1.0).any())


SATURATION = Effect(
    name='saturation',
    physics='iron that saturates asks for more current than in proportion, the larger the load',
    formula='c·motor_torque⁴, of a torque at the joint',
    terms=(Term('c', 'W/(N·m)⁴'),),
    scaling={'gear_ratio': (-4.0,), 'winding_resistance': (1.0,)},
    regressors=lambda signals, **_: (signals.motor_torque**4 * ~signals.at_motor)[..., None],
    torque_slope=lambda signals, c: 4.0 * c[..., 0] * signals.motor_torque**3 * ~signals.at_motor,
    recorded=lambda signals, **_: not bool(signals.at_motor.all()),
    # Beside departures of copper loss it is at most likely, and others lose their names.
    proposed=lambda _: False,
    part_of='copper_loss',
    follows=frozenset({'motor_torque'}),
    per_drive=True,
    near=('copper_loss', 'line_resistance'),
    excitation=Excitation(
        'static loads at standstill up to the largest', mode='torque', speeds=(0.0,), loads=_LOADS
    ),
)
MOTOR_SATURATION = Effect(
    name='motor_saturation',
    physics='iron that saturates makes less torque than the current says, the larger the load',
    formula='−s·torque³·w, of a torque that is a current times a constant',
    terms=(Term('s', '1/(N·m)²'),),
    scaling={'gear_ratio': (-2.0,)},
    regressors=_less_torque,
    recorded=lambda signals, **_: bool(signals.at_motor.any()),
    per_drive=True,
    near=('copper_loss', 'regeneration_efficiency'),
    excitation=Excitation(
        'the same speeds under loads up to the largest', speeds=(2.0, -2.0), loads=_LOADS
    ),
)
MAGNET_HEATING = Effect(
    name='magnet_heating',
    physics='warm magnets are weaker: a motor makes less torque than its current says',
    formula='−alpha·dT·torque·w, of a torque that is a current times a constant; dT measured',
    terms=(Term('alpha', '1/K', 0.0, _MOST_PER_KELVIN),),
    scaling={},
    regressors=_weaker,
    recorded=_warmed_motor,
    per_drive=True,
    near=('power_gain', 'winding_heating'),
    excitation=Excitation(
        'the same motion under load, cold and after a hot soak',
        speeds=(2.0, 4.0, -2.0, -4.0),
        loads=(-30.0, 30.0),
        seconds=60.0,
    ),
)
