"""Results that are kept while there is room for them."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Value = TypeVar('Value')


class Kept(Generic[Value]):
    """Values by key, of which those used least recently go when all need more than a budget."""

    def __init__(self, budget: int, fewest: int = 1) -> None:
        """budget: bytes; fewest: values that stay whatever they need."""
        self._budget, self._fewest = budget, fewest
        self._values: OrderedDict[Hashable, tuple[Value, int]] = OrderedDict()
        self._used = 0

    def get(self, key: Hashable, make: Callable[[], Value], size: Callable[[Value], int]) -> Value:
        """Return the value of a key, made anew where it is not kept; size in bytes."""
        if key in self._values:
            self._values.move_to_end(key)
            return self._values[key][0]
        value = make()
        self.put(key, value, size(value))
        return value

    def put(self, key: Hashable, value: Value, size: int) -> None:
        """Keep a value of a size in bytes."""
        self.drop(key)
        self._values[key] = (value, size)
        self._used += size
        while self._used > self._budget and len(self._values) > self._fewest:
            _, (_, freed) = self._values.popitem(last=False)
            self._used -= freed

    def drop(self, key: Hashable) -> None:
        """Forget the value of a key."""
        if key in self._values:
            self._used -= self._values.pop(key)[1]
