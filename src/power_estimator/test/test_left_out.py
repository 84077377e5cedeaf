"""Seconds of a recording that are left out of all judgement."""

import numpy as np
import pytest
from power_estimator.judge.recordings import LeftOut, spans_of, without
from power_recordings.alignment.dataset import AlignedDataset
from wattwalk_core.errors import InputError


def test_the_power_of_the_seconds_is_unknown_and_all_else_is_as_it_was():
    data = AlignedDataset.blank(10.0, ['A'], 100.0 + np.arange(50) / 10, 'walk', power=7, torque=1)
    cut = without(data, spans_of(['1:2,4:9']))
    assert np.flatnonzero(np.isnan(cut.power[:, 0])).tolist() == [*range(10, 20), *range(40, 50)]
    assert (cut.torque == 1).all()
    assert (data.power == 7).all()


def test_a_span_names_its_recording_and_is_written_as_it_is_read():
    assert spans_of(['12.5:14', '2@0:3']) == (LeftOut(0, 12.5, 14), LeftOut(1, 0, 3))
    assert [str(one) for one in spans_of(['12.5:14,2@0:3'])] == ['12.5:14', '2@0:3']


@pytest.mark.parametrize('text', ['', '3', '5:4', '0@1:2', 'a:b', '1:2:3', '-1:2', '1e3:2e3'])
def test_what_is_no_span_is_refused_with_an_example(text):
    with pytest.raises(InputError, match=r'as 12\.5:14'):
        spans_of([text])


def test_seconds_that_are_not_there_and_operating_points_are_refused():
    data = AlignedDataset.blank(10.0, ['A'], np.arange(50) / 10, 'walk', power=7)
    with pytest.raises(InputError, match='no such seconds'):
        without(data, spans_of(['60:61']))
    with pytest.raises(InputError, match='no such seconds'):
        without(data, spans_of(['2@1:2']))
