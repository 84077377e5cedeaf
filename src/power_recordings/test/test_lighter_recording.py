"""Recordings that let go of their samples."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from power_recordings.reading.reader import Recording
from wattwalk_core.errors import InputError

Make = Callable[..., Any]


def test_a_lighter_recording_reads_again_what_it_let_go(walk: Make, tmp_path: Path) -> None:
    recording = Recording.open(walk(2.0).write(tmp_path / 'walk'))
    begin, end = recording.start_ns + 500_000_000, recording.start_ns + 1_500_000_000
    kept = recording.drive_supply()
    light = recording.lighter()
    assert light.whole() is not light
    assert light.joints == recording.joints == kept.names
    assert light.has('drive_supply')
    assert not light.has('supply')
    assert recording.whole() is recording
    for again in (light.drive_supply(), light.whole().drive_supply()):
        np.testing.assert_array_equal(again.power, kept.power)
    part, same = (one.between(begin, end).drive_supply() for one in (light, recording))
    np.testing.assert_array_equal(part.stamp_ns, same.stamp_ns)
    assert light.lighter() is light
    cut = recording.between(begin, end)
    assert cut.lighter() is cut
    walk(3.0).write(tmp_path / 'other')
    shutil.rmtree(tmp_path / 'walk')
    (tmp_path / 'other').rename(tmp_path / 'walk')
    with pytest.raises(InputError, match='has changed'):
        light.drive_supply()
    shutil.rmtree(tmp_path / 'walk')
    assert light.joints == kept.names
    with pytest.raises(InputError, match='walk'):
        light.drive_supply()
