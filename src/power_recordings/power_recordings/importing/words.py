"""Words in the name of a column, and what they say of it."""

import re
from typing import Final, Literal

Kind = Literal['current', 'voltage', 'duty', 'energy', '']
Axis = Literal['q', 'd', '']

_KINDS: Final[tuple[tuple[Kind, str], ...]] = (
    ('energy', r'watt_hours|(^|_)(k?wh|energy|joules?)(_|$)'),
    ('', r'amp_hours|(^|_)ah(_|$)'),
    ('duty', r'duty|modulation'),
    ('voltage', r'volt|(^|_)[vu][qd]?(_|$)'),
    ('current', r'curr|(^|_)amps?(_|$)|(^|_)i([qd]|bus)?(_|$)'),
)
_OF_UNIT: Final[dict[str, Kind]] = {
    **dict.fromkeys(('A', 'mA'), 'current'),
    **dict.fromkeys(('V', 'mV'), 'voltage'),
}
_OTHER_LANGUAGES: Final = {
    **dict.fromkeys(('drehmoment', '扭矩', '转矩', '力矩'), 'torque'),
    **dict.fromkeys(('drehzahl', '转速', '速度'), 'speed'),
    **dict.fromkeys(('spannung', '电压'), 'voltage'),
    **dict.fromkeys(('strom', '电流'), 'current'),
    **dict.fromkeys(('leistung', '功率'), 'power'),
    **dict.fromkeys(('wirkungsgrad', '效率'), 'efficiency'),
    **dict.fromkeys(('zeitstempel', '时间戳'), 'timestamp'),
    **dict.fromkeys(('datum', '日期'), 'date'),
    **dict.fromkeys(('zeit', '时间'), 'time'),
    **dict.fromkeys(('temperatur', '温度'), 'temp'),
    **dict.fromkeys(('winkel', '角度', '位置'), 'angle'),
    **dict.fromkeys(('电机', '马达'), 'motor'),
    **dict.fromkeys(('输入', '母线'), 'input'),
    **dict.fromkeys(('目标', '给定', '设定'), 'target'),
}
"""Words of German and Chinese benches, whose instruments name columns so."""
_FOREIGN: Final = re.compile('|'.join(_OTHER_LANGUAGES))
_AXIS: Final = re.compile(r'(^|_)[iuv]?([qd])(_|$)')


def words(address: str) -> str:
    """Return an address as lower-case words joined by `_`, without bracketed unit and digits."""
    name = re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', address) if address[:1] not in '[(' else address
    name = name.rpartition(':')[2]
    name = 'power' if name == 'P' else re.sub(r'([A-Z])([A-Z][a-z]{2})', r'\1_\2', name)
    name = re.sub(r'([a-z])([A-Z])', r'\1_\2', name).lower()
    name = _FOREIGN.sub(lambda found: f'_{_OTHER_LANGUAGES[found[0]]}_', name)
    name = re.sub(r'[^a-z]+', '_', name).strip('_')
    return re.sub(r'^(motor_data|data|log|feedback)_', '', name)


def kind_of(address: str, unit: str = '') -> Kind:
    """Return the electrical kind of a column by its name, else its unit; '' if none."""
    name = words(address)
    return next((kind for kind, rule in _KINDS if re.search(rule, name)), _OF_UNIT.get(unit, ''))


def is_motor_current(address: str) -> bool:
    """Return whether a current is that of a motor by its name, and not that of its supply."""
    return axis_of(address) == 'q' or bool(re.search(r'motor|winding|phase', words(address)))


def axis_of(address: str) -> Axis:
    """Return the axis of a motor's rotating frame in a column's name: q, d or '' if none."""
    found = _AXIS.search(words(address))
    return found[2] if found else ''  # type: ignore[return-value]
