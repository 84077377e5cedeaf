"""Definitions of the interfaces: ROS 2 Jazzy's from rosbags, others from definition files."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Fielddefs
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

EMPTY_MEMBER = 'structure_needs_at_least_one_member'
DEFAULTS: dict[tuple[str, str], float] = {
    ('geometry_msgs/msg/Quaternion', 'w'): 1.0,
    ('sensor_msgs/msg/NavSatStatus', 'status'): -2,
}


@cache
def definitions() -> Typestore:
    """Return the type store of all definitions, one for the process."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def _folder(package: str) -> Path | None:
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        return None
    folder = Path(next(iter(spec.submodule_search_locations))) / 'definitions'
    return folder if folder.is_dir() else None


def _add(type_name: str, text: str) -> None:
    package, _, name = type_name.split('/')
    parsed = get_types_from_msg(text, f'{package}/msg/{name}')
    definitions().fielddefs[type_name] = parsed[f'{package}/msg/{name}']


def is_known(type_name: str) -> bool:
    """Tell whether an interface such as `sensor_msgs/msg/JointState` has a definition.

    Reads the definition file of the package's `definitions` folder where there is one. A service
    is known as the two messages `pkg/srv/Name_Request` and `pkg/srv/Name_Response`.
    """
    known = definitions().fielddefs
    if type_name in known:
        return True
    package, kind, name = type_name.split('/')
    folder = _folder(package)
    if folder is None:
        return False
    if kind == 'msg':
        path = folder / f'{name}.msg'
        if path.is_file():
            _add(type_name, path.read_text(encoding='utf-8'))
    else:
        path = folder / f'{name.rsplit("_", 1)[0]}.srv'
        if path.is_file():
            request, response = f'\n{path.read_text(encoding="utf-8")}'.split('\n---')
            _add(f'{package}/srv/{path.stem}_Request', request)
            _add(f'{package}/srv/{path.stem}_Response', response)
    return type_name in known


def fields_of(type_name: str) -> Fielddefs:
    """Return name and rosbags type descriptor of each field, in the order of serialization."""
    is_known(type_name)
    fields = definitions().fielddefs[type_name][1]
    return fields or [(EMPTY_MEMBER, (Nodetype.BASE, ('uint8', 0)))]


def constants_of(type_name: str) -> dict[str, bool | int | float | str | bytes]:
    """Return the constants of a message; one of type byte is bytes, as in rclpy."""
    is_known(type_name)
    return {
        name: bytes((int(value) & 255,)) if kind == 'byte' else value
        for name, kind, value in definitions().fielddefs[type_name][0]
    }


@cache
def type_hash(type_name: str) -> str:
    """Return the REP-2016 hash (`RIHS01_…`) that ROS 2 exchanges in discovery."""
    is_known(type_name)
    return definitions().hash_rihs01(type_name)
