import sys
from dataclasses import replace
from threading import Barrier, get_ident

import numpy as np
import pytest
from power_estimator.effects import Effect, builtin_catalogue
from power_estimator.effects.fit.blocks import for_each, one_thread_a_product
from power_estimator.effects.fit.by_drive import ByDriveBuilder
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.fit.design_builder import DesignBuilder
from power_estimator.effects.signals.pieces import pieces
from power_estimator.effects.signals.prepared import prepare
from power_recordings.alignment.dataset import AlignedDataset
from threadpoolctl import threadpool_info, threadpool_limits

RATE = 400.0
CATALOGUE = builtin_catalogue()


def recorded(seconds=120.0, *, gap=None, seed=3):
    """Three drives on random smooth motions; their power is what torque and velocity do."""
    random = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    lines, phases = random.uniform(0.2, 3.5, (8, 3)), random.uniform(0, 6.28, (8, 3))
    waves = 2 * np.pi * lines * time[:, None, None] + phases
    position = (0.25 / lines * np.sin(waves)).sum(axis=1)
    velocity = (0.5 * np.pi * np.cos(waves)).sum(axis=1)
    torque = 6.0 + (3.0 * np.sin(0.8 * waves)).sum(axis=1)
    names = ('LF_HAA', 'LF_HFE', 'LF_KFE')
    data = AlignedDataset.blank(
        RATE,
        names,
        time,
        'made',
        position=position,
        velocity=velocity,
        torque=torque,
        power=torque * velocity,
        voltage=48.0,
    )
    if gap is not None:
        segment = (data.time >= gap).astype(np.int32)
        data = replace(data, time=data.time + 5.0 * segment, segment=segment)
    return prepare(data)


def structure(*names):
    return Structure(tuple(Active.of(CATALOGUE[name]) for name in names))


@pytest.mark.parametrize('gap', [None, 50.0])
def test_pieces_have_the_samples_and_the_power_of_the_whole_recording(gap):
    whole = recorded(gap=gap)
    some = pieces(whole, 40.0)
    assert 30.0 < some.seconds <= 40.0
    where = np.searchsorted(whole.time, some.time)
    assert some.time == pytest.approx(whole.time[where])
    assert np.array_equal(some.power, whole.power[:, where])
    assert np.array_equal(some.signals.torque, whole.signals.torque[some.part.samples])
    product = whole.signals.torque * whole.signals.velocity
    assert some.reduced(product[some.part.samples]) == pytest.approx(whole.reduced(product)[where])
    assert len(some.reducer.slices) == len(some.signals.stretches())
    shown = some.part.everywhere(some.power[0])
    assert np.array_equal(shown[where], some.power[0])
    assert np.isfinite(shown[:, 0]).sum() == len(where)
    assert shown.shape == whole.power[0].shape


def test_pieces_are_spread_over_the_whole_recording():
    whole = recorded()
    some = pieces(whole, 40.0)
    starts = [some.signals.time[part.start] for part in some.signals.stretches()]
    # At 0, 0.618 and 0.236 of the 28 s that each of the three pieces may begin later.
    assert starts == pytest.approx([0.0, 57.3, 86.6], abs=0.1)


def test_a_short_recording_beside_a_long_one_stays_whole():
    whole = recorded(gap=100.0)
    second = (whole.signals.time >= 105.0).astype(np.int32)
    two = replace(
        whole,
        signals=replace(whole.signals, recording=second),
        recording=(whole.time >= 105.0).astype(np.int32),
        recordings=('walk', 'ladder'),
    )
    some = pieces(two, 60.0)
    seconds = [np.sum(some.signals.recording == index) / RATE for index in (0, 1)]
    assert seconds == pytest.approx([36.0, 20.0], abs=0.1)  # three pieces of 12 s, and all


def test_several_recordings_keep_what_tells_their_delays():
    whole = recorded(gap=60.0)
    second = (whole.signals.time >= 65.0).astype(np.int32)
    two = replace(
        whole,
        signals=replace(whole.signals, recording=second),
        recording=(whole.time >= 65.0).astype(np.int32),
    )
    some = pieces(two, 30.0)
    seconds = [np.sum(some.signals.recording == index) / RATE for index in (0, 1)]
    assert seconds == pytest.approx([36.0, 36.0], abs=0.1)


def test_where_power_is_known_for_a_part_of_the_time_as_much_of_it_is_kept():
    whole = recorded()
    power = np.where(whole.time[:, None] < 60.0, whole.power, np.float32(np.nan))
    half = replace(whole, power=power)
    assert pieces(half, 60.0) is half
    known = np.isfinite(pieces(half, 30.0).power[0, :, 0]).sum() / 50.0
    assert known == pytest.approx(30.0, abs=7.0)


def test_a_recording_that_is_short_enough_is_used_whole():
    whole = recorded(seconds=30.0)
    assert pieces(whole, 30.0) is whole


def test_the_winding_remembers_what_lies_between_the_pieces():
    whole = recorded()
    some = pieces(whole, 40.0)
    heating = CATALOGUE['winding_heating']
    before = heating.regressors(whole.signals, time_constant=20.0)
    after = heating.regressors(some.signals, time_constant=20.0)
    assert after == pytest.approx(before[some.part.samples])
    alone = heating.regressors(some.signals.drive(1), time_constant=20.0)
    assert alone[:, 0] == pytest.approx(after[:, 1])


FULL = ('shaft', 'copper_loss', 'coulomb_friction', 'spring', 'winding_heating', 'line_resistance')


@pytest.mark.parametrize('effects', [FULL, (*FULL, 'regeneration_limit')])
def test_designs_made_drive_by_drive_are_those_of_all_drives(effects):
    prepared = recorded(seconds=30.0)
    model = structure(*effects).with_discrepancies()
    random = np.random.default_rng(1)
    point = random.uniform(0.001, 0.01, (3, len(model.labels)))
    alike, apart = DesignBuilder(prepared), ByDriveBuilder(prepared)
    one, other = alike.build(model, point), apart.build(model, point)
    assert other.columns == pytest.approx(one.columns, rel=1e-9, abs=1e-9)
    assert other.constant == pytest.approx(one.constant, rel=1e-9, abs=1e-9)
    assert np.array_equal(other.upper, one.upper)
    beside = [Active.of(CATALOGUE[n]) for n in ('viscous_friction', 'regeneration_efficiency')]
    beside += [Active.of(CATALOGUE['regeneration_limit'])] if len(effects) == len(FULL) else []
    for own, joined in zip(
        alike.beside(beside, model, point), apart.beside(beside, model, point), strict=True
    ):
        assert joined == pytest.approx(own, rel=1e-9, abs=1e-9)


def test_an_effect_that_looks_at_other_drives_gets_the_signals_of_all():
    class Neighbour(Effect):
        name = 'neighbour'
        physics = formula = 'the torque of the drive before'
        terms = CATALOGUE['idle'].terms
        excitation = CATALOGUE['idle'].excitation

        def regressors(self, signals, **shape):
            return np.roll(signals.torque, 1, axis=1)[..., None]

    prepared = recorded(seconds=30.0)
    model = Structure((*structure('shaft', 'copper_loss').actives, Active.of(Neighbour())))
    point = np.full((3, len(model.labels)), 0.01)
    column = ByDriveBuilder(prepared).build(model, point).columns[..., -1]
    assert column == pytest.approx(prepared.reduced(np.roll(prepared.signals.torque, 1, axis=1)))


@pytest.mark.parametrize('limit', [1, None])
def test_results_come_in_the_order_of_the_items_on_any_number_of_threads(limit):
    with threadpool_limits(limits=limit, user_api='blas'):
        assert for_each(lambda item: item * item, range(20)) == [i * i for i in range(20)]


def blas_threads():
    return {one['num_threads'] for one in threadpool_info() if one['user_api'] == 'blas'}


def test_products_have_one_thread_until_the_last_caller_is_done():
    turn = sys.getswitchinterval()
    with threadpool_limits(limits=2, user_api='blas'):
        first, second = one_thread_a_product(), one_thread_a_product()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert blas_threads() == {1}
        both = Barrier(2)  # which one thread alone never passes
        assert for_each(lambda _: both.wait(60) in (0, 1), range(2)) == [True, True]
        assert blas_threads() == {1}
        assert sys.getswitchinterval() == pytest.approx(min(turn, 1e-3))
        second.__exit__(None, None, None)
        assert blas_threads() == {2}
        assert sys.getswitchinterval() == pytest.approx(turn)


def test_work_within_shared_work_is_not_shared_again():
    def inner(_):
        return {get_ident(), *for_each(lambda _: get_ident(), range(3))}

    with threadpool_limits(limits=2, user_api='blas'):
        assert [len(threads) for threads in for_each(inner, range(2))] == [1, 1]


def test_the_error_of_an_item_is_raised():
    with pytest.raises(ZeroDivisionError):
        for_each(lambda item: 1 / item, [1, 0, 2])
