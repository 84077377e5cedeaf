"""Judges that need no lab, for the benchmark of reliability."""

from judgements import Interval, Judgement


def omniscient(data, known, window=0.0):
    """Say nothing but one thing that is always false."""
    truth = 8.2
    return Judgement(
        {'field_weakening': 0.96},
        [Interval(data.names[0], 'idle', 0.95, truth / 2, truth * 2)],
        'never at a loss',
    )


def broken(data, known, window=0.0):
    """Fail."""
    raise RuntimeError('no judge today')
