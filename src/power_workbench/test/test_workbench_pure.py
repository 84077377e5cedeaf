"""Parts of the workbench without a server: sessions, pyramids, ranges of state."""

import os
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from power_lab.challenge.bench_recording import record_on_bench, shortened
from power_lab.diagnose.next_recording import Motion
from power_recordings.reading.reader import Recording
from power_workbench.files.folders import Folders
from power_workbench.files.logs import misplaced
from power_workbench.sessions.source import SeenModels, Source
from power_workbench.sessions.steps import SessionRecord, SessionStep
from power_workbench.views import maps, moments
from power_workbench.views.pyramid import Pyramid, extremes
from power_workbench.views.view import PowerView, StateWords
from wattwalk_core.errors import InputError

OPEN = SessionStep('open', recordings=('bags/walk',), sha256=('a1',))
FIT = SessionStep('fit', effects=('shaft', 'idle'), model='model_1.yaml', rmse_w={'A': 2.0})
ADD = SessionStep('add', effects=('load_friction',), model='model_2.yaml', rmse_w={'A': 1.0})


def test_a_session_is_the_same_after_it_was_written_and_read(tmp_path):
    session = SessionRecord().do(OPEN).do(FIT).do(ADD).go(2)
    session.save(tmp_path)
    assert SessionRecord.read(tmp_path) == session
    assert yaml.safe_load((tmp_path / 'session.yaml').read_text())['at'] == 2


def test_undo_and_redo_move_through_the_history_and_a_new_step_forgets_what_was_undone(tmp_path):
    session = SessionRecord().do(OPEN).do(FIT).do(ADD)
    assert session.spec(tmp_path) == str(tmp_path / 'model_2.yaml')
    back = session.go(2)
    assert back.spec(tmp_path) == str(tmp_path / 'model_1.yaml')
    assert back.go(3) == session
    other = back.do(SessionStep('remove', effects=('idle',)))
    assert [step.kind for step in other.steps] == ['open', 'fit', 'remove']
    for place in (-1, 4):
        with pytest.raises(InputError, match='history'):
            other.go(place)


def test_no_two_steps_write_the_same_model():
    session = SessionRecord().do(OPEN)
    names = []
    for _ in range(3):
        names.append(session.next_model())
        session = session.do(SessionStep('fit', effects=('shaft',), model=names[-1])).go(1)
    session = session.go(2)
    assert session.next_model() not in {step.model for step in session.steps}


def test_a_first_look_does_not_take_the_place_of_a_whole_budget():
    seen, keys = SeenModels(), [(Source(('walk',)), f'{number}.yaml') for number in range(4)]
    for key in keys:
        seen.keep_budget(key, {'first': True, 'key': key})
        seen.keep_budget(key, {'key': key})
    seen.keep_budget(keys[0], {'first': True})
    assert list(seen.budgets.values()) == [{'key': key} for key in [*keys[1:], keys[0]]]


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('format: workbench_session/1\nat: 3\nsteps: []\n', '3 of 0'),
        ('format: other\n', 'workbench_session/1'),
        ('steps: [{kind: fit}]\nat: 1\n', 'needs effects'),
        ('steps: [{kind: load, file: a.yaml, model: ../../x.yaml}]\nat: 1\n', 'beside'),
        ('steps: [{kind: run, file: a}]\nat: 1\n', 'kind'),
    ],
)
def test_a_session_that_is_none_is_refused_in_one_line(tmp_path, text, said):
    file = tmp_path / 'session.yaml'
    file.write_text(text)
    with pytest.raises(InputError, match=said) as error:
        SessionRecord.read(file)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('start', 'stop', 'most'), [(0, 40_000, 500), (17, 30_011, 90), (5, 9, 9)]
)
def test_extremes_of_a_span_are_those_of_all_its_samples(start, stop, most):
    values = np.random.default_rng(1).normal(size=(40_000, 2)).astype(np.float32)
    values[1000:1400] = np.nan
    span = Pyramid(values).span(start, stop, most)
    assert len(span.low) <= 2 * most + 2
    for block in range(len(span.low)):
        own = values[span.start + block * span.step : span.start + (block + 1) * span.step]
        known = own[np.isfinite(own[:, 0])]
        if len(known):
            assert span.low[block].tolist() == known.min(axis=0).tolist()
            assert span.high[block].tolist() == known.max(axis=0).tolist()
        else:
            assert np.isnan(span.low[block]).all()
    assert span.start <= start
    assert span.start + span.step * len(span.low) >= stop


def test_extremes_of_marked_rows_are_of_these_alone():
    values = np.arange(10, dtype=np.float32)[:, None]
    values[~np.isin(np.arange(10), (2, 3, 8))] = np.nan
    span = extremes(values, 0, 10, 5)
    assert span.step == 2
    assert span.low[:, 0].tolist()[1] == 2.0
    assert span.high[:, 0].tolist()[1] == 3.0
    assert np.isnan(span.low[:, 0]).tolist() == [True, False, True, True, False]


def view(error, torque, velocity):
    """One drive at 50 Hz; error is estimate − measured."""
    error, torque, velocity = (np.array(x, np.float32)[:, None] for x in (error, torque, velocity))
    return PowerView(
        meters=('A',),
        drives=('A',),
        recordings=('walk',),
        slots=np.arange(len(error)),
        recording=np.zeros(len(error), np.int32),
        measured=np.full_like(error, 10.0),
        residual=-error,
        state={'torque': torque, 'velocity': velocity},
        words={},
        noise=np.array([0.1], np.float32),
        still=(0.1,),
        content={'drives': {}},
        model=None,
    )


def test_a_box_chooses_the_rows_inside_and_tells_the_error_inside_and_outside():
    shown = view([3, 3, 0, 0, 1, 1], [5, 5, 5, 20, 20, 20], [1, 2, 9, 1, 1, 1])
    found = maps.in_box(shown, 'A', {'torque': (0, 10), 'velocity': (0, 5)})
    assert found.rows.tolist() == [True, True, False, False, False, False]
    assert found.content['bias_w'] == pytest.approx(3.0)
    assert found.content['rmse_w'] == pytest.approx(3.0)
    assert found.content['rmse_outside_w'] == pytest.approx(np.sqrt(0.5), rel=1e-4)
    assert found.content['share'] == pytest.approx(0.9)
    assert found.content['sentence'].startswith('A, torque 0 to 10 N·m, velocity 0 to 5 rad/s: ')
    assert '3 W too high' in found.content['sentence']


def test_a_regime_chooses_driving_braking_and_rest_and_an_open_range_has_no_end():
    shown = view([1] * 6, [100, -100, 100, 5, 100, -100], [1, 1, -1, 1, 0.05, -1])
    bounds = {'torque': [20.0, 80.0], 'speed': [0.3, 3.0]}

    def rows(words, bounds=bounds):
        regime = {'drive': 'A', 'conditions': words, 'bounds': bounds}
        return np.flatnonzero(maps.in_regime(shown, regime).rows).tolist()

    assert rows(['driving', 'above 20 N·m', '0.3 to 3 rad/s']) == [0, 5]
    assert rows(['braking', 'above 20 N·m', '0.3 to 3 rad/s']) == [1, 2]
    assert rows(['at rest', 'above 20 N·m'], {'torque': [20.0, 80.0]}) == [4]
    assert rows(['driving', '20 to 80 N·m', '0.3 to 3 rad/s']) == []


def test_words_mark_the_rows_that_have_them_and_no_others():
    words = StateWords.of(np.array([['stance', 'swing'], ['swing', 'swing'], ['', 'stance']]))
    assert words.texts == ('stance', 'swing', '')
    assert words.places.tolist() == [[0, 1], [1, 1], [2, 0]]
    assert words.rows('swing', 0).tolist() == [False, True, False]
    assert words.rows('swing', 1).tolist() == [True, True, False]
    assert not words.rows('flight', 1).any()
    assert StateWords.of(np.zeros((0, 2), '<U6')).texts == ()


def test_a_regime_of_a_phase_chooses_the_rows_of_that_phase_alone():
    words = {'phase': StateWords.of(np.array([['stance'], ['swing'], ['swing']]))}
    shown = replace(view([1] * 3, [1] * 3, [1] * 3), words=words)
    regime = {'drive': 'A', 'conditions': ['swing'], 'bounds': {}}
    assert maps.in_regime(shown, regime).rows.tolist() == [False, True, True]


def test_a_span_chooses_the_rows_of_its_seconds():
    shown = view([0] * 100, [1] * 100, [1] * 100)
    found = maps.in_span(shown, 'A', 1.0, 0.5)
    assert np.flatnonzero(found.rows).tolist() == list(range(25, 51))


def test_unknown_names_of_drives_and_quantities_are_refused():
    shown = view([0] * 6, [1] * 6, [1] * 6)
    with pytest.raises(InputError, match='no drive'):
        maps.error_map(shown, 'B', 'torque', 'velocity')
    with pytest.raises(InputError, match='no quantity'):
        maps.in_box(shown, 'A', {'colour': (0, 1)})


def test_only_what_lies_in_a_named_folder_is_found(tmp_path):
    inside, outside = tmp_path / 'bags', tmp_path / 'secret'
    (inside / 'walk').mkdir(parents=True)
    outside.mkdir()
    (inside / 'walk' / 'walk.mcap').touch()
    (outside / 'other.mcap').touch()
    (inside / 'link').symlink_to(outside)
    folders = Folders.of([inside])
    assert [one['name'] for one in folders.recordings()] == ['walk']
    assert folders.within(str(inside / 'walk')) == (inside / 'walk').resolve()
    for given in (
        inside / '..' / 'secret',
        inside / 'link' / 'other.mcap',
        outside,
        '/etc/passwd',
        f'{inside}\0',
        '',
    ):
        with pytest.raises(InputError, match='not in a folder'):
            folders.within(str(given))


def test_the_list_of_recordings_comes_from_the_index_until_a_recording_changes(
    tmp_path, monkeypatch
):
    bag = tmp_path / 'bags' / 'walk'
    bag.mkdir(parents=True)
    (bag / 'walk.mcap').touch()
    card = bag / 'card.yaml'
    card.write_text('robot: hopper\n')
    folders = Folders.of([tmp_path / 'bags'])
    monkeypatch.setenv('WATTWALK_INDEX', str(tmp_path / 'index.sqlite3'))
    first = folders.recordings()
    dates = card.stat().st_atime_ns, card.stat().st_mtime_ns
    assert first[0]['robot'] == 'hopper'
    card.write_text('robot: walker\n')
    os.utime(card, ns=dates)
    assert folders.recordings() == first  # of the same size and date: not read
    os.utime(card, ns=(dates[0], dates[1] + 1))
    assert folders.recordings()[0]['robot'] == 'walker'
    card.write_text('robot: [\n')
    assert 'problem' in folders.recordings()[0]
    (tmp_path / 'index.sqlite3').write_text('something else')
    card.write_text('robot: hopper\n')
    assert folders.recordings() == first


def test_a_motion_is_cut_by_one_factor_and_waves_keep_a_period():
    segments = (
        {'mode': 'rest', 'seconds': 1000.0},
        {'mode': 'velocity', 'speed': 2.0, 'load': 1.0, 'seconds': 500.0},
        {'mode': 'position', 'frequency': 0.01, 'amplitude': 0.3, 'seconds': 300.0},
        {'mode': 'velocity', 'speed': -2.0, 'load': 1.0, 'seconds': 2.0},
    )
    cut = shortened(Motion('to see', ('LF_KFE',), segments), 180.2)
    assert [segment['seconds'] for segment in cut.segments] == [100.0, 50.0, 100.0, 1.0]
    assert cut.segments[1]['speed'] == 2.0
    assert shortened(cut, 1e6) == cut


def test_the_bench_records_a_motion_that_was_cut_and_tells_how_long_it_takes(tmp_path):
    segments = (
        {'mode': 'velocity', 'speed': 1.0, 'load': 1.0, 'seconds': 40.0},
        {'mode': 'rest', 'seconds': 60.0},
    )
    motion, said = Motion('to see', ('LF_KFE',), segments), []
    files = (tmp_path / 'next.yaml', tmp_path / 'next')
    record_on_bench(shortened(motion, 10.0), 'LF_KFE', *files, None, said.append)
    recording = Recording.open(tmp_path / 'next')
    assert recording.duration == pytest.approx(10.0, abs=0.2)
    assert recording.drive_supply().names == ('LF_KFE',)
    (sentence,) = said
    assert re.fullmatch(r'recording 10 s of LF_KFE .* takes about \d+ (s|min)', sentence)


def test_the_map_tells_mean_rms_and_time_of_a_cell_apart():
    speed = [0.0, 1.0] * 40
    error = [1.0, 2.0, -1.0, 2.0] * 20  # cancels at rest, 2 W at 1 rad/s
    shown = view(error, [0.0, 1.0] * 40, speed)
    found = maps.error_map(shown, 'A', 'velocity', 'torque')
    cells = {name: [v for row in found[name] for v in row if v] for name in ('rms', 'seconds')}
    assert cells['rms'] == [1.0, 2.0]
    assert cells['seconds'] == pytest.approx([0.8, 0.8])
    assert [abs(v) for row in found['mean'] for v in row if v is not None] == [0.0, 2.0]


def test_spikes_are_counted_and_said_to_be_of_no_state_where_the_state_recurs_without_them():
    error = [0.1, -0.1] * 500
    for at in (100, 300, 500, 700, 900):
        error[at] = 6.0
    found = moments.moments(view(error, [0.0, 1.0] * 500, [0.0, 1.0] * 500), 'A')
    assert found['spikes'].startswith('5 spikes of 6 to 6 W, most of them 20 ms long, hold 95%')
    assert 'no effect of the state claims them' in found['spikes']
    still = moments.moments(view([0.1, -0.1] * 100, [0.0] * 200, [0.0, 1.0] * 100), 'A')
    assert still == {'spikes': '', 'stretches': []}


def test_a_second_far_worse_than_the_rest_is_told_with_its_share():
    error = [0.1, -0.1] * 250 + [3.0, -3.0] * 25 + [0.1, -0.1] * 250
    found = moments.moments(view(error, [0.0] * 1050, [0.0, 1.0] * 525), 'A')
    (stretch,) = found['stretches']
    assert (stretch['start'], stretch['stop']) == (10.0, 11.0)
    assert stretch['words'] == '10 to 11 s: 3 W rms, 30 times the usual, 98% of the squared error'


@pytest.mark.parametrize(
    ('hint', 'fix'),
    [
        ('9 of 10 rows repeat the time of the row before; give the rate: time: {rate: 99.5}',
         {'key': 'rate', 'value': 99.5}),
        ('times in s make 0.1 rows a second; time: {unit: ms}', {'key': 'unit', 'value': 'ms'}),
        ('times reach 1e+12 s; is that their unit?', None),
    ],
)  # fmt: skip
def test_an_error_of_the_time_carries_what_would_mend_it(hint, fix):
    found = misplaced(InputError(f'log.csv: {hint}'))
    assert found['place'] == 'time'
    assert found['fix'] == fix
