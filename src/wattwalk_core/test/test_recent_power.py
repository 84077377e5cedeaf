"""Means of the last seconds, and the budget that meters and a model make together."""

from math import isnan, nan

import numpy as np
import pytest
from wattwalk_core.recent_power import RecentBudget, RecentMean, budget_figures, parts_of

MS = 1_000_000


def test_the_mean_is_of_the_last_ten_seconds():
    """Ten seconds at 100 W, then five at 40 W: (5 · 100 + 5 · 40) / 10."""
    mean = RecentMean()
    assert isnan(mean.value)
    for second in range(15):
        stamps = (1000 * second + 10 * np.arange(100)) * MS
        mean.add(stamps, np.full(100, 100.0 if second < 10 else 40.0))
    assert mean.value == pytest.approx(70.0)


def test_samples_that_are_not_finite_do_not_count_and_a_clock_set_back_begins_anew():
    mean = RecentMean()
    mean.add(MS * np.arange(4), np.array([1.0, nan, 3.0, nan]))
    assert mean.value == 2.0
    mean.add(MS * np.arange(2), np.array([7.0, 7.0]))
    assert mean.value == 7.0


def test_what_the_model_leaves_is_unexplained_and_what_the_drives_leave_is_electronics():
    budget = RecentBudget.of({'copper_loss': 30.0, 'shaft': 20.0}, drives=60.0, supply=100.0)
    assert [*budget.parts.items()] == [
        *(('electronics', 40.0), ('copper_loss', 30.0), ('shaft', 20.0), ('unexplained', 10.0))
    ]
    assert budget.metered == sum(budget.parts.values()) == 100.0
    assert budget.hours(200.0) == 2.0
    left = 'unexplained 10.0 W 10 %'
    assert budget.words(80) == f'electronics 40.0 W 40 %, copper loss 30.0 W 30 %, {left}'
    assert budget.words(60) == f'electronics 40.0 W 40 %, {left}'


def test_without_a_model_drives_and_electronics_are_the_parts():
    assert RecentBudget.of({}, 60.0, 100.0).parts == {'drives': 60.0, 'electronics': 40.0}
    assert RecentBudget.of({}, 60.0, nan).metered == 60.0
    nothing = RecentBudget.of({}, nan, nan)
    assert (nothing.parts, nothing.words(80)) == ({}, '')
    assert isnan(nothing.hours(500.0))


def test_parts_go_through_the_figures_of_a_report():
    figures = {**budget_figures({'copper_loss': 1.25}), 'model': 'x', 'shaft [W]': 'much'}
    assert parts_of(figures) == {'copper_loss': 1.25}
