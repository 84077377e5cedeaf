import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from power_estimator.training.protocol import Part, Protocol, runs
from wattwalk_core.errors import InputError

layouts = st.tuples(
    st.integers(1, 4),  # segments of the protocol
    st.integers(1, 10),  # folds
    st.integers(0, 30),  # margin
    st.lists(st.tuples(st.integers(1, 700), st.booleans()), min_size=1, max_size=6),
)


def recording(pieces):
    """Segment numbers; a piece that was not measured is below zero."""
    return np.concatenate(
        [np.full(length, index if there else -1) for index, (length, there) in enumerate(pieces)]
    )


def split(layout):
    segments, folds, margin, pieces = layout
    protocol = Protocol(segments, folds, margin)
    segment = recording([*pieces, (protocol.minimum(), True)])
    return protocol, segment, [protocol.labels(segment, fold) for fold in range(folds)]


@settings(max_examples=80, deadline=None)
@given(layouts)
def test_no_window_of_the_history_holds_samples_of_two_sets(layout):
    protocol, segment, folds = split(layout)
    rank = np.cumsum(segment >= 0)
    for labels in folds:
        used = np.flatnonzero(labels != Part.UNUSED)
        change = np.flatnonzero(np.diff(labels[used]))
        between = rank[used[change + 1]] - rank[used[change]] - 1
        assert len(between) >= 2
        assert (between >= protocol.margin).all()


@settings(max_examples=80, deadline=None)
@given(layouts)
def test_the_parts_are_80_10_10_but_for_margins_and_no_sample_is_tested_twice(layout):
    protocol, segment, folds = split(layout)
    usable = np.count_nonzero(segment >= 0)
    tenth = usable / 10
    slack = protocol.segments * (2 * protocol.margin + 2)
    for labels in folds:
        counts = {part: np.count_nonzero(labels == part) for part in Part}
        assert tenth - slack <= counts[Part.TEST] <= tenth + protocol.segments
        assert tenth - slack <= counts[Part.VALIDATION] <= tenth + protocol.segments
        assert 8 * tenth - 2 * slack <= counts[Part.TRAIN] <= 8 * tenth + protocol.segments
    tested = np.sum([labels == Part.TEST for labels in folds], axis=0)
    assert tested.max() == 1


@settings(max_examples=50, deadline=None)
@given(layouts)
def test_what_was_not_measured_is_in_no_set_and_runs_stay_in_their_segment(layout):
    _, segment, folds = split(layout)
    for labels in folds:
        assert (labels[segment < 0] == Part.UNUSED).all()
        for part in (Part.TRAIN, Part.VALIDATION, Part.TEST):
            for run in runs(labels, segment, part, 3):
                assert run.stop - run.start >= 3
                assert len(set(segment[run].tolist())) == 1
                assert (labels[run] == part).all()


def test_fold_zero_tests_on_the_last_tenth_of_each_segment_and_validates_on_the_one_before():
    labels = Protocol(segments=2, folds=6, margin=0).labels(np.zeros(200, int), 0)
    expected = ([Part.TRAIN] * 80 + [Part.VALIDATION] * 10 + [Part.TEST] * 10) * 2
    assert labels.tolist() == expected


def test_a_window_that_ends_in_a_set_begins_in_it():
    protocol = Protocol(segments=6, folds=6, margin=60)
    segment = np.zeros(protocol.minimum(), int)
    labels = protocol.labels(segment, 2)
    seen = {part: set() for part in (Part.TRAIN, Part.VALIDATION, Part.TEST)}
    for part, samples in seen.items():
        for run in runs(labels, segment, part, 60):
            samples.update(range(run.start, run.stop))
    assert not seen[Part.TRAIN] & seen[Part.TEST]
    assert not seen[Part.TRAIN] & seen[Part.VALIDATION]
    assert not seen[Part.VALIDATION] & seen[Part.TEST]
    assert all(seen.values())


def test_too_few_samples_are_refused_with_the_number_that_is_needed():
    with pytest.raises(InputError, match=r'7199 samples are too few.*at least 7200'):
        Protocol().labels(np.zeros(7199, int), 0)


@pytest.mark.parametrize('bad', [{'folds': 0}, {'folds': 11}, {'segments': 0}, {'margin': -1}])
def test_settings_out_of_range_are_refused_with_value_and_range(bad):
    (name, value), *_ = bad.items()
    with pytest.raises(InputError, match=f'{name}: expected .*, there is {value}'):
        Protocol(**bad)
