"""A comparison in rows of a table and in sentences."""

from power_calibration.analyser.comparison import Comparison
from power_calibration.analyser.fit import Value

_UNITS = {'voltage': 'V', 'current': 'A'}


def rows(found: Comparison) -> list[tuple[str, str, str, str]]:
    """Figure, value, and the interval of 95 % for each thing that was fitted."""
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
            table.append(('our bandwidth, −3 dB [Hz]', f'over {answer.reach:.0f}', '', ''))
    return table


def sentences(found: Comparison) -> list[str]:
    """What it comes to."""
    said = [
        f'Error of power at {found.error_rate:.0f} Hz: {found.before:.3f} W RMS as recorded '
        f'(mean {found.mean_before:+.3f} W), {found.after:.3f} W calibrated '
        f'(mean {found.mean_after:+.3f} W), over {found.overlap:.1f} s; '
        f'correlation {found.correlation:.5f}.'
    ]
    if found.loss is not None:
        lost = found.loss
        share = 100.0 * (lost.rms / lost.total) ** 2
        text = (
            f'Above {lost.above:.0f} Hz the analyser sees {lost.rms:.2f} W RMS that we do not, '
            f'{share:.2g} % of the variance'
        )
        if lost.mean is not None:
            text += f'; it carries {1000.0 * lost.mean:+.1f} mW on average'
        said.append(text + '.')
    return said


def _texts(value: Value, digits: int) -> tuple[str, str, str]:
    low, middle, high = (f'{x:.{digits}f}' for x in (value.low, value.value, value.high))
    return middle, low, high
