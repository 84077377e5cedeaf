"""Recordings that are not judged: slow meters, and signals that contradict each other."""

import numpy as np
from wattwalk_core.errors import InputError

from power_recordings.quality.check import check_recording
from power_recordings.quality.streams import LEAST_UPDATES, updates
from power_recordings.reading.reader import Recording


def slowest_power(recording: Recording) -> tuple[str, float]:
    """Return the meter whose power changes least often, a drive or `supply`, and its changes/s."""
    if recording.has('drive_supply'):
        electric = recording.drive_supply()
        rates = updates(electric.stamp_ns, electric.power)
        rates = np.where(np.isfinite(electric.power).any(axis=0), rates, np.inf)
        worst = int(np.argmin(rates))
        return electric.names[worst], float(rates[worst])
    supply = recording.supply()
    return 'supply', float(updates(supply.stamp_ns, supply.power[:, None])[0])


def refuse_wrong_units(recording: Recording) -> None:
    """InputError for a recording whose signals contradict each other, with what would mend it."""
    wrong = [
        finding
        for finding in check_recording(recording).findings
        if finding.severity == 'error' and finding.code != 'slow_power'
    ]
    if not wrong:
        return
    first = wrong[0]
    more = f' ({len(wrong) - 1} more: `power_recordings info`)' if len(wrong) > 1 else ''
    mend = f'; in the map: {first.mend}' if first.mend else ''
    who = f'{first.drive}: ' if first.drive else ''
    raise InputError(
        f'{recording.path}: {who}{first.text}{mend}{more}; --anyway judges it as it is'
    )


def refuse_slow(recording: Recording) -> None:
    """InputError for a recording whose power is too slow to be judged sample by sample."""
    meter, rate = slowest_power(recording)
    if rate < LEAST_UPDATES:
        raise InputError(
            f'{recording.path}: the power of {meter} changes {rate:.3g} times a second; the lab '
            f'needs {LEAST_UPDATES:.0f}. With --slow it judges the energy over windows only'
        )
