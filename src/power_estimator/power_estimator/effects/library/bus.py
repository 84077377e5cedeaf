"""Power on the supply line: electronics, cables, and what braking drives return."""

from functools import partial

import numpy as np
from wattwalk_core.arrays import Floats

from power_estimator.effects.effect import Effect, Excitation, Term
from power_estimator.effects.signals.scale import VOLTAGE
from power_estimator.effects.signals.state import Signals


def _drawn_current(signals: Signals, **_: float) -> Floats:
    """Current at the drive's input squared."""
    return np.square(signals.drawn / np.maximum(signals.voltage, 1.0))[..., None]


def _flow(signals: Signals, bridge: float = 0.0) -> Floats:
    return signals.drawn - bridge * signals.electronics


def returned_shares(signals: Signals) -> tuple[Floats, Floats, Floats]:
    """Return, in W, what each drive returns [T, D], the sum of that, and what is blocked [T, 1].

    Both of these count the other drives of the bus. Blocked is the net power that flows back.
    """
    returned = np.maximum(0.0, -signals.drawn)
    total = returned.sum(axis=1, keepdims=True)
    drawn = signals.drawn.sum(axis=1, keepdims=True)
    if signals.others is not None:
        total, drawn = total + signals.others.returned, drawn + signals.others.drawn
    return returned, np.maximum(total, 1e-9), np.maximum(0.0, -drawn)


def _returned(signals: Signals, *, bridge: float = 0.0, supply: float = 0.0, **_: float) -> Floats:
    """Power that would flow back: through the bridge, into the drive's input, or to the supply.

    What the supply blocks is shared out by what each drive returns.
    """
    if supply:
        returned, total, blocked = returned_shares(signals)
        return (returned / total * blocked)[..., None]
    return np.maximum(0.0, -_flow(signals, bridge))[..., None]


def _lost_share(
    signals: Signals, coefficients: Floats, *, bridge: float = 0.0, supply: float = 0.0, **_: float
) -> Floats:
    """Minus the lost or blocked share while power flows back."""
    if supply:
        _own, total, blocked = returned_shares(signals)
        return np.where(signals.drawn < 0.0, -coefficients[..., 0] * (blocked / total), 0.0)
    return np.where(_flow(signals, bridge) < 0.0, -coefficients[..., 0], 0.0)


def _shown_there(signals: Signals, *, supply: float = 0.0, **_: float) -> bool:
    """Return whether a meter shows the shape: that of several drives what the supply loses."""
    return not supply or (signals.one_meter and signals.torque.shape[1] > 1)


def _metered_there(signals: Signals, *, supply: float = 1.0, **_: float) -> bool:
    """Return whether there may be diodes in front of each drive: of several, with meters."""
    return bool(supply) or (not signals.one_meter and signals.torque.shape[1] > 1)


IDLE = Effect(
    name='idle',
    physics='electronics draw power whether the drive moves or not',
    formula='P0',
    terms=(Term('P0', 'W', 0.0, 500.0),),
    scaling={'idle': (1.0,)},
    regressors=lambda signals, **_: np.ones_like(signals.torque)[..., None],
    # Electronics that draw a constant current rather than a constant power.
    discrepancy=lambda signals, **_: signals.voltage / VOLTAGE - 1.0,
    discrepancy_limit=1.0,
    per_drive=True,
    near=('current_offset',),
    excitation=Excitation(
        'rest without load, at two bus voltages',
        mode='torque',
        speeds=(0.0,),
        seconds=20.0,
        supply=(44.0, 52.0),
    ),
)
LINE_RESISTANCE = Effect(
    name='line_resistance',
    physics='the current drawn heats the cable between the meter and the drive',
    formula='Rl·(P/V)²',
    terms=(Term('Rl', 'ohm', 0.0, 5.0),),
    scaling={},
    regressors=_drawn_current,
    drawn_slope=lambda signals, rl, **_: 2.0 * rl[..., 0] * signals.drawn / signals.voltage**2,
    follows=frozenset({'drawn'}),
    per_drive=True,
    near=('copper_loss',),
    excitation=Excitation(
        'high power at high speed, and the same current at standstill, at two bus voltages',
        speeds=(0.0, 4.0, -4.0),
        loads=(-40.0, 40.0),
        supply=(44.0, 52.0),
    ),
)
REGENERATION_EFFICIENCY = Effect(
    name='regeneration_efficiency',
    physics='of the power that braking drives return only the part eta arrives at the bus',
    formula='(1 − eta)·max(0, −P); bridge = 1: without electronics; supply = 1: of all drives',
    terms=(Term('1 − eta', '1', 0.0, 1.0, attained=True),),
    scaling={},
    regressors=_returned,
    drawn_slope=_lost_share,
    follows=frozenset({'drawn'}),
    per_drive=True,
    shapes=(
        {'bridge': 0.0, 'supply': 0.0},
        {'bridge': 1.0, 'supply': 0.0},
        {'bridge': 0.0, 'supply': 1.0},
    ),
    together_by='supply',
    recorded=_shown_there,
    near=('regeneration_limit', 'load_friction'),
    excitation=Excitation(
        'back-driving at three loads and two speeds while other drives draw',
        alone='back-driving at three loads and two speeds',
        speeds=(2.0, 4.0, -2.0, -4.0),
        loads=(-30.0, -15.0, 15.0, 30.0),
    ),
)
REGENERATION_LIMIT = Effect(
    name='regeneration_limit',
    physics='the supply takes nothing back: what all drives return together, or each, is burnt',
    formula='b·(share of the drive)·max(0, −sum of P over the bus); supply = 0: b·max(0, −P)',
    terms=(Term('b', '1', 0.0, 1.0, attained=True),),
    scaling={},
    regressors=partial(_returned, supply=1.0),
    drawn_slope=partial(_lost_share, supply=1.0),
    follows=frozenset({'drawn'}),
    per_drive=True,
    shapes=({'supply': 1.0}, {'supply': 0.0}),  # diodes in the supply, or in front of each drive
    together_by='supply',
    recorded=_metered_there,
    near=('regeneration_efficiency',),
    excitation=Excitation(
        'back-driving one drive with the others at rest, then with the others drawing',
        alone='back-driving under load in both directions',
        speeds=(3.0, -3.0),
        loads=(-30.0, 30.0),
    ),
)
