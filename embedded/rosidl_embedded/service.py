"""Service classes: a pair of messages."""

from functools import cache
from typing import Any

from rosidl_embedded import definitions
from rosidl_embedded.message import class_of


@cache
def _class_of(package: str, name: str) -> Any:
    request = class_of(f'{package}/srv/{name}_Request')
    response = class_of(f'{package}/srv/{name}_Response')
    members = {
        'Request': request,
        'Response': response,
        '_type_name': f'{package}/srv/{name}',
        '__module__': f'{package}.srv',
        '__doc__': f"Service class '{name}' with Request and Response.",
    }
    return type(name, (), members)


def service_class(package: str, name: str, kind: str = 'srv') -> Any:
    """
    Return a service class by package and name.

    Raises AttributeError where there is no such service, as a module does for a missing name.
    """
    if name.startswith('__') or not definitions.is_known(f'{package}/{kind}/{name}_Request'):
        raise AttributeError(f'module {package}.{kind} has no attribute {name!r}')
    return _class_of(package, name)
