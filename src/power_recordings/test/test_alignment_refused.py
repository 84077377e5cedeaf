"""Recordings and rates that cannot be aligned are refused, with their names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_walk import START, aligned
from wattwalk_core.errors import InputError

Make = Callable[..., Any]


def break_it(sketch: Any, how: str) -> None:
    if how == 'degrees':
        swing = 0.05 * np.sin(np.arange(len(sketch.position)) / 20)
        sketch.position[:, 1] = np.rad2deg(0.8 + swing)
    elif how == 'milliamperes':
        sketch.current[:, 2] = 2000
    elif how == 'millivolts':
        sketch.voltage[:, 0] = 48_000
    elif how == 'nan effort':
        sketch.effort[:, 0] = np.nan
    elif how == 'nan current':
        sketch.current[:] = np.nan
    elif how == 'constant stamps':
        sketch.joint_stamps[:] = START
    elif how == 'zero stamps':
        sketch.supply_stamps[:] = 0
    elif how == 'no joints':
        sketch.left_out = ('/joint_states',)
    elif how == 'no supply':
        sketch.left_out = ('/drive_supply',)
    elif how == 'other clock':
        sketch.supply_stamps -= START
    elif how == 'few':
        sketch.drop_joints(slice(3, None))


@pytest.mark.parametrize(
    ('how', 'error'),
    [
        ('degrees', r'joint_states\.position of LF_HFE reaches 48\.7.*degrees\? expected rad'),
        ('milliamperes', r'drive_supply\.current of LF_KFE reaches 2000: mA\? expected A'),
        ('millivolts', r'drive_supply\.voltage of LF_HAA reaches 4\.8e\+04: mV\? expected V'),
        ('nan effort', r'joint_states\.effort of LF_HAA is NaN or missing in 100%'),
        ('nan current', r'drive_supply has a bad status or NaN in most samples of all drives'),
        ('constant stamps', r'joint_states has only 1 samples.*all 400 messages have the same'),
        (
            'zero stamps',
            r'drive_supply has only 1 samples.*all 1000 messages have the same stamp 0',
        ),
        ('no joints', r"no messages on topic 'joint_states'; there are: /drive_supply"),
        ('no supply', r"no messages on topic 'drive_supply'; there are: /joint_commands"),
        ('other clock', r'do not overlap.*one clock'),
        ('few', r'joint_states has only 3 samples'),
    ],
)
def test_what_cannot_be_aligned_is_an_error_that_names_recording_and_field(
    walk: Make, tmp_path: Path, how: str, error: str
) -> None:
    sketch = walk(1.0)
    break_it(sketch, how)
    with pytest.raises(InputError, match=error) as caught:
        aligned(sketch, tmp_path)
    assert str(tmp_path / 'walk') in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_recording_too_short_for_the_filters_is_an_error(walk: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'nothing is left of 0\.10 s.*longer than the 0\.13 s'):
        aligned(walk(0.1), tmp_path)


def test_other_rates_are_refused(walk: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='rate is 123 Hz; it is one of 400, 200, 100, 50'):
        aligned(walk(0.2), tmp_path, rate=123.0)
