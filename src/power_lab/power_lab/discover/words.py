"""Names, physics as hypotheses, look-alikes and excitation of discovered effects."""

import itertools
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from power_lab.discover.formula import Formula

_NAMES = {
    ('position', 'sign', 'torque'): 'position_rub',
    ('position', 'velocity', 'torque'): 'position_drag',
    ('position', 'load_sign', 'torque'): 'position_load_friction',
    ('position', 'one', 'torque'): 'position_pull',
    ('position', 'one', 'power'): 'position_loss',
    ('speed', 'one', 'torque'): 'speed_friction',
    ('speed', 'sign', 'torque'): 'speed_friction',
    ('speed', 'one', 'power'): 'speed_loss',
    ('torque', 'one', 'power'): 'torque_loss',
    ('torque', 'sign', 'torque'): 'torque_friction',
    ('torque', 'velocity', 'power'): 'torque_gain',
    ('torque', 'torque_square', 'power'): 'torque_saturation',
    ('acceleration', 'one', 'torque'): 'acceleration_torque',
    ('acceleration', 'one', 'power'): 'acceleration_loss',
    ('play', 'one', 'torque'): 'reversal_torque',
    ('play', 'sign', 'torque'): 'reversal_friction',
    ('rest', 'sign', 'torque'): 'drag_after_rest',
    ('rest', 'one', 'power'): 'loss_after_rest',
}
_NEAR = {
    'position': ('coulomb_friction', 'cogging'),
    'speed': ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'iron_loss'),
    'torque': ('copper_loss', 'inverter_loss', 'load_friction'),
    'acceleration': ('rotor_inertia', 'time_offset'),
    'voltage': ('line_resistance', 'regeneration_limit'),
    'temperature': ('winding_heating', 'viscous_friction', 'coulomb_friction'),
    'other_drive': ('line_resistance', 'regeneration_limit'),
}


def effect_name(formula: Formula, taken: Collection[str]) -> str:
    """Name an effect by what it depends on; a number makes it differ from those taken."""
    family = formula.family
    driver = 'position' if family.driver.name == 'angle' else family.driver.name
    driver = driver.removesuffix('_size')
    key = (driver, family.factor.name, family.acts_on)
    name = _NAMES.get(key)
    if name is None and family.kind == 'other_drive':
        name = 'cross_talk'
    if name is None:
        name = f'{family.kind}_{"friction" if family.acts_on == "torque" else "loss"}'
    if formula.primitive.terms > 1 and name == 'position_pull':
        name = 'position_ripple'
    return free_name(name, taken)


def free_name(name: str, taken: Collection[str]) -> str:
    """A name that is not taken: itself, or else `name_2` and so on."""
    numbered = (f'{name}_{number}' for number in itertools.count(2))
    return next(one for one in itertools.chain([name], numbered) if one not in taken)


def look_alikes(formula: Formula) -> tuple[str, ...]:
    """Names of catalogue effects that the formula resembles."""
    return _NEAR.get(formula.kind, ())


def in_short(
    formula: Formula, coefficients: Mapping[int, Sequence[float]], drives: Sequence[str]
) -> str:
    """Hypothesis in one sentence, with the numbers of the drive where the formula gains most."""
    drive = max(formula.places, key=lambda d: formula.places[d].gain)
    place = formula.places[drive]
    strength = float(np.linalg.norm(coefficients[drive]))
    unit = 'N·m' if formula.family.acts_on == 'torque' else 'W'
    size = f'{strength:.3g}' + ('' if formula.unit == '1' else f' {formula.unit}')
    where = _where(formula, drive)
    name = formula.family.driver.name
    verb = {
        'sign': 'rubs',
        'velocity': 'drags in proportion to the speed',
        'load_sign': 'rubs in proportion to the load',
    }.get(formula.family.factor.name, 'costs' if unit == 'W' else 'pulls')
    if formula.family.driver.other:
        text = f'takes a part of what {place.family.driver.other} does: {size}'
    elif name == 'play':
        width = f'{place.family.driver.given[0]:.2g} rad'
        text = f'{verb} {where}, while a play of {width} turns round: {size}'
    elif name == 'rest':
        seconds, travel = place.family.driver.given
        over = f'{seconds:.2g} s' if seconds else f'{travel:.2g} rad'
        text = f'{verb} after it stood, fading over {over}: {size}'
    else:
        text = f'{verb} {where}: {size}'
    is_friction = formula.unit == 'N·m' and formula.family.factor.name == 'sign'
    watts = f' ({strength:.3g} W per rad/s)' if is_friction else ''
    return f'hypothesis: {drives[drive]} {text}{watts}'


def _where(formula: Formula, drive: int) -> str:
    place = formula.places[drive]
    unit = place.family.driver.unit
    symbol = place.family.driver.symbol
    given = {name: f'{value:.3g}' for name, value in place.parameters.items()}
    match formula.primitive.name:
        case 'window':
            return f'between {given["low"]} and {given["high"]} {unit} of {place.family.kind}'
        case 'turn_window':
            return f'within {given["half"]} rad of {given["middle"]} rad in the turn'
        case 'step' | 'above' | 'above_square':
            limit = given.get('at', given.get('limit', ''))
            return f'above {limit} {unit} of {place.family.kind}'
        case 'below':
            return f'below {given["limit"]} {unit} of {place.family.kind}'
        case 'wave':
            order = place.parameters['order']
            if unit == 'rad':
                return f'{order:.3g} times per turn'
            return f'with a period of {2.0 * np.pi / order:.3g} {unit} of {place.family.kind}'
        case _:
            return f'as {formula.primitive.text.format(z=symbol, **given)}'


def excitation(formula: Formula) -> dict[str, object]:
    """Return arguments of an Excitation that would confirm the effect."""
    drive = max(formula.places, key=lambda d: formula.places[d].gain)
    given = {name: float(f'{v:.3g}') for name, v in formula.places[drive].parameters.items()}
    match formula.kind:
        case 'position':
            past = ' and '.join(f'{value:g}' for value in given.values())
            text = 'slow sweeps over the whole range in both directions'
            text += f', past {past} rad' if past else ''
            return {'text': text, 'speeds': (0.2, -0.2, 1.0, -1.0), 'seconds': 10.0}
        case 'speed':
            speeds = (0.2, 0.5, 1.0, 2.0, 4.0)
            both = tuple(sign * speed for speed in speeds for sign in (1.0, -1.0))
            return {'text': 'a ladder of speeds with rests between them', 'speeds': both}
        case 'torque':
            return {
                'text': 'static loads at standstill and at one speed',
                'speeds': (0.0, 1.0, -1.0),
                'loads': (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0),
            }
        case 'acceleration':
            return {
                'text': 'unloaded fast reversals',
                'mode': 'position',
                'frequency': 4.0,
                'amplitude': 0.3,
                'seconds': 20.0,
            }
        case 'voltage':
            return {
                'text': 'the same motion at two or three bus voltages',
                'speeds': (1.0, -1.0, 3.0, -3.0),
                'supply': (44.0, 48.0, 52.0),
            }
        case 'temperature':
            return {
                'text': 'one speed from cold until warm, then cooling',
                'speeds': (1.0, -1.0),
                'seconds': 600.0,
            }
        case _:
            return {'text': 'this drive at rest while the others move, then the others at rest'}
