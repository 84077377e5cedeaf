"""Circuits with hidden effects that no catalogue has, for the blind benchmark of discover.

Three drives as in truth_circuit; each hidden effect is drawn at random by the unit of the robot,
so that two recordings of one robot share it. Shapes are not those of the grammar of discover.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from power_recordings.alignment.dataset import AlignedDataset
from truth_circuit import RATE, Faults, Truth, _first_order, _ladder, _measure, _smooth, _walk
from wattwalk_core.arrays import Floats

Draw = np.random.Generator


@dataclass(frozen=True)
class Plant:
    """Signals that a hidden effect may read, all [T, 3] at 2 kHz."""

    time: Floats  # s [T]
    q: Floats
    w: Floats
    a: Floats
    tau: Floats
    supply: Floats  # V
    winding: Floats  # °C
    power: Floats  # W, without the hidden effect
    unit: Draw
    run: Draw  # differs from recording to recording


@dataclass(frozen=True)
class Change:
    """Action of a hidden effect, each [T, 3]: friction N·m, input power W, current factor."""

    drag: Floats | float = 0.0
    watts: Floats | float = 0.0
    current: Floats | float = 1.0  # at the same torque


@dataclass(frozen=True)
class Hidden:
    """One hidden effect, the kinds that describe it, and the motions that show it."""

    kinds: frozenset[str]
    change: Callable[[Plant], Change]
    motions: tuple[str, ...] = ('walk', 'ladder')

    @property
    def in_state(self) -> bool:
        """True unless the effect depends on time alone."""
        return self.kinds != {'time'}


def _angle(q: Floats) -> Floats:
    return np.mod(q + np.pi, 2 * np.pi) - np.pi


def _soft(x: Floats) -> Floats:
    return np.logaddexp(0.0, x)


def _sign(w: Floats) -> Floats:
    return (2 / np.pi) * np.arctan(w / 0.03)


_MIDDLE = np.array([0.0, 0.4, -0.9])
"""Rad, of the usual gait, where the joints of the leg are."""
_REACH = np.array([0.12, 0.25, 0.25])


def _place(p: Plant) -> Change:
    middle = _MIDDLE + _REACH * p.unit.uniform(-0.6, 0.6, 3)
    half = _REACH * p.unit.uniform(0.25, 0.5, 3)
    strength = p.unit.uniform(4.0, 8.0, 3) * (p.unit.permutation(3) < 2)
    away = (_angle(p.q) - middle) / half
    return Change(drag=strength * np.exp(-(away**4)) * _sign(p.w))


def _eccentric(p: Plant) -> Change:
    order = p.unit.integers(5, 13)
    phase = p.unit.uniform(0, 2 * np.pi, 3)
    tooth = np.cos(order * p.q + phase)
    return Change(
        drag=p.unit.uniform(3.0, 6.0) * (0.5 + 0.5 * tooth + 0.1 * tooth**3) * _sign(p.w)
    )


def _backlash(p: Plant) -> Change:
    lost = p.unit.uniform(0.02, 0.06)
    state, out = np.zeros(3), np.empty_like(p.q)
    step = p.w / RATE / lost
    for i, now in enumerate(step):
        state = np.clip(state + now * (1 - state * np.sign(now)), -1, 1)
        out[i] = state
    return Change(drag=p.unit.uniform(4.0, 7.0) * (out - _sign(p.w)) * 0.5)


def _cable(p: Plant) -> Change:
    from_ = _MIDDLE + 0.3 * _REACH * p.unit.choice([-1, 1], 3)
    stretch = np.sin(0.5 * (_angle(p.q) - from_)) * 2
    pull = np.maximum(stretch, 0) ** 1.6 * p.unit.uniform(20.0, 40.0)
    return Change(drag=pull * (1 + 0.5 * _sign(p.w)))


def _seal(p: Plant) -> Change:
    fade = p.unit.uniform(8.0, 15.0)
    return Change(drag=p.unit.uniform(4.0, 7.0) * 2 ** (-(p.winding - 25) / fade) * _sign(p.w))


def _chopper(p: Plant) -> Change:
    limit = 48.0 + p.unit.uniform(0.2, 0.6)
    return Change(watts=p.unit.uniform(15.0, 30.0) * 0.05 * _soft((p.supply - limit) / 0.05))


def _cross_talk(p: Plant) -> Change:
    beside = _first_order(np.roll(p.power, 1, axis=1), 0.003)
    return Change(watts=p.unit.uniform(0.04, 0.08) * beside)


def _saturation(p: Plant) -> Change:
    knee = p.unit.uniform(8.0, 14.0)
    over = _soft((np.abs(p.tau) - knee) / 1.5) * 1.5
    return Change(current=1 + 0.012 * p.unit.uniform(0.8, 1.6) * over)


def _dead_time(p: Plant) -> Change:
    amps = p.tau / 5.0
    return Change(watts=p.unit.uniform(5.0, 9.0) * (1 - np.exp(-((amps / 0.8) ** 2))))


def _fan(p: Plant) -> Change:
    period = p.unit.uniform(6.0, 25.0)
    phase = p.time / period + p.run.uniform()
    on = 1 / (1 + np.exp(-40 * (np.sin(2 * np.pi * phase) - p.unit.uniform(-0.5, 0.5))))
    return Change(watts=on[:, None] * p.unit.uniform(3.0, 7.0, 3))


def _after_holding(p: Plant) -> Change:
    stuck, out = np.zeros(3), np.empty_like(p.q)
    bond, release = np.exp(-1 / (RATE * 0.5)), p.unit.uniform(0.1, 0.4)
    travel = np.abs(p.w) / RATE / release
    for i in range(len(p.q)):
        still = np.abs(p.w[i]) < 0.04
        stuck = np.where(still, 1 - (1 - stuck) * bond, stuck * (1 - np.minimum(travel[i], 1)))
        out[i] = stuck
    return Change(drag=p.unit.uniform(10.0, 18.0) * out * _sign(p.w))


def _warm_up(p: Plant) -> Change:
    seconds = p.unit.uniform(25.0, 60.0)
    return Change(watts=p.unit.uniform(4.0, 8.0, 3) * np.exp(-p.time / seconds)[:, None])


def _switched_on(p: Plant) -> Change:
    at = p.run.uniform(0.3, 0.7) * p.time[-1]
    return Change(watts=p.unit.uniform(2.0, 5.0, 3) * (p.time > at)[:, None])


def _resonance(p: Plant) -> Change:
    middle, width = p.unit.uniform(1.2, 2.2), p.unit.uniform(0.3, 0.5)
    bump = 1 / (1 + ((np.abs(p.w) - middle) / width) ** 2)
    return Change(watts=p.unit.uniform(6.0, 12.0) * bump**1.5)


def _belt(p: Plant) -> Change:
    limit = p.unit.uniform(15.0, 25.0)
    return Change(watts=0.25 * p.unit.uniform(0.7, 1.4) * _soft((np.abs(p.a) - limit) / 4.0) * 4.0)


def _neighbour_heats(p: Plant) -> Change:
    speed = np.abs(np.roll(p.w, 1, axis=1))
    return Change(watts=p.unit.uniform(1.5, 3.0) * speed**1.3 / (1 + 0.05 * speed))


HIDDEN = {
    'window of position': Hidden(frozenset({'position'}), _place),
    'gear eccentricity': Hidden(frozenset({'position'}), _eccentric),
    'backlash': Hidden(frozenset({'position', 'speed'}), _backlash),
    'cable': Hidden(frozenset({'position'}), _cable, ('walk',)),
    'seal': Hidden(frozenset({'temperature'}), _seal),
    'chopper': Hidden(frozenset({'voltage'}), _chopper),
    'cross-talk': Hidden(frozenset({'other_drive'}), _cross_talk),
    'torque saturation': Hidden(frozenset({'torque'}), _saturation),
    'dead time': Hidden(frozenset({'torque'}), _dead_time),
    'resonance': Hidden(frozenset({'speed'}), _resonance),
    'belt': Hidden(frozenset({'acceleration'}), _belt, ('walk',)),
    'neighbour': Hidden(frozenset({'other_drive'}), _neighbour_heats),
    'brake after holding': Hidden(frozenset({'speed'}), _after_holding, ('ladder',)),
    'fan': Hidden(frozenset({'time'}), _fan),
    'warming up': Hidden(frozenset({'time'}), _warm_up),
    'switched on': Hidden(frozenset({'time'}), _switched_on),
}


def recorded(
    hidden: str,
    motion: str,
    *,
    seed: int,
    unit: int,
    seconds: float = 150.0,
    faults: Faults | None = None,
) -> AlignedDataset:
    """Simulate one recording of a unit; hidden: a key of HIDDEN, or ''; motion: walk, ladder."""
    run = np.random.default_rng([seed, 7])
    steps = int(seconds * RATE)
    q, w, tau = (_walk if motion == 'walk' else _ladder)(run, steps)
    a = np.gradient(w, 1 / RATE, axis=0)
    of_unit = np.random.default_rng([unit, 11])
    scale = np.exp(of_unit.normal(0, 0.08, (6, 3)))
    constant = 5.0 * np.exp(of_unit.normal(0, 0.02, 3))
    drag = 2.0 * scale[0] * _sign(w) * (1 + 0.06 * _sign(w))
    drag = drag + 3.0 * scale[1] * np.sign(w) * np.abs(w) ** 0.94 + 0.07 * scale[2] * a
    time = np.arange(steps) / RATE
    own = np.random.default_rng([seed, 13])
    ripple = _smooth(own.standard_normal((steps, 1)), 1.5)
    supply = 48.0 + 0.25 * ripple / ripple.std() + 0.3 * np.sin(2 * np.pi * time / 37.0)[:, None]
    idle = 8.5 * scale[4] * (0.8 + 0.2 * supply / 48)

    def power(change: Change) -> tuple[Floats, Floats]:
        motor = tau + drag + change.drag
        weak = constant / (1 + 0.03 * (motor / 80) ** 2) / change.current
        current = motor / weak
        heat = 0.45 * scale[3] * current**2
        return weak * w * current + heat + idle + change.watts, heat

    usual, heat = power(Change())
    winding = 25.0 + own.uniform(0, 5) + _first_order(heat * 4.0 + 3.0, 70.0)
    change = Change()
    if hidden:
        draw = np.random.default_rng([unit, 17])
        plant = Plant(time, q, w, a, tau, supply, winding, usual, draw, own)
        change = HIDDEN[hidden].change(plant)
    watts, _ = power(change)
    truth = Truth({}, motion, seconds, seed, unit, faults or Faults())
    volts = np.broadcast_to(supply, q.shape)
    data = _measure(truth, run, q, w, tau, watts, volts)
    picked = winding[:: int(RATE / 400)][: len(data.time)] + run.normal(0, 0.3, data.torque.shape)
    return replace(data, temperature=picked.astype(np.float32))
