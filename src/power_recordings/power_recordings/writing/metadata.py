"""The metadata.yaml of a rosbag2 bag, version 9, as ROS 2 Jazzy writes it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from wattwalk_core.errors import InputError
from wattwalk_core.yaml_file import dump_yaml

VERSION = 9
_FOREVER = {'sec': 9223372036, 'nsec': 854775807}
_CHOICES = {
    'reliability': ('reliable', 'best_effort'),
    'durability': ('volatile', 'transient_local'),
    'history': ('keep_last', 'keep_all'),
}


@dataclass(frozen=True)
class Qos:
    """QoS that a topic's publishers offered, for `ros2 bag play` to offer the same."""

    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'
    depth: int = 1000

    def __post_init__(self) -> None:
        for field, choices in _CHOICES.items():
            if getattr(self, field) not in choices:
                raise InputError(
                    f'QoS {field} is {getattr(self, field)!r}; it is one of {", ".join(choices)}'
                )
        if self.depth < 1:
            raise InputError(f'QoS depth is {self.depth}; it must be at least 1')

    def profile(self) -> dict[str, Any]:
        """Return the profile with rosbag2's keys."""
        return {
            'history': self.history,
            'depth': self.depth,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': _FOREVER,
            'lifespan': _FOREVER,
            'liveliness': 'automatic',
            'liveliness_lease_duration': _FOREVER,
            'avoid_ros_namespace_conventions': False,
        }

    def dump(self) -> str:
        """Return the profile as YAML for the metadata of an MCAP channel."""
        return dump_yaml([self.profile()]).rstrip()


@dataclass(frozen=True)
class TopicSummary:
    """One topic of a bag."""

    name: str
    type_name: str
    type_hash: str
    qos: Qos
    count: int


def information(
    file_name: str, topics: Sequence[TopicSummary], start_ns: int, end_ns: int
) -> dict[str, Any]:
    """Return the content of `rosbag2_bagfile_information` for a bag of one file."""
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
                    'offered_qos_profiles': [topic.qos.profile()],
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
