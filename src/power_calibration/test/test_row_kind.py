"""Point samples and means are told apart where the data allow it, and never taken for another."""

import numpy as np
import pytest
from power_calibration.analyser.comparison import row_kind
from power_calibration.analyser.curve import Curve
from power_calibration.analyser.reference_fit import Clock
from scipy.signal import lfilter

FINE = 20_000  # Hz
TONES = ((0.23, 1.5), (1.1, 1.0), (2.7, 1.2), (5.3, 0.8), (9.1, 0.4))


def verdict(rate, kind, *, ours=0.005, reference=0.003, fast=0.0, cutoff=None, seed=0):
    """Compare a meter at 1 kHz with rows of a kind; noise of both, A; cutoff of the meter, Hz."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 14, 1 / FINE)
    tones = (*TONES, (37.0, fast), (61.0, fast), (83.0, fast))
    true = sum(size * np.sin(2 * np.pi * f * time + f) for f, size in tones)
    seen, delay = true, 0.0
    if cutoff is not None:
        keep = np.exp(-2 * np.pi * cutoff / FINE)
        seen, delay = lfilter([1 - keep], [1, -keep], true), 1 / (2 * np.pi * cutoff)
    every = round(FINE / rate)
    blocks = (x[: len(x) // every * every].reshape(-1, every) for x in (time, true))
    times, rows = (x.mean(axis=1) if kind == 'means' else x[:, 0] for x in blocks)
    measured = seen[::20] + ours * random.standard_normal(len(seen[::20]))
    logged = rows + reference * random.standard_normal(len(rows))
    return row_kind(
        Curve(((time[::20] - delay, measured[:, None]),), 0.001),
        Curve(((times, logged[:, None]),), 1 / rate),
        Clock(0.0, 0.0, 7.0),
        1 / rate,
    )


@pytest.mark.parametrize('kind', ['samples', 'means'])
@pytest.mark.parametrize(
    'how',
    [
        {'rate': 50.0},
        {'rate': 100.0},
        {'rate': 200.0, 'fast': 0.1, 'cutoff': 336.0},
        {'rate': 400.0, 'fast': 0.3, 'cutoff': 336.0},
    ],
)
def test_rows_that_differ_are_told_apart(kind, how):
    assert [verdict(kind=kind, seed=seed, **how) for seed in range(3)] == [kind] * 3


@pytest.mark.parametrize('kind', ['samples', 'means'])
@pytest.mark.parametrize(
    'noise', [{'ours': 0.2}, {'reference': 0.2}, {'ours': 0.2, 'reference': 0.2}]
)
def test_noise_of_either_side_does_not_decide(kind, noise):
    assert {verdict(100.0, kind, seed=seed, **noise) for seed in range(5)} <= {kind, None}


@pytest.mark.parametrize('kind', ['samples', 'means'])
def test_a_signal_too_slow_for_the_period_is_undecidable(kind):
    assert [verdict(400.0, kind, seed=seed) for seed in range(3)] == [None] * 3
