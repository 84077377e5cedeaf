import numpy as np
import pytest
from power_estimator.effects import builtin_catalogue
from power_estimator.effects.fit.design import Active, Structure
from power_estimator.effects.model_file.model import EffectModel
from power_estimator.live.change_watch import ReferenceNoise, WatchConfig
from power_estimator.live.estimator import Status
from power_estimator.live.score import LiveScore, measured_power
from power_estimator.live.session import LiveSession, Vector
from power_estimator.network.ppn import PowerPredictionNetwork
from power_estimator.proxies import Proxy
from wattwalk_core.errors import InputError

START = 1_700_000_000_000_000_000
PERIOD = 2_500_000


@pytest.fixture(scope='module')
def ppn(checkpoint):
    return PowerPredictionNetwork(checkpoint)


def feed(session, data, names, *, samples=400, start=0, since=0):
    """
    Joint states at 400 Hz and commands in the given order of names; returns the estimates.

    since: how many joint states later than in the data they come.
    """
    columns = [data.names.index(name) for name in names]
    found = []
    for index in range(start, start + samples):
        stamp, now = START + (index + since) * PERIOD, (index + since) * PERIOD / 1e9
        row = index // 2
        if index % 2 == 0:
            session.command(Vector(stamp, names, data.command[row][None, columns]), now)
        rows = np.array([s[row, columns] for s in (data.position, data.velocity, data.torque)])
        estimate = session.joint_state(Vector(stamp, names, rows), now)
        found += [] if estimate is None else [estimate]
    return found


def test_the_order_of_names_in_messages_does_not_matter(ppn, drives):
    data = drives(2.0)
    there, back = LiveSession(ppn), LiveSession(ppn)
    one = feed(there, data, ('LF_HAA', 'LF_HFE'))
    two = feed(back, data, ('LF_HFE', 'LF_HAA'))
    assert there.drives == back.drives[::-1] == ('LF_HAA', 'LF_HFE')
    assert np.allclose([e.power for e in one], [e.power[::-1] for e in two], atol=1e-3)


def test_joints_that_the_network_does_not_know_are_left_out(ppn, drives):
    data = drives(1.0, ('gripper', 'LF_HAA'))
    session = LiveSession(ppn)
    assert feed(session, data, data.names)
    assert session.drives == ('LF_HAA',)


def test_a_wanted_drive_that_is_not_there_is_named(ppn, drives):
    data = drives(1.0)
    with pytest.raises(InputError, match="drives names 'RH_KFE', joint_states has LF_HAA, LF_HFE"):
        feed(LiveSession(ppn, wanted=['RH_KFE']), data, data.names)


def test_a_robot_without_a_known_joint_is_refused(ppn, drives):
    data = drives(1.0, ('wheel',))
    with pytest.raises(InputError, match=r'knows none of the joints .*\(wheel\)'):
        feed(LiveSession(ppn), data, data.names)


def test_it_says_what_it_waits_for(ppn, drives):
    data = drives(1.0)
    session = LiveSession(ppn)
    assert session.report(0.0)[:2] == (
        False,
        'waiting for joint_commands: ppn needs position error',
    )
    session.command(Vector(START, data.names, data.command[:1]), 0.0)
    assert session.report(0.1)[:2] == (False, 'waiting for joint_states')
    feed(session, data, data.names)
    assert session.report(1.0)[:2] == (True, 'estimating')


def test_a_model_that_needs_no_targets_estimates_without_joint_commands(drives):
    data = drives(1.0)
    session = LiveSession(Proxy('mechanical_power'))
    assert session.topics == {'joint_states'}
    for row in range(200):
        rows = np.array([s[row] for s in (data.position, data.velocity, data.torque)])
        session.joint_state(Vector(START + 2 * row * PERIOD, data.names, rows), row / 200)
    assert session.report(1.0)[:2] == (True, 'estimating')


def test_it_says_which_effect_waits_for_the_temperature(drives):
    catalogue = builtin_catalogue()
    actives = [Active.of(catalogue[name]) for name in ('shaft', 'winding_heating')]
    model = EffectModel('own', Structure(tuple(actives)))
    session = LiveSession(model)
    assert session.topics == {'joint_states', 'drive_supply'}
    data = drives(1.0)
    rows = np.array([s[0] for s in (data.position, data.velocity, data.torque)])
    session.joint_state(Vector(START, data.names, rows), 0.0)
    said = 'waiting for drive_supply: winding_heating needs temperature'
    assert session.report(0.0)[:2] == (False, said)


def test_some_drives_of_a_model_that_looks_at_all_of_them_are_refused(drives):
    data = drives(1.0)
    limit = Active.of(builtin_catalogue()['regeneration_limit'])
    session = LiveSession(EffectModel('own', Structure((limit,))), wanted=('LF_HAA',))
    with pytest.raises(InputError, match='own: regeneration_limit looks at all drives of the bus'):
        feed(session, data, data.names, samples=1)


def test_it_says_so_when_joint_states_stop(ppn, drives):
    data = drives(1.0)
    session = LiveSession(ppn)
    last = feed(session, data, data.names)[-1]
    assert session.stale(1.05) is None
    stale = session.stale(1.5)
    assert stale.status == Status.INPUT_STALE
    assert stale.stamp == last.stamp
    assert np.isnan(stale.power).all()
    assert np.isnan(stale.total)
    well, sentence, figures = session.report(1.5)
    assert (well, sentence) == (False, 'joint_states have stopped')
    assert figures['age of joint_states'] == '0.50 s'


def test_damping_commands_make_it_say_that_there_are_no_targets(ppn, drives):
    data = drives(2.0)
    session = LiveSession(ppn)
    feed(session, data, data.names)
    session.command(Vector(START + 400 * PERIOD, data.names, np.full((1, 2), np.nan)), 1.0)
    for index in range(400, 500):
        rows = np.zeros((3, 2))
        session.joint_state(Vector(START + index * PERIOD, data.names, rows), index * PERIOD / 1e9)
    assert session.stale(1.25).status == Status.INPUT_STALE
    assert session.report(1.25)[1] == 'joint_commands are stale or have no targets'


def test_messages_without_the_drives_are_counted_and_do_no_harm(ppn, drives):
    data = drives(2.0)
    session = LiveSession(ppn)
    feed(session, data, data.names)
    session.joint_state(Vector(START, ('arm',), np.zeros((3, 1))), 1.0)
    session.command(Vector(START, ('arm',), np.zeros((1, 1))), 1.0)
    assert session.report(1.0)[2]['messages without the drives'] == '2'
    assert feed(session, data, data.names, start=400)[-1].status == Status.OK


def test_figures_count_what_came_since_the_last_report(ppn, drives):
    data = drives(2.0)
    session = LiveSession(ppn)
    feed(session, data, data.names)
    session.sent(0.002)
    figures = session.report(1.0)[2]
    assert figures['joint_states in the last report'] == '400'
    assert figures['power_estimate in the last report'] == '50'
    assert figures['age p99'] == '2.00 ms'
    assert session.report(1.0)[2]['joint_states in the last report'] == '0'


def test_the_live_score_pairs_an_estimate_with_the_mean_over_its_time():
    score = LiveScore(width=0.02)
    rng = np.random.default_rng(0)
    watts = 100 + 30 * rng.standard_normal(60 * 20)
    for index, value in enumerate(watts):
        stamp = START + (index + 1) * 1_000_000
        score.measured(stamp, value)
        if index % 20 == 19:
            score.estimated(stamp, float(watts[index - 19 : index + 1].mean()))
    score.measured(stamp + 1, 0.0)
    assert score.figures()['R² of the sum'] == '1.000 over 30 s'


def test_power_is_unknown_where_the_status_flags_a_sample():
    power = measured_power(2, [48, 50, 48, 50], [1, 2, 3, 4], [0, 0, 2, 0])
    assert np.array_equal(power, [[48, 100], [np.nan, 200]], equal_nan=True)


@pytest.mark.parametrize('status', [[], [0, 0, 0], [0, 0, 0, 0, 0]])
def test_a_supply_message_without_a_status_per_value_is_refused(status):
    with pytest.raises(ValueError, match=f'{len(status)} status values do not fit 2 drives'):
        measured_power(2, [48] * 4, [1] * 4, status)


def test_flagged_samples_do_not_enter_the_live_score(ppn, drives):
    data = drives(3.0)
    live = LiveSession(ppn)
    rng = np.random.default_rng(0)
    for index in range(1200):
        feed(live, data, data.names, samples=1, start=index)
        stamp = START + index * PERIOD + 1
        # Of two samples the second is wrong by a kilowatt and flagged, for one of the drives.
        rows = np.array([rng.normal(100, 30, 2), [1100, 100]])
        rows[1, index % 2] = np.nan
        live.supply(Vector(stamp, data.names, rows))
    figures = live.report(3.0)[2]
    assert abs(float(figures['measured'].split()[0]) - 200) < 10
    assert figures['flagged supply samples left out'] == '1200'


def test_the_live_score_says_nothing_before_a_second_is_over():
    score = LiveScore(width=0.02)
    score.estimated(START, 1.0)
    score.measured(START + 1, 1.0)
    assert score.figures() == {}


def test_a_drive_that_draws_more_than_the_reference_is_named(ppn, drives):
    data = drives(2.0)
    noise = ReferenceNoise(
        0.0, *[(v,) * 4 for v in (0.0, 0.0, -1e9, 1e9)], 0.0, 0.3, 0.0, 1.0, 0.0
    )
    session = LiveSession(
        ppn,
        watch=WatchConfig(false_alarms_per_month=1000.0, block=3),
        reference=dict.fromkeys(data.names, noise),
    )
    found = []
    for start in range(0, 30000, 400):  # s of 400 joint states, the same each second
        for estimate in feed(session, data, data.names, start=start % 400, since=start):
            power = estimate.power.astype(float) + np.where(
                np.array(session.drives) == 'LF_HFE', 2, 0
            )
            times = estimate.stamp - 10_000_000
            session.supply(Vector(times, session.drives, np.tile(power, (4, 1))))
        found += [shift for shift in [session.watched()] if shift]
    assert found
    assert {shift.drive for shift in found} == {'LF_HFE'}
    assert found[0].watts == pytest.approx(2.0, abs=0.1)
    assert session.watch.report()[0] is False
