"""The cache of the workbench gives what is read of a recording, or nothing."""

import os
import resource
import shutil
from contextlib import contextmanager

import numpy as np
import pytest
from power_estimator.effects.fit.design import Active
from power_estimator.judge.judge import Judge
from power_lab.compare.fitting import fitted
from power_recordings.reading.reader import Recording
from power_workbench.sessions.jobs import SessionJob
from power_workbench.sessions.opened_cache import ArrayFile, DamagedFileError, OpenedCache
from power_workbench.sessions.session import WorkbenchSession
from power_workbench.sessions.source import Source
from power_workbench.sessions.steps import SessionRecord, SessionStep
from power_workbench.sessions.worker import SessionWorker
from power_workbench.views import coarse
from power_workbench.views.coarse import coarse_view


@contextmanager
def largest_file(size):
    """No file may grow beyond size bytes, as on a disk that is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope='module')
def opened(bag, tmp_path_factory):
    """A cache in which a recording was kept, and what its reader showed."""
    folder = tmp_path_factory.mktemp('cache')
    source, shown = Source((str(bag),)), []
    result = SessionWorker(OpenedCache(folder)).open(lambda *one: shown.append(one), source, '')
    return folder, source, result, shown


def progress(shown):
    return [content for kind, content in shown if kind == 'progress']


def same(one, other):
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], err_msg=name)


def test_arrays_come_back_from_their_file_as_they_were(tmp_path):
    arrays = {
        'a': np.arange(6, dtype=np.float32).reshape(2, 3),
        'empty': np.zeros((0, 4), np.int64),
        'turned': np.arange(6, dtype=np.float64).reshape(2, 3).T,
    }
    ArrayFile(arrays, {'names': ['x']}).write(tmp_path / 'one')
    found = ArrayFile.read(tmp_path / 'one')
    same(found.arrays, arrays)
    assert found.about == {'names': ['x']}
    assert [path.name for path in tmp_path.iterdir()] == ['one']


def test_a_file_of_arrays_is_refused_whatever_byte_is_lost_or_changed(tmp_path):
    path = tmp_path / 'one'
    ArrayFile({'a': np.arange(40, dtype=np.int32)}, {}).write(path)
    whole = path.read_bytes()
    used = len(whole) - 32  # the last bytes fill up 64
    rng = np.random.default_rng(1)
    for place in [0, *rng.integers(1, used, 60).tolist()]:
        path.write_bytes(whole[:place])
        with pytest.raises(DamagedFileError):
            ArrayFile.read(path)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        with pytest.raises(DamagedFileError):
            ArrayFile.read(path)


def test_a_second_opening_shows_the_same_without_reading_the_recording(opened):
    folder, source, first, shown = opened
    assert 'reading the recordings' in progress(shown)
    again = []
    second = SessionWorker(OpenedCache(folder)).open(lambda *one: again.append(one), source, '')
    assert progress(again) == []
    assert second['recordings'] == first['recordings']
    assert second['sha256'] == first['sha256']
    before, after = first['view'], second['view']
    for name in ('slots', 'recording', 'measured', 'noise'):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    same(after.state, before.state)
    assert before.words.keys() == after.words.keys() == {'phase'}
    assert before.words['phase'].texts == after.words['phase'].texts
    np.testing.assert_array_equal(before.words['phase'].places, after.words['phase'].places)
    assert (after.meters, after.drives, after.still) == (
        before.meters,
        before.drives,
        before.still,
    )


def test_a_fit_on_kept_signals_has_the_coefficients_of_a_fit_on_the_recording(opened):
    folder, source, _, _ = opened
    catalogue = source.catalogue()
    models = []
    for cache in (None, OpenedCache(folder)):
        work, shown = SessionWorker(cache), []
        loaded = work._load(lambda *one, to=shown: to.append(one), source)
        assert bool(progress(shown)) == (cache is None)
        actives = [Active.of(catalogue[name]) for name in ('shaft', 'copper_loss', 'idle')]
        model = fitted(Judge(loaded, catalogue), actives, 'm')
        models.append(model)
        assert loaded.smooth.rate == 200.0
        assert [recording.path.name for recording in loaded.recordings] == ['walk']
    assert models[0].groups == models[1].groups


def test_what_was_kept_of_a_recording_that_changed_is_not_used(opened, bag, tmp_path):
    own = tmp_path / 'walk'
    shutil.copytree(bag, own)
    source, cache = Source((str(own),)), OpenedCache(tmp_path / 'cache')
    SessionWorker(cache).open(lambda *_: None, source, '')
    key = cache.key(source)
    assert cache.opening(key) is not None
    card = (own / 'card.yaml').read_text()
    (own / 'card.yaml').write_text(card.replace('notes: simulated', 'notes: hot day'))
    assert cache.key(source) != key
    shown = []
    result = SessionWorker(cache).open(lambda *one: shown.append(one), source, '')
    assert 'reading the recordings' in progress(shown)
    assert result['recordings'][0]['card']['notes'] == 'hot day'
    others = (Source((str(own),), drives=('LF_HFE',)), Source((str(own),), slow=True))
    assert len({cache.key(one) for one in (source, *others)}) == 3


def test_a_broken_file_of_the_cache_is_ignored_and_made_anew(opened, tmp_path):
    folder, source, first, _ = opened
    own = tmp_path / 'cache'
    shutil.copytree(folder, own)
    for path in own.iterdir():
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    shown = []
    result = SessionWorker(OpenedCache(own)).open(lambda *one: shown.append(one), source, '')
    assert 'reading the recordings' in progress(shown)
    np.testing.assert_array_equal(result['view'].measured, first['view'].measured)
    cache = OpenedCache(own)
    assert cache.opening(cache.key(source)) is not None
    assert cache.loaded(cache.key(source)) is not None


def test_a_full_disk_costs_what_would_be_kept_and_no_more(opened, tmp_path):
    _, source, first, _ = opened
    with largest_file(100_000):
        result = SessionWorker(OpenedCache(tmp_path / 'a')).open(lambda *_: None, source, '')
    np.testing.assert_array_equal(result['view'].measured, first['view'].measured)
    assert list((tmp_path / 'a').iterdir()) == []
    scarce = OpenedCache(tmp_path / 'b', room=1 << 60)
    SessionWorker(scarce).open(lambda *_: None, source, '')
    assert list((tmp_path / 'b').iterdir()) == []
    (tmp_path / 'c').write_text('in the way')
    SessionWorker(OpenedCache(tmp_path / 'c' / 'd')).open(lambda *_: None, source, '')


def test_files_that_were_used_longest_ago_give_way(opened, tmp_path):
    _, source, _, _ = opened
    cache = OpenedCache(tmp_path)
    work = SessionWorker(cache)
    kept = work._read(lambda *_: None, source, 'a' * 32)
    (size,) = (path.stat().st_size for path in tmp_path.glob('a*.view'))
    for path in tmp_path.iterdir():
        path.unlink()
    small = OpenedCache(tmp_path, most=round(2.5 * size), room=0)
    for age, key in enumerate('abc'):
        small.keep_opening(key, kept)
        if key != 'c':
            os.utime(tmp_path / f'{key}.view', (1000.0 + age, 1000.0 + age))
        if key == 'b':
            assert small.opening('a') is not None  # used last
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a.view', 'c.view']
    OpenedCache(tmp_path, most=size // 2).keep_opening('d', kept)
    assert small.opening('d') is None


def test_a_desk_shows_kept_recordings_without_its_worker(opened, tmp_path):
    folder, source, first, _ = opened
    session = WorkbenchSession(tmp_path, SessionRecord(), lambda: None, cache=OpenedCache(folder))
    try:
        session.take(SessionStep('open', recordings=source.recordings))
        assert session.runner.job is None
        assert session.record.opened.sha256 == tuple(first['sha256'])
        np.testing.assert_array_equal(session.view.measured, first['view'].measured)
        assert session.recordings == first['recordings']
    finally:
        session.close()


def test_the_first_look_is_the_power_of_a_part_of_the_recording(bag, monkeypatch):
    assert coarse_view([str(bag)], ()) is None  # read soon enough
    size = sum(path.stat().st_size for path in bag.glob('*.mcap'))
    monkeypatch.setattr(coarse, '_SMALL', size // 4)
    view = coarse_view([str(bag), str(bag)], ('LF_KFE',))
    assert view.meters == ('LF_KFE',)
    assert view.share < 0.2
    assert view.worst == (0.0, view.seconds)
    recording = Recording.open(bag)
    samples = recording.drive_supply()
    power = samples.power[:, samples.names.index('LF_KFE')].astype(np.float64)
    slot = ((samples.stamp_ns - recording.start_ns) // 20_000_000).astype(int)
    means = np.bincount(slot, power) / np.maximum(np.bincount(slot), 1)
    # A row at the edge of a chunk has not all of its samples.
    first = view.recording == 0
    inner = np.flatnonzero(np.diff(view.slots[first], n=2) == 0) + 1
    assert 0.02 * len(means) < len(inner) < 0.3 * len(means)
    np.testing.assert_allclose(
        view.measured[first][inner, 0], means[view.slots[first][inner]], rtol=1e-4
    )
    assert view.slots[~first].min() > view.slots[first].max()
    assert coarse_view([str(bag), '/no/such/bag'], ()) is None


def test_a_part_of_the_chunks_has_samples_of_the_whole_and_no_others(bag):
    whole, part = Recording.open(bag), Recording.open(bag, every=5)
    for topic in ('drive_supply', 'joint_states'):
        every, some = (getattr(recording, topic)() for recording in (whole, part))
        assert 0.1 * len(every) < len(some) < 0.4 * len(every)
        rows = np.searchsorted(every.stamp_ns, some.stamp_ns)
        np.testing.assert_array_equal(every.stamp_ns[rows], some.stamp_ns)
    assert part.problems == whole.problems == ()


def test_opening_shows_a_part_first_and_then_the_whole(bag, monkeypatch):
    size = sum(path.stat().st_size for path in bag.glob('*.mcap'))
    monkeypatch.setattr(coarse, '_SMALL', size // 4)
    shown = []
    result = SessionWorker().open(lambda *one: shown.append(one), Source((str(bag),)), '')
    part, whole = (content for kind, content in shown if kind == 'view')
    assert part.share < 1.0 == whole.share
    assert len(part.slots) < 0.3 * len(whole.slots)
    assert whole is result['view']


def test_a_first_look_goes_where_the_recording_is_refused(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(coarse, '_SMALL', 100_000)
    session = WorkbenchSession(tmp_path, SessionRecord(), lambda: None)
    job = SessionJob('Opening', error='its units contradict each other')
    session._heard(job, 'view', coarse_view([str(bag)], ()))
    assert session.view.share < 1.0
    session._heard(job, 'error', job.error)
    assert (session.view, session.error) == (None, job.error)
