"""State of republished topics for `diagnostics`: a sentence and figures."""

from collections.abc import Iterable, Sequence

from wattwalk_core.nodes.diagnostics import CountChanges, Level, Report, faults, some

from power_daq.topics.republisher import Republisher

_LAG = 1.0  # s between the stamps of topics that belong together
_FAULTS = (' lost', ' out of order', ' not finite', ' restarts')


class TopicsHealth:
    """Reports on a republisher, by the changes of its counts since the report before."""

    def __init__(self, republisher: Republisher) -> None:
        self._republisher = republisher
        self._changes = CountChanges()

    def report(self, now: float, present: Iterable[str]) -> Report:
        """Return the state since the report before; now in s, present: topics that exist."""
        source = self._republisher
        present = list(present)
        counts: dict[str, float] = {f'{t} messages': n for t, n in sorted(source.heard.items())}
        for name, group in source.groups.items():
            counts[f'{name} samples'] = group.given
            counts[f'{name} lost'] = group.lost
            counts[f'{name} out of order'] = group.merger.out_of_order
            counts[f'{name} not finite'] = group.not_finite
            counts[f'{name} restarts'] = group.restarts
        news, span = self._changes.since_last(counts, now)
        figures = {}
        if span > 0:
            for name in source.groups:
                figures[f'{name} rate [Hz]'] = f'{news[f"{name} samples"] / span:.1f}'
        figures |= {name: f'{count:.0f}' for name, count in counts.items()}
        level, sentence = self._judge(news, span, present)
        return Report(level, sentence, figures)

    def _judge(
        self, news: dict[str, float], span: float, present: Sequence[str]
    ) -> tuple[Level, str]:
        source = self._republisher
        if waiting := source.awaited:
            there = source.topics.awaited(present)
            reasons = [
                f'{name} ({"no such topic" if name in there else "no message yet"})'
                for name in waiting
            ]
            return Level.ERROR, f'waiting for {some(reasons)}'
        if source.plan is None:
            return Level.OK, 'waiting for more drives'
        groups = source.groups.values()
        silent = [t for g in groups for t in g.topics if not news.get(f'{t} messages') and span]
        if silent:
            return Level.ERROR, f'no message in the last second of {some(silent)}'
        late = [
            f'{topic} by {group.lag(topic):.1f} s'
            for group in groups
            for topic in group.topics
            if group.lag(topic) > _LAG
        ]
        if late:
            return Level.WARN, (
                f'stamps lag behind those of other topics: {some(late)}; '
                'time: {stamp: log} in the map takes the times of receipt'
            )
        if found := faults(news, lambda name: name.endswith(_FAULTS)):
            return Level.WARN, f'in the last second: {found}'
        if new := [topic for topic in present if source.is_left_out(topic)]:
            return Level.WARN, f'came too late and is left out: {some(new)}; start again'
        return Level.OK, 'republishing'
