"""Tracking: changes are found in the right estimate, and chance raises few alarms."""

from collections.abc import Mapping

import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_fleet.track.history import DriveHistory, histories
from power_fleet.track.recording_fit import Occasion, RecordingFit, Unfit, from_bytes, to_bytes
from power_fleet.track.search import hypotheses_of, search
from power_fleet.track.shared import common_levels, shrunk
from power_fleet.track.unmodelled import growths

CATALOGUE = builtin_catalogue()
NAMES = ('viscous_friction', 'coulomb_friction', 'idle', 'power_gain', 'current_offset')
LEVEL = np.array([3.0, 2.0, 8.0, 0.0, 0.0])
GAIN = np.array([3.0, 2.0, 8.0, 1.0, 0.0])  # what a gain of the meter adds to the estimates
# Viscous and Coulomb friction are easily mistaken for each other, so their errors are opposite.
SPREAD = np.array([0.10, 0.12, 0.08, 0.004, 0.002])
CORRELATION = np.eye(5) + np.array(
    [[0, -0.9, 0, 0, 0], [-0.9, 0, 0, 0, 0], [0] * 5, [0] * 5, [0] * 5]
)


def made(
    seed: int,
    count: int = 40,
    drives: tuple[str, ...] = ('LF_HAA', 'LF_HFE', 'LF_KFE'),
    added: Mapping[str, np.ndarray] | None = None,
    warmth: float = 0.0,
    temperature: np.ndarray | None = None,
) -> list[RecordingFit]:
    """
    Fits whose estimates are a known level, noise of a known covariance, and what is added.

    added: by drive [count, 5]. warmth: change of viscous friction per kelvin.
    """
    random = np.random.default_rng(seed)
    covariance = CORRELATION * SPREAD[:, None] * SPREAD
    if temperature is None:
        temperature = random.normal(15.0, 6.0, count)
    responses = {name: np.tile(np.eye(5)[i], (len(drives), 1)) for i, name in enumerate(NAMES)}
    responses['power_gain'] = np.tile(GAIN, (len(drives), 1))
    out = []
    for index in range(count):
        values = LEVEL + random.multivariate_normal(np.zeros(5), covariance, len(drives))
        values[:, 0] += warmth * (temperature[index] - 15.0)
        for place, drive in enumerate(drives):
            values[place] += 0.0 if added is None or drive not in added else added[drive][index]
        occasion = Occasion(
            f'day_{index:02d}',
            1.7e9 + 86400.0 * index,
            facts={'temperature': float(temperature[index])},
        )
        ones = np.ones((len(drives), 5))
        out.append(
            RecordingFit(
                occasion=occasion,
                drives=drives,
                labels=tuple((name, 0) for name in NAMES),
                values=values,
                covariance=np.tile(0.1 * covariance, (len(drives), 1, 1)),
                responses=responses,
                watts=ones,
                rms=ones,
                conditions={},
                error=np.ones(len(drives)),
                power=np.full((len(drives), 2), 15.0),
            )
        )
    return out


def step(at: int, size: np.ndarray, count: int = 40) -> np.ndarray:
    """Size from recording `at` on."""
    return (np.arange(count) >= at)[:, None] * size


def run(fits: list[RecordingFit]):
    """Search the histories of fits."""
    return search(histories(fits), CATALOGUE)


def test_a_step_of_one_effect_is_named_with_its_drive_date_and_size():
    fits = made(1, added={'LF_HFE': step(22, np.array([0.0, 0.5, 0.0, 0.0, 0.0]))})
    found = run(fits)
    assert len(found.findings) == 1
    finding = found.findings[0]
    assert found.models[finding.drive].history.drive == 'LF_HFE'
    assert finding.change.hypothesis == 'coulomb_friction'
    assert finding.change.profile.step
    assert abs(finding.change.profile.end - 22) <= 2
    assert finding.change.size == pytest.approx(0.5, abs=3 * finding.change.error)
    assert finding.change.error < 0.1
    assert finding.certainty >= 0.95


def test_a_slow_growth_is_a_drift_from_its_beginning_to_its_end():
    course = np.clip((np.arange(60) - 15.0) / 30.0, 0.0, 1.0)[:, None]
    fits = made(2, 60, added={'LF_KFE': course * np.array([0.9, 0.0, 0.0, 0.0, 0.0])})
    finding = run(fits).findings[0]
    assert finding.change.hypothesis == 'viscous_friction'
    assert not finding.change.profile.step
    assert abs(finding.change.profile.begin - 15) <= 6
    assert finding.change.size == pytest.approx(0.9, rel=0.15)


def test_a_gain_that_scales_every_estimate_is_the_meter_and_no_wear():
    fits = made(3, added={'LF_HAA': step(18, 0.04 * GAIN)})
    found = run(fits)
    assert [finding.change.hypothesis for finding in found.findings] == ['power_gain']
    assert found.findings[0].change.size == pytest.approx(0.04, abs=0.006)
    assert 'coulomb_friction' not in [r.hypothesis for r in found.findings[0].rivals]


def test_two_causes_that_add_the_same_are_both_named():
    fits = made(4, added={'LF_HAA': step(20, np.array([0.0, 0.0, 0.5, 0.0, 0.0]))})
    for fit in fits:  # an offset of 0.01 A at 48 V adds to the idle draw what 0.48 W do
        fit.responses['current_offset'][:] = 48.0 * np.eye(5)[2]
    finding = run(fits).findings[0]
    named = {finding.change.hypothesis, *(rival.hypothesis for rival in finding.rivals)}
    assert named == {'idle', 'current_offset'}


def test_quiet_histories_raise_an_alarm_in_about_one_of_twenty():
    alarms = sum(bool(run(made(100 + seed, 16, ('LF_HFE',))).findings) for seed in range(20))
    assert alarms <= 4  # 1 expected; more than 4 happen in 3 of 1000 such tests


def test_a_cold_season_is_explained_by_temperature_and_is_no_alarm():
    season = 15.0 + np.linspace(8.0, -8.0, 40) + np.random.default_rng(5).normal(0, 2.0, 40)
    found = run(made(5, warmth=-0.06, temperature=season))
    assert not found.findings
    assert {one.covariate for one in found.explained} == {'temperature'}
    assert {one.change.hypothesis for one in found.explained} == {'viscous_friction'}


def test_grease_that_thins_exponentially_over_a_season_raises_no_alarm():
    random = np.random.default_rng(8)
    season = 15.0 + 14.0 * np.sin(np.linspace(0.0, 4.0, 40)) + random.normal(0, 1.0, 40)
    thinner = np.zeros((40, 5))
    thinner[:, 0] = 2.0 * (np.exp(-0.04 * (season - 15.0)) - 1.0)
    drives = ('LF_HAA', 'LF_HFE', 'LF_KFE')
    fits = made(8, temperature=season, added=dict.fromkeys(drives, thinner))
    assert not run(fits).findings
    straight = [own.with_covariates(('temperature',)) for own in histories(fits)]
    assert search(straight, CATALOGUE).findings, 'the curvature is seen without that covariate'


def test_covariates_that_say_the_same_count_once():
    fits = made(6)
    for fit in fits:
        facts = dict(fit.occasion.facts or {})
        facts['fahrenheit'] = 32.0 + 1.8 * facts['temperature']
        facts['constant'] = 4.0
        object.__setattr__(fit.occasion, 'facts', facts)
    history: DriveHistory = histories(fits)[0]
    assert history.names == ('temperature', 'temperature, squared')


def test_recordings_are_taken_in_the_order_of_their_time():
    fits = made(7, 12)
    history = histories(fits[::-1])[0]
    assert history.recordings == tuple(f'day_{index:02d}' for index in range(12))
    assert 'torque_bend' not in hypotheses_of(history)


@pytest.mark.parametrize('count', [1, 2, 3])
def test_a_few_recordings_have_levels_and_no_alarm(count):
    found = run(made(15, count))
    assert not found.findings
    for model in found.models:
        level, error = model.levels
        assert np.isfinite(level).all()
        assert np.isfinite(error).all()
        np.testing.assert_allclose(level, LEVEL, atol=1.0)


def test_too_few_recordings_raise_no_alarm():
    fits = made(8, 6, added={'LF_HAA': step(3, np.array([0.0, 0.0, 5.0, 0.0, 0.0]), 6)})
    assert not run(fits).findings


def test_an_estimate_that_never_varies_spoils_no_other():
    """A delay on a grid is the same in every recording: its scatter is that of the grid."""
    fits = made(10, added={'LF_HFE': step(22, np.array([0.0, 0.5, 0.0, 0.0, 0.0]))})
    for fit in fits:
        fit.values[:, 4] = 0.002
    found = run(fits)
    (finding,) = found.findings
    assert finding.change.hypothesis == 'coulomb_friction'
    level, error = found.models[finding.drive].levels
    np.testing.assert_allclose(level, [*LEVEL[:4], 0.002], atol=0.1)
    assert (error > 0).all()


def delayed(fits: list[RecordingFit], at: int) -> list[RecordingFit]:
    """Name the last estimate of all drives the common delay, and let it move at a recording."""
    for index, fit in enumerate(fits):
        fit.values[:, 4] = 0.00175 + 0.00025 * (index >= at)
        responses = dict(fit.responses)
        responses['time_offset'] = responses.pop('current_offset')
        labels = (*fit.labels[:4], ('time_offset', 0))
        object.__setattr__(fit, 'responses', responses)
        object.__setattr__(fit, 'labels', labels)
        fit.covariance[:, :, 4] = fit.covariance[:, 4] = 0.0
        fit.covariance[:, 4, 4] = (0.00025 / 12**0.5) ** 2
        fit.rms[:, 4] = 2000.0
    return fits


def test_a_change_of_the_delay_of_all_drives_is_one_alarm():
    found = run(delayed(made(11), 20))
    assert [finding.change.hypothesis for finding in found.findings] == ['time_offset']


def test_a_delay_that_another_change_moves_is_no_alarm():
    fits = made(12, added={'LF_HFE': step(20, np.array([0.0, 0.5, 0.0, 0.0, 0.0]))})
    found = run(delayed(fits, 20))
    assert [finding.change.hypothesis for finding in found.findings] == ['coulomb_friction']


def test_a_delay_that_all_drives_have_in_common_has_a_level():
    fits = delayed(made(16), 40)
    common = common_levels(run(fits).models)['time_offset', 0]
    assert (common.value, common.spread) == (pytest.approx(0.00175), 0.0)


def test_a_drive_that_does_not_excite_a_coefficient_takes_it_from_the_others():
    fits = made(17)
    for fit in fits:
        fit.values[0, 0] += 2.0
        fit.covariance[0, 0, :] = fit.covariance[0, :, 0] = 0.0
        fit.covariance[0, 0, 0] = 100.0
    models = run(fits).models
    common = common_levels(models)
    own = models[0].levels[0][0]
    found = shrunk(models[0], common)
    assert own == pytest.approx(5.0, abs=0.2)
    assert found.level[0] == pytest.approx(3.0, abs=0.1)
    assert found.values[:, 0] == pytest.approx(3.0, abs=0.1)
    assert models[0].levels[0][0] == own


def with_errors(fits: list[RecordingFit], errors: np.ndarray) -> list[RecordingFit]:
    for fit, own in zip(fits, errors, strict=True):
        object.__setattr__(fit, 'error', own)
    return fits


def test_growth_of_what_the_model_misses_is_seen_and_less_of_it_is_not():
    random = np.random.default_rng(13)
    errors = 0.8 * np.exp(random.normal(0.0, 0.05, (40, 3)))
    grown = errors.copy()
    grown[25:, 2] *= 1.5
    (growth,) = growths(histories(with_errors(made(13), grown)))
    assert growth.drive == 2
    assert growth.change.profile.end == 25
    assert growth.before == pytest.approx(0.8, rel=0.05)
    assert growth.after == pytest.approx(1.2, rel=0.05)
    assert not growths(histories(with_errors(made(13), errors)))
    assert not growths(histories(with_errors(made(13), grown[::-1])))


def test_growth_that_is_certain_but_tiny_is_none():
    errors = 0.10 * np.exp(np.random.default_rng(14).normal(0.0, 0.01, (40, 3)))
    errors[20:] *= 1.2
    assert not growths(histories(with_errors(made(14), errors)))


def test_a_kept_fit_is_the_fit_that_was_kept():
    (fit,) = made(9, 1)
    again = from_bytes(to_bytes(fit))
    assert isinstance(again, RecordingFit)
    assert (again.occasion, again.drives, again.labels) == (fit.occasion, fit.drives, fit.labels)
    for name in ('values', 'covariance', 'watts', 'rms', 'error', 'power'):
        np.testing.assert_array_equal(getattr(again, name), getattr(fit, name))
    for name, response in fit.responses.items():
        np.testing.assert_array_equal(again.responses[name], response)
    assert from_bytes(to_bytes(Unfit('too still'))) == Unfit('too still')
