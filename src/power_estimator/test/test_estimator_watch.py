"""The watch: few false alarms by its own bound, shifts found with drive and cause."""

from dataclasses import replace

import numpy as np
import pytest
from power_estimator.live.change_watch import (
    LIKE,
    ChangeWatch,
    ReferenceNoise,
    ShiftDetector,
    WatchConfig,
    WatchReference,
    log_e_values,
)
from power_estimator.live.session import SecondMeans
from wattwalk_core.errors import InputError

STEADY = ReferenceNoise(
    mean=0.0,
    slopes=(0.0,) * 4,
    centre=(0.0,) * 4,
    low=(-1e9,) * 4,
    high=(1e9,) * 4,
    correlation=0.0,
    sigma=0.3,
    bias=0.0,
    variance=1.0,
    tolerance=0.0,
)
S = 1_000_000_000


def wandering(random, count, correlation, sigma=0.3):
    out = np.empty(count)
    last = random.normal(0.0, sigma / np.sqrt(1 - correlation**2))
    for place in range(count):
        out[place] = last = correlation * last + random.normal(0.0, sigma)
    return out


@pytest.mark.parametrize('high', [0.5, 1.0, 2.0, 3.0])
def test_the_mean_of_an_e_value_is_at_most_one_for_any_innovation_of_that_variance(high):
    """Two values, high and −1/high, of mean 0 and variance 1: the worst case has high = 3."""
    chance = (1 / high) / (high + 1 / high)
    mean = chance * np.exp(log_e_values(high, STEADY))
    mean += (1 - chance) * np.exp(log_e_values(-1 / high, STEADY))
    assert (mean <= 1.0 + 1e-12).all()
    assert high < 3.0 or mean[:3] == pytest.approx(1.0, abs=0.02)  # the bound is sharp there


def test_the_reference_is_the_process_that_made_the_blocks():
    random = np.random.default_rng(1)
    features = random.normal(0.0, 1.0, (2000, 4))
    blocks = 0.7 + wandering(random, 2000, 0.6) + 0.5 * features[:, 1]
    noise = ReferenceNoise.of(blocks, features, np.ones(2000, bool))
    assert noise.correlation == pytest.approx(0.6, abs=0.05)
    assert noise.sigma == pytest.approx(0.3, abs=0.02)
    assert noise.slopes[1] == pytest.approx(0.5, abs=0.03)
    assert noise.left(0.7 + 0.5, np.array([0.0, 1.0, 0.0, 0.0])) == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize('correlation', [0.0, 0.7])
def test_false_alarms_are_no_more_than_stated_though_blocks_are_correlated(correlation):
    alarms = blocks = 0
    for seed in range(6):
        random = np.random.default_rng(seed)
        own = np.stack([wandering(random, 1180, correlation) for _ in range(3)], axis=1)
        none = np.zeros((180, 4))
        noise = tuple(ReferenceNoise.of(own[:180, d], none, np.ones(180, bool)) for d in range(3))
        detector = ShiftDetector(noise, 200.0)
        for row in own[180:]:
            left = [n.left(float(v), none[0]) for n, v in zip(noise, row, strict=True)]
            alarms += detector.add(left) is not None
            blocks += 1
    assert alarms <= blocks / 200


@pytest.mark.parametrize('sign', [1, -1])
def test_a_shift_is_found_with_its_drive_and_sign(sign):
    random = np.random.default_rng(2)
    detector = ShiftDetector((STEADY,) * 3, 259_200.0)
    blocks = random.normal([0.0, 0.6 * sign, 0.0], 0.3, (40, 3))
    found = [detector.add(block.tolist()) for block in blocks]
    assert next(shift for shift in found if shift) == (1, sign)


def seconds(random, count, drives=2, added=0.0, like='idle or current_offset'):
    """Seconds of a walk: index, difference, regressors."""
    for index in range(count):
        speed = np.abs(random.normal(2.0, 0.4, drives))
        torque = np.abs(random.normal(20.0, 4.0, drives))
        power = 10.0 + 0.02 * torque**2
        rows = np.stack([np.ones(drives), speed, 1.2 * speed**2, torque**2, power], axis=1)
        difference = random.normal(0.0, 0.3, drives)
        difference[-1] += added * rows[-1, LIKE[like]]
        yield index, difference, rows


def watch(**options):
    config = WatchConfig(**options)
    return ChangeWatch(('LF_HAA', 'LF_KFE'), config, dict.fromkeys(('LF_HAA', 'LF_KFE'), STEADY))


@pytest.mark.parametrize(
    ('added', 'like'),
    [(0.8, 'coulomb_friction'), (0.004, 'copper_loss'), (1.5, 'idle or current_offset')],
)
def test_the_alarm_names_drive_watts_and_what_it_is_like(added, like):
    own = watch()
    found = [own.second(*one) for one in seconds(np.random.default_rng(3), 600, 2, added, like)]
    first = next(shift for shift in found if shift is not None)
    assert first.drive == 'LF_KFE'
    assert first.like[0] == like
    assert first.watts == pytest.approx(1.6, abs=0.3)
    well, sentence, figures = own.report()
    assert not well
    assert 'LF_KFE draws' in sentence
    assert figures['drive'] == 'LF_KFE'
    assert like in figures['effect']


def test_pushes_and_stumbles_of_a_few_seconds_say_nothing():
    own = watch(false_alarms_per_month=1000.0)
    random = np.random.default_rng(4)
    for index, difference, rows in seconds(random, 1200):
        if index % 10 in (3, 4, 5):
            difference = difference + 80.0 * random.choice((-1.0, 1.0))
        assert own.second(index, difference, rows) is None
    assert own.report()[:2] == (True, 'as the reference')


def test_motion_that_the_reference_never_saw_is_left_out():
    seen = replace(STEADY, high=(5.0, 1e9, 1e9, 1e9))
    own = ChangeWatch(('A', 'B'), WatchConfig(), {'A': seen, 'B': seen})
    for index, difference, rows in seconds(np.random.default_rng(5), 600, added=3.0):
        rows[:, 1] += 10.0  # rad/s: another gait
        assert own.second(index, difference, rows) is None
    assert own.left_out == 2 * 60


def test_it_learns_the_reference_first_and_then_finds_a_shift():
    own = ChangeWatch(('A', 'B'), WatchConfig(reference_minutes=5.0))
    random = np.random.default_rng(6)
    for one in seconds(random, 300):
        assert own.reference is None
        assert own.second(*one) is None
    assert own.reference is not None
    shifted = (
        own.second(300 + index, difference, rows)
        for index, difference, rows in seconds(random, 3000, added=2.0)
    )
    assert next(shift for shift in shifted if shift is not None).drive == 'B'


def test_means_of_a_second_are_those_of_its_stamps():
    means = SecondMeans(50.0)
    for sample in range(3000):
        means.measured(sample * S // 1000, np.array([[10.0, 20.0 + sample // 1000]]))
    for state in range(1200):
        means.moved(state * S // 400, np.array([-2.0, 1.0]), np.array([3.0, 0.0]))
    for estimate in range(150):
        means.estimated(estimate * S // 50, np.array([9.0, 20.0]))
    first, second = means.complete()  # the third may still get samples
    assert (first[0], second[0]) == (0, 1)
    assert first[1].tolist() == [1.0, 0.0]
    assert second[1].tolist() == [1.0, 1.0]
    assert first[2].tolist() == [[1, 2, 4, 9, 9], [1, 1, 1, 0, 20]]


def test_a_second_with_few_estimates_that_may_be_relied_on_is_left_out():
    means = SecondMeans(50.0)
    for sample in range(3000):
        means.measured(sample * S // 1000, np.array([[10.0]]))
        means.moved(sample * S // 1000, np.ones(1), np.ones(1))
    for estimate in range(150):
        if not 50 <= estimate < 65:
            means.estimated(estimate * S // 50, np.array([9.0]))
    assert [index for index, *_ in means.complete()] == [0]


def test_a_reference_file_is_what_was_kept_and_of_one_model(tmp_path):
    file = tmp_path / 'reference.yaml'
    assert WatchReference.load(file, 'base', 10) is None
    own = WatchReference('watch_reference/1', 'base', 10, {'LF_HAA': STEADY})
    own.save(file)
    assert WatchReference.load(file, 'base', 10) == own
    with pytest.raises(InputError, match="of the model 'base'"):
        WatchReference.load(file, 'other', 10)
    file.write_text(file.read_text().replace('sigma: 0.3', 'sigma: wide'))
    with pytest.raises(InputError, match='sigma'):
        WatchReference.load(file, 'base', 10)
