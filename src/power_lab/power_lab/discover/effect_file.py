"""Files of discovered effects: plain Python from a template, every name quoted."""

import ast
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from power_lab.discover.formula import Formula
from power_lab.structure import memory

_HELPERS = ('lagged', 'after_rest', 'play', 'by_stretch')


@dataclass(frozen=True)
class Written:
    """Content of an effect file about one effect."""

    name: str
    formula: Formula
    physics: str
    bounds: Sequence[tuple[float, float]]  # of each coefficient, of these drives
    near: Sequence[str]
    excitation: Mapping[str, object]
    places: Mapping[str, Mapping[str, object]]  # by drive


def effect_source(effects: Sequence[Written], source: Sequence[str]) -> str:
    """Return the Python text of an effect file; source: names of the recordings learned from."""
    used = dict.fromkeys(one.formula.primitive for one in effects)
    helpers = [inspect.getsource(primitive.of) for primitive in used]
    drivers = [place.family.driver for one in effects for place in one.formula.places.values()]
    helpers += [
        inspect.getsource(getattr(memory, name)).replace(_IGNORE, '')
        for name in _HELPERS
        if any(name in driver.code for driver in drivers)
    ]
    helper_lines = '\n\n'.join(helpers)
    classes = '\n\n'.join(_class(one) for one in effects)
    text = f'''\
"""Effects found by `power_lab discover`: hypotheses, to be confirmed by experiment."""

import numpy as np
from numpy.typing import NDArray
from power_estimator.effects import Effect, Excitation, Term, smooth_sign

Floats = NDArray[np.float64]
LEARNED_FROM = {tuple(source)!r}


{helper_lines}

{classes}'''
    ast.parse(text)
    return text


_STATE = {
    'other': "signals.names.index(place['other'])",
    'standstill': 'float(signals.scale.standstill[column])',
    'velocity': 'signals.motor_velocity[:, column]',
    'torque': 'signals.torque[:, column]',
    'rate': 'signals.rate',
    'given': "place['given']",
}
"""Values that drivers and factors may read, by name."""
_IGNORE = '  # type: ignore[no-untyped-def]'


def _class(one: Written) -> str:
    formula, family, driver = one.formula, one.formula.family, one.formula.family.driver
    primitive, terms = formula.primitive, formula.primitive.terms
    unit = {'torque': 'N·m on the motor', 'power': 'W at the input'}[family.acts_on]
    symbols = ['A·cos(phase)', 'A·sin(phase)'] if terms > 1 else ['c']
    term_lines = '\n'.join(
        f'        Term({symbol!r}, {formula.unit!r}, {low!r}, {high!r}),'
        for symbol, (low, high) in zip(symbols, one.bounds, strict=True)
    )
    places = '\n'.join(f'    {name!r}: {dict(given)!r},' for name, given in one.places.items())
    table = f'{one.name.upper()}_PLACES'
    class_name = ''.join(part.capitalize() for part in one.name.split('_'))
    flags = {
        'per_drive = True': not driver.other,
        'remembers = True': driver.memory,
        'needs_joint_torque = True': family.acts_on == 'torque',
        "follows = frozenset({'drawn'})": 'drawn' in driver.code,
    }
    flag_lines = ''.join(f'    {line}\n' for line, holds in flags.items() if holds)
    excited = ', '.join(f'{k}={v!r}' for k, v in one.excitation.items()).removeprefix('text=')
    guard = " or place['other'] not in signals.names" if driver.other else ''
    arguments = ''.join(f", place['{name}']" for name in primitive.parameters)
    factor = family.factor.code
    nodes = ast.walk(ast.parse(f'{driver.code}, {factor}'))
    used = {node.id for node in nodes if isinstance(node, ast.Name)}
    state_lines = ''.join(
        f'            {name} = {code}\n' for name, code in _STATE.items() if name in used
    )
    product = f'[:, column, 0] = value * ({factor})'
    if terms > 1:
        product = f'[:, column] = value * np.asarray({factor})[..., None]'
    return f'''{table} = {{
{places}
}}
"""Parameters by drive, SI units; drives that are not here do not have the effect."""


class {class_name}(Effect):
    """A hypothesis: see physics."""

    name = {one.name!r}
    physics = {one.physics!r}
    formula = {formula.text()!r}
    terms = (
{term_lines}
    )
    acts_on = {family.acts_on!r}
{flag_lines}    near = {tuple(one.near)!r}
    excitation = Excitation({excited})

    def factors(self, scale):
        """1: the bounds are those of the drives above, not of a reference drive."""
        return np.ones((len(scale.torque), len(self.terms)))

    def regressors(self, signals, **shape):
        """Return {unit} per unit coefficient."""
        found = np.zeros((*signals.torque.shape, {terms}))
        for column, drive in enumerate(signals.names):
            place = {table}.get(drive)
            if place is None{guard}:
                continue
{state_lines}            z = {driver.code}
            value = {primitive.of.__name__}(z{arguments})
            found{product}
        return found
'''
