"""Rows of the result table, and sentences, of a comparison with an analyser."""

from power_calibration.analyser.comparison import AnalyserComparison
from power_calibration.analyser.reference_fit import IntervalEstimate

COLUMNS = ('', 'value', '95 % from', 'to')
_UNITS = {'voltage': 'V', 'current': 'A'}


def rows(found: AnalyserComparison) -> list[tuple[str, str, str, str]]:
    """Return quantity, value and limits of the 95 % interval for all that was fitted."""
    table = []
    for name, channel in found.channels.items():
        table.append((f'{name} gain', *_texts(channel.gain, 5)))
        unit = _UNITS[name]
        if channel.fixed:
            table.append((f'{name} offset [{unit}]', '0 (held)', '', ''))
        else:
            table.append((f'{name} offset [{unit}]', *_texts(channel.offset, 5)))
    offset = found.time_offset
    half = 0.5e6 * (offset.high - offset.low)
    table.append(('time offset [s]', f'{offset.value:.6f}', f'±{half:.1f} µs', ''))
    table.append(('drift of its clock [ppm]', *_texts(found.drift_ppm, 2)))
    answer = found.response
    if answer is not None:
        if answer.cutoff is not None:
            table.append(('our bandwidth, −3 dB [Hz]', *_texts(answer.cutoff, 0)))
        else:
            table.append(('our bandwidth, −3 dB [Hz]', f'none up to {answer.reach:.0f}', '', ''))
    return table


def calibration_sentences(found: AnalyserComparison) -> list[str]:
    """Return the errors of power before and after, and the power above our bandwidth."""
    text = [
        f'Error of power at {found.error_rate:.0f} Hz: {found.before:.3f} W RMS as recorded '
        f'(mean {found.mean_before:+.3f} W), {found.after:.3f} W calibrated '
        f'(mean {found.mean_after:+.3f} W), over {found.overlap:.1f} s; '
        f'correlation {found.correlation:.5f}.'
    ]
    if found.loss is not None:
        lost = found.loss
        share = 100.0 * (lost.rms / lost.total) ** 2
        above = (
            f'Above {lost.above:.0f} Hz the analyser measures {lost.rms:.2f} W RMS that we miss, '
            f'{share:.2g} % of the variance'
        )
        if lost.mean is not None:
            above += f'; it carries {1000.0 * lost.mean:+.1f} mW on average'
        text.append(above + '.')
    return text


def _texts(value: IntervalEstimate, digits: int) -> tuple[str, str, str]:
    low, middle, high = (f'{x:.{digits}f}' for x in (value.low, value.value, value.high))
    return middle, low, high
