"""Sound levels: figures that can be checked by hand, files that are not as they should be."""

import json
import re
import tracemalloc

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from sound_levels.commands.arguments import sound as main
from sound_levels.commands.sound import entries_of
from sound_levels.levels.analysis import analyse, read_tone
from sound_levels.levels.meter import Sound, measure, reach, response, sections
from sound_levels.levels.settings import Entry, Settings
from sound_levels.levels.sound_file import SoundFile
from sound_levels.levels.statistics import FIGURES, Stretch, block_length, differences, levels
from wattwalk_core.errors import InputError

# IEC 61672-1, by nominal frequency: A, C in dB.
TABLE = {
    31.5: (-39.4, -3.0),
    63.0: (-26.2, -0.8),
    100.0: (-19.1, -0.3),
    125.0: (-16.1, -0.2),
    200.0: (-10.9, 0.0),
    250.0: (-8.6, 0.0),
    500.0: (-3.2, 0.0),
    1000.0: (0.0, 0.0),
    2000.0: (1.2, -0.2),
    4000.0: (1.0, -0.8),
    8000.0: (-1.1, -3.0),
    10000.0: (-2.5, -4.4),
    12500.0: (-4.3, -6.2),
    16000.0: (-6.6, -8.5),
    20000.0: (-9.3, -11.2),
}
# Acceptance limits of class 1 in dB (low, high) where they are not ±1.0.
LIMITS = {
    31.5: (-1.5, 1.5),
    1000.0: (-0.7, 0.7),
    8000.0: (-2.5, 1.5),
    10000.0: (-3.0, 2.0),
    12500.0: (-5.0, 2.0),
    16000.0: (-16.0, 2.5),
    20000.0: (-np.inf, 3.0),
}
RATES = (8000, 11025, 16000, 22050, 44100, 48000, 88200, 96000, 192000)


def exact(nominal):
    return 10.0 ** (round(10.0 * np.log10(nominal)) / 10.0)


def sine(frequency, amplitude, seconds, rate=48000):
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(round(seconds * rate)) / rate)


def noise(level, seconds, seed=0, rate=16000):
    """White noise whose mean square is `level` dB re 1."""
    random = np.random.default_rng(seed)
    return 10.0 ** (level / 20.0) * random.standard_normal(round(seconds * rate))


def write(path, samples, rate=48000, subtype='PCM_24'):
    soundfile.write(path, samples, rate, subtype=subtype)
    return path


def leq(samples, rate=48000, weighting='A'):
    """In dBFS, of which a full-scale sine has 0."""
    sound = measure(iter([samples.reshape(len(samples), -1)]), rate, weighting)
    return 10 * np.log10(2.0 * sound.energy[200:].mean())


@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('letter', ['A', 'C'])
def test_the_filters_are_within_class_1_of_the_table_up_to_the_limit_of_the_rate(rate, letter):
    rows = sections(letter, rate)
    for nominal, tabled in TABLE.items():
        if nominal < 0.45 * rate:
            low, high = LIMITS.get(nominal, (-1.0, 1.0))
            error = float(response(rows, exact(nominal), rate)) - tabled['AC'.index(letter)]
            assert low <= error <= high, f'{nominal} Hz'
    assert reach(rate) >= min(20000.0, 0.35 * rate)
    assert reach(rate) <= 0.46 * rate


@pytest.mark.parametrize(
    ('frequency', 'expected'), [(1000.0, 0.0), (100.0, -19.1), (31.623, -39.4), (7943.3, -1.1)]
)
def test_a_tone_through_the_meter_has_the_level_of_the_table(frequency, expected):
    assert leq(sine(frequency, 1.0, 4.0)) == pytest.approx(expected, abs=0.3)


def test_z_is_flat_and_an_offset_of_the_converter_is_no_sound():
    assert leq(sine(31.5, 1.0, 8.0), weighting='Z') == pytest.approx(0.0, abs=0.02)
    assert leq(0.5 + sine(1000.0, 0.1, 8.0), weighting='Z') == pytest.approx(-20.0, abs=0.05)


def test_half_the_amplitude_is_six_decibels_less():
    assert leq(sine(1000, 1.0, 2)) - leq(sine(1000, 0.5, 2)) == pytest.approx(6.02, abs=0.01)


def test_two_channels_are_averaged_in_energy():
    tone = sine(1000.0, 1.0, 3.0)
    assert leq(np.stack([tone, 0 * tone], 1)) == pytest.approx(-3.01, abs=0.02)
    assert leq(np.stack([tone, -tone], 1)) == pytest.approx(0.0, abs=0.02), 'none cancels another'


@pytest.mark.parametrize(('time', 'constant'), [('fast', 0.125), ('slow', 1.0)])
def test_after_the_end_of_a_tone_the_level_falls_as_the_standard_says(time, constant):
    """By 4.34 dB in a time constant: fast 34.7 dB/s, slow 4.3 dB/s."""
    samples = np.concatenate([sine(1000.0, 1.0, 12.0), np.zeros(48000)])
    sound = measure(iter([samples[:, None]]), 48000, 'A', time)
    level = 10 * np.log10(2 * sound.detector)
    start = round(12.1 / sound.step)
    fall = level[start] - level[start + round(0.5 / sound.step)]
    assert fall == pytest.approx(0.5 * 4.343 / constant, rel=0.02)
    assert level[round(11.9 / sound.step)] == pytest.approx(0.0, abs=0.03)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 9000), min_size=1, max_size=12), st.integers(0, 3))
def test_levels_do_not_depend_on_how_a_sound_is_cut_into_blocks(sizes, seed):
    samples = noise(-20.0, 2.0, seed, 8000)[:, None]
    whole = measure(iter([samples]), 8000)
    cuts = np.cumsum(sizes)
    parts = measure((part for part in np.split(samples, cuts[cuts < len(samples)])), 8000)
    np.testing.assert_allclose(parts.energy, whole.energy, rtol=1e-9)
    np.testing.assert_allclose(parts.detector, whole.detector, rtol=1e-9)
    np.testing.assert_allclose(list(parts.bands.values()), list(whole.bands.values()), rtol=1e-9)


def test_ten_minutes_take_little_more_memory_than_their_levels():
    block = noise(-20.0, 1.0, rate=8000)[:, None]
    tracemalloc.start()
    measure((block for _ in range(600)), 8000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.5 * 600 * block.nbytes


def test_third_octaves_hold_a_tone_in_its_band_and_all_energy_of_noise():
    bands = measure(iter([sine(1000.0, 1.0, 4.0)[:, None]]), 48000).bands
    assert bands[1000.0] == pytest.approx(0.5, rel=0.01)
    assert sum(v for k, v in bands.items() if k != 1000.0) < 1e-4
    white = measure(iter([noise(0.0, 20.0, rate=48000)[:, None]]), 48000).bands
    assert list(white)[:3] == [25.0, 31.5, 40.0]
    assert list(white)[-1] == 20000.0
    ratio = 10 * np.log10(white[8000.0] / white[1000.0])
    assert ratio == pytest.approx(9.03, abs=0.3), 'eight times as wide'


@pytest.mark.parametrize('subtype', ['PCM_U8', 'PCM_16', 'PCM_24', 'PCM_32', 'FLOAT', 'DOUBLE'])
@pytest.mark.parametrize('rate', [8000, 44100, 192000])
def test_every_wav_has_the_same_level(tmp_path, subtype, rate):
    path = write(tmp_path / 'a.wav', sine(1000.0, 0.5, 2.0, rate), rate, subtype)
    file = SoundFile(path)
    sound = measure(file.blocks(), file.rate)
    assert 10 * np.log10(2 * sound.energy[200:].mean()) == pytest.approx(-6.02, abs=0.1)
    assert file.seconds == pytest.approx(2.0)
    assert file.warnings == []


def test_flac_is_read_and_a_channel_can_be_chosen(tmp_path):
    both = np.stack([sine(1000.0, 0.5, 2.0), sine(1000.0, 0.05, 2.0)], 1)
    path = write(tmp_path / 'a.flac', both)
    second = SoundFile(path, 2)
    assert np.sqrt(2) * np.std(np.concatenate(list(second.blocks()))) == pytest.approx(0.05, 1e-3)
    with pytest.raises(InputError, match=r'has 2 channels; there is no channel 3'):
        SoundFile(path, 3)


def test_full_scale_is_what_the_calibrator_says(tmp_path):
    tone = write(tmp_path / 'tone.wav', sine(1000.0, 0.1, 5.0) + noise(-90, 5.0, rate=48000))
    quiet = write(tmp_path / 'quiet.wav', sine(1000.0, 0.01, 5.0))
    found = analyse([Entry(quiet)], Settings(), tone)
    assert found.unit == 'dB(A) SPL'
    assert found.levels(found.of('quiet')).leq == pytest.approx(74.0, abs=0.05), (
        '20 dB under 94 dB'
    )
    bare = analyse([Entry(quiet)], Settings())
    assert bare.levels(bare.of('quiet')).leq == pytest.approx(-40.0, abs=0.05)
    louder = analyse([Entry(quiet)], Settings(level=114.0), tone)
    assert louder.levels(louder.of('quiet')).leq == pytest.approx(94.0, abs=0.05)


def test_what_comes_before_and_after_the_calibrators_tone_does_not_count(tmp_path):
    parts = [noise(-30, 2.0, rate=48000), sine(1000.0, 0.1, 4.0), noise(-40, 2.0, rate=48000)]
    tone = read_tone(SoundFile(write(tmp_path / 't.wav', np.concatenate(parts))), 94.0)
    assert tone.mean_square == pytest.approx(0.005, rel=0.01)
    assert tone.frequency == pytest.approx(1000.0, abs=2.0)
    assert 3.0 <= tone.seconds <= 4.0


@pytest.mark.parametrize(
    ('samples', 'error'),
    [
        (noise(-20, 5.0, rate=48000), 'no pure tone of 1000 Hz'),
        (sine(440.0, 0.1, 5.0), 'no pure tone of 1000 Hz'),
        (sine(1000.0, 0.1, 1.0), 'no pure tone of 1000 Hz for 2 s'),
        (sine(1000.0, 0.1, 0.2), 'too short: record the calibrator'),
        (np.clip(sine(1000.0, 1.5, 5.0), -1, 1), 'calibrator is clipped'),
        (sine(1000.0, 0.1, 8.0) * 10 ** -np.linspace(0, 1.5, 384000), 'not steady to 0.5 dB'),
        (np.stack([sine(1000, 0.1, 5), sine(1000, 0.001, 5)], 1), r'choose it with --channel 1'),
    ],
)
def test_a_calibrator_that_is_none_is_refused(tmp_path, samples, error):
    path = write(tmp_path / 't.wav', samples)
    with pytest.raises(InputError, match=error):
        read_tone(SoundFile(path), 94.0)


def damaged(path, keep):
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * keep)])
    return path


@pytest.mark.parametrize(
    ('make', 'error'),
    [
        (lambda f: f / 'none.wav', 'there is no sound file'),
        (lambda f: ((f / 'a.wav').write_bytes(b'') and None) or f / 'a.wav', 'is no sound file'),
        (
            lambda f: (f / 'a.m4a').write_bytes(b'ftypM4A' * 99) and f / 'a.m4a',
            'convert it to wav',
        ),
        (lambda f: write(f / 'a.wav', np.zeros(96000)), 'silent from start to end'),
        (lambda f: write(f / 'a.wav', sine(1000, 0.1, 0.4)), '0.40 s are too short'),
        (lambda f: write(f / 'a.wav', sine(100, 0.1, 3, 4000), 4000), 'a rate of 4000 Hz'),
        (
            lambda f: write(
                f / 'a.wav', np.r_[sine(1e3, 0.1, 1), np.nan, sine(1e3, 0.1, 1)], subtype='FLOAT'
            ),
            r'no number, the first at 1\.000 s',
        ),
    ],
)
def test_what_cannot_be_measured_ends_with_one_line_and_exit_code_2(tmp_path, capsys, make, error):
    path = make(tmp_path)
    assert main([str(path)]) == 2
    stderr = capsys.readouterr().err.strip().splitlines()
    assert len([line for line in stderr if line.strip()]) == 1
    assert error in stderr[-1] or re.search(error, stderr[-1])
    assert path.name in stderr[-1]


def test_what_is_left_of_a_damaged_file_is_used_and_said(tmp_path):
    wav = damaged(write(tmp_path / 'a.wav', noise(-20, 6.0, rate=48000)), 0.5)
    flac = damaged(write(tmp_path / 'a.flac', noise(-20, 6.0, rate=48000)), 0.5)
    for path in (wav, flac):
        (take,) = analyse([Entry(path)], Settings()).takes
        assert take.sound.seconds == pytest.approx(3.0, abs=0.3)
        assert any(word in take.warnings[0] for word in ('cut off', 'damaged')), take.warnings


def test_clipping_low_rates_and_another_rate_of_the_calibrator_are_said(tmp_path):
    loud = write(tmp_path / 'loud.wav', np.clip(noise(0.0, 6.0), -1, 1 - 2**-15), 16000, 'PCM_16')
    tone = write(tmp_path / 'tone.wav', sine(1000.0, 0.1, 5.0))
    (take,) = analyse([Entry(loud)], Settings(), tone).takes
    clipped, low, other = take.warnings
    assert clipped.startswith('clipped in')
    assert '16000 Hz holds sound up to 6300 Hz only' in low
    assert 'calibrator was recorded at 48000 Hz' in other


@pytest.mark.parametrize('amplitude', [0.999, 0.5])
def test_a_tone_that_fits_is_not_called_clipped(tmp_path, amplitude):
    file = SoundFile(write(tmp_path / 'a.wav', sine(31.5, amplitude, 2.0), subtype='PCM_16'))
    list(file.blocks())
    assert not file.clipped


def test_a_float_file_beyond_one_is_not_clipped(tmp_path):
    file = SoundFile(write(tmp_path / 'a.wav', sine(1000.0, 3.0, 2.0), subtype='FLOAT'))
    list(file.blocks())
    assert not file.clipped


def stretch(level, seconds=60.0, seed=0, swing=0.0):
    """Pieces of 125 ms around a level in dB, that swing slowly (an autoregressive process)."""
    random = np.random.default_rng(seed)
    count = round(seconds / 0.125)
    slow = np.zeros(count)
    for i in range(1, count):
        slow[i] = 0.97 * slow[i - 1] + random.standard_normal()
    energy = 10.0 ** ((level + swing * slow + 0.3 * random.standard_normal(count)) / 10.0)
    return Stretch(energy, energy, float(energy.max()))


def test_levels_that_are_exceeded_for_a_tenth_half_and_nine_tenths_of_the_time():
    energy = np.repeat(10.0 ** (np.arange(11) / 10.0), 100)
    sound = Sound(8000.0, 0.125, energy, energy, energy, {})
    found = levels([Stretch.of(sound, np.ones(1100, bool))])
    assert found.leq == pytest.approx(10 * np.log10(energy.mean()))
    assert (round(found.l10), round(found.l50), round(found.l90)) == (9, 5, 1)
    assert found.max == pytest.approx(10.0)


def test_slow_swings_make_blocks_longer_and_intervals_wider():
    still, slow = stretch(60.0), stretch(60.0, swing=0.4)
    assert block_length(slow) > 3 * block_length(still)
    narrow = differences([still], [stretch(58.0, seed=1)])[0]['leq']
    wide = differences([slow], [stretch(58.0, seed=1, swing=0.4)])[0]['leq']
    assert narrow.value == pytest.approx(-2.0, abs=0.1)
    assert np.ptp(wide.interval) > 3 * np.ptp(narrow.interval)


def test_of_single_files_the_interval_holds_the_truth_in_16_of_20_at_least():
    held = 0
    for trial in range(20):
        first = stretch(60.0, seed=2 * trial, swing=0.2)
        second = stretch(60.0, seed=2 * trial + 1, swing=0.2)
        low, high = differences([first], [second])[0]['l50'].interval
        held += low <= 0.0 <= high
    assert held >= 16, 'of 20; 95 % nominal, blocks of a short sound hold less'


@pytest.mark.parametrize('files', [(2, 2), (3, 3), (4, 4), (6, 6), (2, 6)])
def test_of_several_files_that_differ_the_interval_holds_the_truth_as_often_as_it_says(files):
    random = np.random.default_rng(sum(files))
    held, half = np.zeros(4), []
    trials = 400
    for _ in range(trials):
        sides = [[steady(random.normal(60.0, 1.0)) for _ in range(n)] for n in files]
        found, block = differences(*sides)
        assert block is None
        spans = np.array([found[name].interval for name in FIGURES])
        held += (spans[:, 0] <= 0.0) & (spans[:, 1] >= 0.0)
        half.append(0.5 * np.ptp(spans[0]))
    assert np.all(held >= 0.92 * trials), held / trials
    assert np.all(held <= 0.99 * trials), held / trials
    # dB; t of 1 degree of freedom is 12.7, of 2 it is 4.3
    assert np.median(half) < {(2, 2): 8.0, (2, 6): 4.5}.get(files, 2.6)


def steady(level):
    """A second at one level in dB."""
    energy = np.full(8, 10.0 ** (level / 10.0))
    return Stretch(energy, energy, float(energy[0]))


def test_files_that_do_not_differ_have_an_interval_without_width():
    found = differences([steady(60.0)] * 2, [steady(63.0)] * 2)[0]['leq']
    assert found.value == pytest.approx(3.0)
    assert found.interval == pytest.approx((3.0, 3.0), abs=1e-9)


def test_files_of_a_policy_are_pooled_and_compared(tmp_path, capsys):
    for name, level in (('b1', -20), ('b2', -20), ('p1', -26), ('p2', -26)):
        write(tmp_path / f'{name}.wav', noise(level, 8.0, seed=int(name[1])), 16000)
    files = {n: ','.join(str(tmp_path / f'{n}{i}.wav') for i in (1, 2)) for n in 'bp'}
    result, picture, page = (tmp_path / name for name in ('r.json', 'r.png', 'r.html'))
    outputs = ['--json', str(result), '--picture', str(picture), '--report', str(page)]
    policies = ['--policy', f'baseline={files["b"]}', '--policy', f'pmp={files["p"]}']
    assert main([*policies, *outputs]) == 0
    out = capsys.readouterr().out
    assert 'pmp is 6.0 dB quieter than baseline' in out
    assert 'next: record a calibrator' in out
    content = json.loads(result.read_text())
    (difference,) = content['differences']
    assert difference['leq']['value'] == pytest.approx(-6.0, abs=0.1)
    low, high = difference['leq']['interval']
    assert -6.5 < low < -6.0 < high < -5.5
    assert difference['interval_by'] == 'files'
    assert '2 files tell little' in ' '.join(out.split())
    assert content['unit'] == 'dBFS(A)'
    assert picture.stat().st_size > 10_000
    assert 'pmp is 6.0 dB quieter than baseline' in page.read_text()


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        ([], 'no sound file given'),
        (['--policy', 'x'], "--policy 'x': expected NAME=WAV,WAV"),
        (['a.wav', '--recording', 'b', 'c'], '2 recordings for 1 sound files'),
        (['a.wav', '--level', '200'], '--level: expected 40 to 160 dB, there is 200'),
        (['a.wav', '--from', '-1'], '--from: expected 0 to 86400 s, there is -1'),
    ],
)
def test_bad_arguments_are_refused_in_one_line(capsys, arguments, error):
    assert main(arguments) == 2
    assert error in capsys.readouterr().err


def test_recordings_go_with_the_files_in_the_order_given():
    found = entries_of(['a.wav'], ['p=b.wav,c.wav'], ['A', 'B', 'C'])
    assert [(str(e.path), e.policy, e.recording) for e in found] == [
        *[('a.wav', '', 'A'), ('b.wav', 'p', 'B'), ('c.wav', 'p', 'C')]
    ]
