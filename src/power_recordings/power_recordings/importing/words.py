"""Words in the name of a column, and what they say of it."""

import json
import re
from pathlib import Path
from typing import Final, Literal

from wattwalk_core.yaml_file import read_yaml

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
WANTED: Final = (
    r'(cmd|command|target|set_?point|desired|demand|soll|(^|_)(ref|des|set|goal|so|sp)(_|$))'
)
"""Words of what is commanded, and not measured."""
_SPELLINGS: Final = read_yaml(Path(__file__).with_name('spellings.yaml'), 'spellings')


def spellings(kind: str) -> dict[str, str]:
    """Return what is meant by each spelling of a kind in `spellings.yaml`, such as `units`."""
    return {spelling: meant for meant, own in _SPELLINGS[kind].items() for spelling in own}


_OTHER_LANGUAGES: Final = spellings('words')
_FOREIGN: Final = re.compile('|'.join(_OTHER_LANGUAGES))
_AXIS: Final = re.compile(r'(^|_)[iuv]?([qd])(_|$)')


def words(address: str) -> str:
    """Return an address as lower-case words joined by `_`, without bracketed unit and digits."""
    name = re.sub(r'\s*[\[(][^\[\]()]*[\])]$', '', address) if address[:1] not in '[(' else address
    name = name.rpartition(':')[2]
    name = re.sub(r'^([UVIM](?=[A-C])|[UI](?=[X-Z]))(?=.(_|$))', r'\1_', name)
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


def yaml_text(text: str) -> str:
    """Return a text as a YAML scalar, quoted if needed."""
    if not text.isprintable():
        return json.dumps(text)
    if re.fullmatch(r'[A-Za-z_/][\w/.:\-]*', text) and not text.endswith(':'):
        return text if ': ' not in text else f"'{text}'"
    return "'" + text.replace("'", "''") + "'"
