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
    parts = [
        '"""Effects found by `power_lab discover`: hypotheses, to be confirmed by experiment."""',
        '',
        'import numpy as np',
        'from numpy.typing import NDArray',
        'from power_estimator.effects import Effect, Excitation, Term, smooth_sign',
        '',
        'Floats = NDArray[np.float64]',
        f'LEARNED_FROM = {tuple(source)!r}',
        '',
        '',
        '\n\n'.join(helpers),
        '',
        '\n\n'.join(_class(one) for one in effects),
    ]
    text = '\n'.join(parts)
    ast.parse(text)
    return text


_IGNORE = '  # type: ignore[no-untyped-def]'


def _class(one: Written) -> str:
    formula, family = one.formula, one.formula.family
    unit = {'torque': 'N·m on the motor', 'power': 'W at the input'}[family.acts_on]
    symbols = ['A·cos(phase)', 'A·sin(phase)'] if formula.primitive.terms > 1 else ['c']
    terms = '\n'.join(
        f'        Term({symbol!r}, {formula.unit!r}, {low!r}, {high!r}),'
        for symbol, (low, high) in zip(symbols, one.bounds, strict=True)
    )
    places = '\n'.join(f'    {name!r}: {dict(given)!r},' for name, given in one.places.items())
    table = f'{one.name.upper()}_PLACES'
    memory_lines = '            rate = signals.rate', "            given = place['given']"
    arguments = ''.join(f", place['{name}']" for name in formula.primitive.parameters)
    class_name = ''.join(part.capitalize() for part in one.name.split('_'))
    lines = [
        f'{table} = {{',
        places,
        '}',
        '"""Parameters by drive, SI units; drives that are not here do not have the effect."""',
        '',
        '',
        f'class {class_name}(Effect):',
        '    """A hypothesis: see physics."""',
        '',
        f'    name = {one.name!r}',
        f'    physics = {one.physics!r}',
        f'    formula = {formula.text()!r}',
        '    terms = (',
        terms,
        '    )',
        f'    acts_on = {family.acts_on!r}',
    ]
    if not family.driver.other:
        lines.append('    per_drive = True')
    if family.driver.memory:
        lines.append('    remembers = True')
    if family.acts_on == 'torque':
        lines.append('    needs_joint_torque = True')
    if 'drawn' in family.driver.code:
        lines.append("    follows = frozenset({'drawn'})")
    lines += [
        f'    near = {tuple(one.near)!r}',
        '    excitation = Excitation('
        + ', '.join(f'{k}={v!r}' if k != 'text' else repr(v) for k, v in one.excitation.items())
        + ')',
        '',
        '    def factors(self, scale):',
        '        """1: the bounds are those of the drives above, not of a reference drive."""',
        '        return np.ones((len(scale.torque), len(self.terms)))',
        '',
        '    def regressors(self, signals, **shape):',
        f'        """Return {unit} per unit coefficient."""',
        f'        found = np.zeros((*signals.torque.shape, {formula.primitive.terms}))',
        '        for column, drive in enumerate(signals.names):',
        f'            place = {table}.get(drive)',
        *_guard(one),
        '            standstill = float(signals.scale.standstill[column])',
        '            velocity = signals.motor_velocity[:, column]',
        '            torque = signals.torque[:, column]',
        *(memory_lines if family.driver.memory else ()),
        f'            z = {family.driver.code}',
        f'            value = {formula.primitive.of.__name__}(z{arguments})',
    ]
    factor = family.factor.code or '1.0'
    if formula.primitive.terms > 1:
        lines.append(f'            found[:, column] = value * np.asarray({factor})[..., None]')
    else:
        lines.append(f'            found[:, column, 0] = value * ({factor})')
    lines += ['        return found', '']
    text = '\n'.join(lines)
    return _without_unused(text)


def _guard(one: Written) -> list[str]:
    if one.formula.family.driver.other:
        return [
            "            if place is None or place['other'] not in signals.names:",
            '                continue',
            "            other = signals.names.index(place['other'])",
        ]
    return ['            if place is None:', '                continue']


def _without_unused(text: str) -> str:
    """Leave out the lines that set what the formula does not use."""
    kept = text.split('\n')
    for name in ('torque', 'velocity', 'standstill'):
        uses = [line for line in kept if f'            {name} = ' not in line]
        body = '\n'.join(uses[uses.index(next(x for x in uses if 'enumerate' in x)) :])
        nodes = ast.walk(ast.parse('def f():\n' + body))
        names = {node.id for node in nodes if isinstance(node, ast.Name)}
        if name not in names:
            kept = uses
    return '\n'.join(kept)
