"""What the user of the recorder gave, in words, turned into what it needs."""

import datetime
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Any

from power_recordings.card import Card
from power_recordings.messages.cdr import full_name
from power_recordings.messages.topics import TYPES
from wattwalk_core.errors import InputError


def message_class(type_name: str) -> Any:
    """The class of a message type; InputError if its package is not there."""
    package, _, name = full_name(type_name).split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f'cannot record {type_name}: {error}; is {package} sourced?') from error


def topics_of(given: Sequence[str] | None) -> dict[str, str]:
    """Topics and their types from names, or `name:package/Type` for topics unknown here."""
    chosen: dict[str, str] = {}
    for text in given or TYPES:
        name, _, type_name = text.partition(':')
        type_name = type_name or TYPES.get(name.rsplit('/', 1)[-1], '')
        if not type_name:
            raise InputError(
                f'unknown topic {name!r}: give its type as in {name}:std_msgs/String, '
                f'or one of {", ".join(TYPES)}'
            )
        chosen[name] = full_name(type_name)
    return chosen


def card_of(given: Sequence[str]) -> Card:
    """A card from `key=value`; drives are separated by commas. InputError for anything else."""
    content: dict[str, Any] = {}
    for text in given:
        key, equals, value = text.partition('=')
        if not equals or not key:
            raise InputError(f'--card {text!r}: expected key=value')
        content[key] = value
    if 'drives' in content:
        content['drives'] = [name.strip() for name in content['drives'].split(',')]
    if str(content.get('seed', '')).lstrip('-').isdigit():
        content['seed'] = int(content['seed'])
    if content.get('complete') in ('true', 'false'):
        content['complete'] = content['complete'] == 'true'
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec='seconds')
    defaults = {'created': now, 'software': f'power_daq {version("power_daq")}'}
    return Card.of({**defaults, **content})
