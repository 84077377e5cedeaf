"""Changes of fault counters between two reports."""

from collections.abc import Mapping


class CountChanges:
    """The change of counters, by name, since the report before."""

    def __init__(self) -> None:
        self._before: Mapping[str, float] = {}
        self._time: float | None = None

    def since_last(
        self, counts: Mapping[str, float], now: float
    ) -> tuple[dict[str, float], float]:
        """Return the change of each counter, and the time in s over which it came (0: first)."""
        news = {name: count - self._before.get(name, 0) for name, count in counts.items()}
        span = 0.0 if self._time is None else now - self._time
        self._time, self._before = now, counts
        return news, span
