"""`ros2 run power_daq record`: record the suite's topics to a bag with a card."""

import argparse
import datetime
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

from power_recordings.card import Card
from power_recordings.messages.cdr import full_name
from power_recordings.messages.topics import TYPES, message_class
from power_recordings.writing.background import BackgroundRecorder
from power_recordings.writing.metadata import CardFile
from power_recordings.writing.writer import BagWriter, make_way
from wattwalk_core.errors import InputError
from wattwalk_core.files import check_room
from wattwalk_core.nodes.running import run_node

from power_daq.nodes.recorder import RecorderNode


def run(options: argparse.Namespace) -> int:
    """Record until Ctrl-C or the end of the duration; 2 for bad input or a full disk."""
    card = card_of(options.card)
    topics = topics_of(options.topics)
    make_way(options.output, overwrite=None)
    for type_name in topics.values():
        message_class(type_name)

    def make() -> Any:
        check_room(options.output)
        bag = BagWriter(options.output, flush_period=10.0)
        card_file = CardFile(card, options.output)
        recorder = BackgroundRecorder(bag)
        try:
            counted = (options.duration, options.wait)
            node = RecorderNode(recorder, topics, card_file, options.output, *counted)
        except BaseException:
            recorder.close()
            raise
        print(f'recording to {options.output}; Ctrl-C ends it', flush=True)
        return node

    return run_node(make, options.ros_args)


def topics_of(given: Sequence[str] | None) -> dict[str, str]:
    """Return types by topic, of the suite's names or `name:package/Type`; else InputError."""
    chosen: dict[str, str] = {}
    for text in given or TYPES:
        name, _, type_name = text.partition(':')
        known = full_name(type_name) if type_name else TYPES.get(name.rsplit('/', 1)[-1])
        if known is None:
            raise InputError(
                f'unknown topic {name!r}: give its type as in {name}:std_msgs/String, '
                f'or one of {", ".join(TYPES)}'
            )
        chosen[name] = known
    return chosen


def card_of(given: Sequence[str]) -> Card:
    """Return a card from `key=value`, drives separated by commas; else InputError."""
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
