"""The metadata.yaml of a rosbag2 bag, version 9, as ROS 2 Jazzy writes it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from wattwalk_core.errors import InputError

from power_recordings.card import Card

VERSION = 9
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}
_RELIABILITIES = ('reliable', 'best_effort')


@dataclass
class TopicSummary:
    """One topic of a bag, and its number of messages.

    reliability: that its publishers offered, for `ros2 bag play` to offer the same.
    """

    name: str
    type_name: str
    type_hash: str
    reliability: str = 'reliable'
    count: int = 0

    def __post_init__(self) -> None:
        if self.reliability not in _RELIABILITIES:
            raise InputError(
                f'QoS reliability is {self.reliability!r}; it is one of '
                f'{", ".join(_RELIABILITIES)}'
            )

    def profile(self) -> dict[str, Any]:
        """Return the QoS profile as a mapping with rosbag2's keys."""
        return {
            'history': 'keep_last',
            'depth': 1000,
            'reliability': self.reliability,
            'durability': 'volatile',
            'deadline': _FOREVER,
            'lifespan': _FOREVER,
            'liveliness': 'automatic',
            'liveliness_lease_duration': _FOREVER,
            'avoid_ros_namespace_conventions': False,
        }


def information(
    file_name: str, topics: Sequence[TopicSummary], start_ns: int, end_ns: int
) -> dict[str, Any]:
    """Return the content of `rosbag2_bagfile_information` for a bag of one MCAP file."""
    duration = {'nanoseconds': end_ns - start_ns}
    start = {'nanoseconds_since_epoch': start_ns}
    count = sum(topic.count for topic in topics)
    return {
        'version': VERSION,
        'storage_identifier': 'mcap',
        'duration': duration,
        'starting_time': start,
        'message_count': count,
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': topic.name,
                    'type': topic.type_name,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': [topic.profile()],
                    'type_description_hash': topic.type_hash,
                },
                'message_count': topic.count,
            }
            for topic in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file_name],
        'files': [
            {
                'path': file_name,
                'starting_time': start,
                'duration': duration,
                'message_count': count,
            }
        ],
        'custom_data': None,
        'ros_distro': 'jazzy',
    }


class CardFile:
    """`card.yaml` in the folder of a recording, rewritten with each fact that is added.

    given: the user's entries, which take precedence over those of sources. Methods raise
    RecordingError if the file cannot be written.
    """

    def __init__(self, given: Card, folder: Path) -> None:
        self._given, self._folder = given, folder
        self._sources: list[Card] = []
        self._drives: tuple[str, ...] = ()
        self._saved = given
        given.save(folder)

    def add_source(self, source: Card) -> None:
        """Add a source's facts on its drives: torque, velocity and calibration."""
        if source not in self._sources:
            self._sources.append(source)
            self._save()

    def add_mark(self, stamp_ns: int, text: str) -> None:
        """Add a note taken at ROS time stamp_ns [ns]."""
        self._given = self._given.with_mark(stamp_ns, text)
        self._save()

    def add_drives(self, measured: Sequence[str]) -> None:
        """Set the names of the measured drives."""
        self._drives = tuple(measured)
        self._save()

    def _save(self) -> None:
        card = self._given
        applied = ', '.join(dict.fromkeys(s.calibration for s in self._sources if s.calibration))
        if not card.torque and not card.torque_unit:
            torque = {drive: at for s in self._sources for drive, at in s.torque.items()}
            unit = {drive: name for s in self._sources for drive, name in s.torque_unit.items()}
            card = replace(card, torque=torque, torque_unit=unit)
        card = replace(
            card, drives=card.drives or self._drives, calibration=card.calibration or applied
        )
        derived = [drive for s in self._sources for drive in s.derived_velocity]
        card = card.with_derived_velocity(derived)
        if card != self._saved:
            card.save(self._folder)
            self._saved = card
