"""State of a bench supply for `diagnostics`: a sentence and figures."""

from collections.abc import Mapping

from wattwalk_core.nodes.diagnostics import Level, Report

from power_daq.acquisition.count_changes import CountChanges
from power_daq.supply.energy_counters import Balance, Energy
from power_daq.supply.poller import Poller

_RATE_SLACK = 0.02
_MISSING_POWER = 0.02
_LEAST_MISSING = 5.0
_SECONDS_FOR_VERDICT = 10
_LONGEST_NAMES = 4


class SupplyHealth:
    """Reports on a poller, by the changes of its counts since the report before."""

    def __init__(self, poller: Poller, rate: float, resource: str) -> None:
        self._poller, self._rate, self._resource = poller, rate, resource
        self._changes = CountChanges()

    def report(self, now: float, energy: Energy, balance: Balance | None) -> Report:
        """Return the state since the report before; now in s on a steady clock."""
        state = self._poller.state
        counts = {name.replace('_', ' '): n for name, n in vars(state.counts).items()}
        counts['readings lost'] = self._poller.lost
        news, span = self._changes.since_last(counts, now)
        figures = {'instrument': self._resource}
        if state.identity is not None:
            figures['identity'] = ', '.join(state.identity)
        rate = news['readings'] / span if span > 0 else None
        if rate is not None:
            figures['rate [Hz]'] = f'{rate:.1f}'
        worst = 1e3 * self._poller.take_worst_round_trip()
        figures['worst round trip [ms]'] = f'{worst:.2f}'
        figures |= {name: str(count) for name, count in counts.items()}
        if state.last_errors:
            figures['last instrument errors'] = '; '.join(map(str, state.last_errors))
        if state.last_garbage:
            figures['last that was no answer'] = state.last_garbage
        figures |= {
            'energy [J]': f'{energy.joule:.1f}',
            'energy [Wh]': f'{energy.watt_hours:.4f}',
            'energy counted over [s]': f'{energy.seconds:.2f}',
            'energy not counted for [s]': f'{energy.uncounted:.2f}',
            **_balance_figures(balance),
        }
        return Report(*self._judge(news, rate, balance), figures)

    def _judge(
        self, news: Mapping[str, float], rate: float | None, balance: Balance | None
    ) -> tuple[Level, str]:
        state = self._poller.state
        if state.absence:
            return Level.ERROR, f'supply absent: {state.absence}'
        faults = [
            f'{count:.0f} {name}'
            for name, count in news.items()
            if count > 0 and name not in ('readings', 'connections')
        ]
        if faults:
            sentence = 'in the last second: ' + ', '.join(faults)
            if news['instrument errors'] and state.last_errors:
                sentence += f' ({state.last_errors[-1]})'
            return Level.WARN, sentence
        if rate is not None and rate < (1 - _RATE_SLACK) * self._rate:
            return Level.WARN, f'supply at {rate:.0f} Hz, not {self._rate:.0f} Hz'
        if balance is not None and balance.seconds >= _SECONDS_FOR_VERDICT:
            least = -max(_LEAST_MISSING, _MISSING_POWER * abs(balance.drives))
            if balance.rest_mean < least:
                return Level.WARN, (
                    f'the drives draw {-balance.rest_mean:.1f} W more than the supply gives: '
                    'check signs, gains and which supply feeds them'
                )
        return Level.OK, 'measuring'


def _balance_figures(balance: Balance | None) -> dict[str, str]:
    if balance is None:
        return {'drives compared': 'none: no drive_supply in the same seconds'}
    names = ', '.join(balance.names[:_LONGEST_NAMES])
    more = len(balance.names) - _LONGEST_NAMES
    return {
        'drives compared': f'{len(balance.names)}: {names}{", …" if more > 0 else ""}',
        'supply, mean of 1 s [W]': f'{balance.supply:.2f}',
        'drives, mean of 1 s [W]': f'{balance.drives:.2f}',
        'supply minus drives (electronics), mean of 1 s [W]': f'{balance.rest:.2f}',
        'supply minus drives (electronics), mean of 30 s [W]': f'{balance.rest_mean:.2f}',
        'seconds in the mean': str(balance.seconds),
    }
