"""The simulated microphone: each source by itself, and what power_daq hears in the end."""

from itertools import pairwise

import numpy as np
import pytest
import soundfile
from power_recordings.messages.samples import FootForceSamples, ImuSamples, JointSamples
from power_recordings.reading.reader import Recording
from sim_bridge.live.node import main as sim_main
from sim_bridge.microphone import Microphone, calibrator, motion_of, pressure
from sim_bridge.sound_command import main
from sound_levels.levels.alignment import align_sound
from sound_levels.levels.events import events_of
from sound_levels.levels.meter import measure
from wattwalk_core.errors import InputError

RATE = 16_000
SILENT = {
    name: 0.0 for name in ('impact_pressure', 'gear_pressure', 'fan_pressure', 'room_pressure')
}
FLIGHT = 2.0 / 343.0  # s over the 2 m


def recording(seconds, *, landings=(), rise=0.01, speed=0.0, torque=0.0, knock=None):
    """A robot whose one foot is loaded with 400 N within `rise` s at each landing."""
    time = np.arange(round(400 * seconds)) / 400
    force = np.zeros(len(time))
    for at in landings:
        inside = (time >= at) & (time < at + 0.2)
        force[inside] = 400.0 * np.clip((time[inside] - at) / rise, 0, 1)
    stamps = (1e9 * time).astype(np.int64)
    ones = np.ones((len(time), 1), np.float32)
    felt = np.zeros((len(time), 3), np.float32)
    felt[:, 2] = 9.81 + 0.02 * np.random.default_rng(0).standard_normal(len(time))
    if knock is not None:
        felt[round(400 * knock), 2] += 30.0
    still = np.zeros_like(felt)
    return Recording.in_memory(
        'made',
        {
            'foot_force': FootForceSamples(stamps, ('LF_FOOT',), force[:, None].astype('f4')),
            'joint_states': JointSamples(
                stamps, ('LF_KFE',), 0 * ones, np.float32(speed) * ones, np.float32(torque) * ones
            ),
            'imu': ImuSamples(stamps, np.zeros((len(time), 4), np.float32), still, felt),
        },
    )


def heard(made, **options):
    sources = {**SILENT, **options.pop('sources', {})}
    microphone = Microphone(**sources)
    return np.concatenate(list(pressure(motion_of(made), microphone, RATE, **options)))


def strides(seconds, seed=0):
    """Times of landings, 0.4 to 0.6 s apart, from 2 s on."""
    steps = np.random.default_rng(seed).uniform(0.4, 0.6, round(2.5 * seconds))
    times = 2.0 + np.cumsum(steps)
    return times[times < seconds - 0.3].tolist()


def test_a_foot_that_lands_is_heard_after_the_flight_of_sound():
    sound = heard(recording(3.0, landings=[1.0]), sources={'impact_pressure': 0.5})
    loud = np.flatnonzero(np.abs(sound) > 0.01)
    assert loud[0] / RATE == pytest.approx(1.0 + FLIGHT, abs=0.004)
    assert loud[-1] / RATE < 1.3


def test_twice_as_harsh_is_six_decibels_louder():
    feet = {'impact_pressure': 0.5}
    soft, harsh = (
        np.sum(np.square(heard(recording(2.0, landings=[1.0], rise=rise), sources=feet)))
        for rise in (0.02, 0.01)
    )
    assert 10 * np.log10(harsh / soft) == pytest.approx(6.0, abs=0.8)


def test_the_whine_has_the_pitch_of_the_gear_and_grows_with_torque():
    """3 rad/s at the joint, 50 : 1, 16 teeth: 381.97 Hz."""
    loud = heard(recording(3.0, speed=3.0, torque=75.0), sources={'gear_pressure': 0.02})
    soft = heard(recording(3.0, speed=3.0, torque=15.0), sources={'gear_pressure': 0.02})
    spectrum = np.abs(np.fft.rfft(loud[RATE : 2 * RATE]))
    assert np.argmax(spectrum) == pytest.approx(3.0 * 50 * 16 / (2 * np.pi), abs=1.0)
    assert np.std(loud[RATE:]) > 1.5 * np.std(soft[RATE:])
    still = heard(recording(3.0, speed=0.0, torque=75.0), sources={'gear_pressure': 0.02})
    assert np.std(still) == 0.0


def test_twice_as_far_away_is_six_decibels_less():
    near, far = (
        np.std(heard(recording(2.0), sources={'fan_pressure': 0.01, 'distance': d}, seed=4))
        for d in (1.0, 2.0)
    )
    assert 20 * np.log10(near / far) == pytest.approx(6.02, abs=0.05)
    assert near == pytest.approx(0.01, rel=0.15)


def test_what_is_cut_into_blocks_is_one_sound_and_a_seed_gives_it_again():
    made = recording(4.0, landings=[0.9, 1.4, 2.4], speed=2.0, torque=20.0)
    first, again, other = (
        np.concatenate(list(pressure(motion_of(made), Microphone(), RATE, seed=seed)))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert len(first) == pytest.approx(4.0 * RATE, abs=RATE / 100)


@pytest.mark.parametrize('bits', ['16', '24', 'float'])
def test_the_calibrator_makes_pascals_of_the_file(tmp_path, bits):
    """94 dB SPL is 1 Pa; at 120 dB for a full sine its amplitude is 0.0501."""
    path = tmp_path / 'tone.wav'
    assert main(['--calibrator', '94', '-o', str(path), '--rate', '16000', '--bits', bits]) == 0
    samples, rate = soundfile.read(path)
    assert rate == 16000
    assert np.sqrt(2) * np.std(samples) == pytest.approx(10 ** (-26 / 20), rel=1e-3)
    with soundfile.SoundFile(path) as file:
        assert 'simulated microphone' in file.comment
    pascal = np.concatenate(list(calibrator(94.0, Microphone(), 16000, 2.0)))
    assert np.std(pascal) == pytest.approx(1.0, rel=0.003)


def aligned(made, method='auto', clap_at=None, **options):
    """Where power_daq, which hears the sound alone, lays it on the recording."""
    sound = np.concatenate(list(pressure(motion_of(made), Microphone(), RATE, **options)))
    return align_sound(measure(iter([sound[:, None]]), RATE), events_of(made), method, clap_at)


def test_the_gait_lays_a_sound_on_its_recording():
    made = recording(30.0, landings=strides(30.0))
    for start in (-3.0, 4.0):
        found = aligned(made, 'gait', start=start)
        assert found.offset == pytest.approx(start, abs=0.03)
        assert found.rival < 0.9


def test_an_even_gait_is_said_to_fit_a_stride_further_too():
    even = recording(30.0, landings=np.arange(0.5, 29.5, 0.5).tolist())
    found = aligned(even, 'gait', start=5.0)
    assert found.rival > 0.9
    assert 'clap once to be sure' in found.notes[0]
    offset = (found.offset - 5.0) / 0.5
    assert offset == pytest.approx(round(offset), abs=0.06), 'whole strides'


def test_a_clap_that_the_imu_felt_settles_it():
    even = recording(30.0, landings=np.arange(3.0, 29.5, 0.5).tolist(), knock=1.5)
    found = aligned(even, start=-2.0, claps=[1.5])
    assert found.method == 'clap'
    assert found.offset == pytest.approx(-2.0, abs=0.03)


def test_a_clap_whose_time_is_noted_settles_it_too():
    even = recording(30.0, landings=np.arange(3.0, 29.5, 0.5).tolist())
    found = aligned(even, 'clap', 1.5, start=-2.0, claps=[1.5])
    assert found.offset == pytest.approx(-2.0, abs=0.03)
    with pytest.raises(InputError, match='--clap-at'):
        aligned(even, 'clap', start=-2.0, claps=[1.5])
    with pytest.raises(InputError, match='no impulse that stands out'):
        aligned(even, 'clap', 1.5, start=-2.0)


def test_the_first_step_lays_on_the_first_landing():
    made = recording(20.0, landings=strides(20.0))
    assert aligned(made, 'step', start=-1.0).offset == pytest.approx(-1.0, abs=0.03)


def test_clocks_that_drift_apart_are_found_to():
    made = recording(120.0, landings=strides(120.0))
    found = aligned(made, 'gait', start=0.5, drift=200.0)
    assert found.drift == pytest.approx(200.0, abs=60.0)
    assert found.offset == pytest.approx(0.5, abs=0.03)


def test_a_sound_of_something_else_is_not_laid_on():
    made = recording(30.0, landings=strides(30.0))
    other = recording(30.0, landings=strides(30.0, seed=9))
    sound = np.concatenate(list(pressure(motion_of(other), Microphone(), RATE, start=2.2)))
    found = align_sound(measure(iter([sound[:, None]]), RATE), events_of(made), 'auto')
    assert found is None or found.correlation < 0.5


def test_landings_are_those_that_were_made():
    made = recording(10.0, landings=strides(10.0))
    found = events_of(made)
    np.testing.assert_allclose(found.landings, strides(10.0), atol=0.006)
    assert all(later > sooner for sooner, later in pairwise(found.landings))


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        (['-o', 'a.wav'], 'give a BAG, or --calibrator DB'),
        (['bag', '-o', 'a.mp3'], '-o is a.mp3'),
        (['bag', '-o', 'a.wav', '--rate', '1'], '--rate is 1; it must lie in 8000..192000'),
        (['bag', '-o', 'a.wav', '--distance', '0'], 'microphone.distance is 0.0'),
        (['nowhere', '-o', 'a.wav'], 'there is no recording nowhere'),
    ],
)
def test_bad_arguments_end_with_one_line(capsys, arguments, error):
    assert main(arguments) == 2
    stderr = capsys.readouterr().err
    assert error in stderr
    assert stderr.count('\n') == 1


def test_a_command_that_is_held_turns_the_robot_on_the_spot(tmp_path, capsys):
    bag = tmp_path / 'turn'
    options = ['--offline', '--velocity=0,0,0.7', '--duration', '6', '-o', str(bag)]
    assert sim_main(options) == 0
    found = Recording.open(bag)
    assert found.card.other['velocity'] == [0.0, 0.0, 0.7]
    np.testing.assert_allclose(found.cmd_vel().velocity[-1], [0.0, 0.0, 0.7], atol=1e-6)
    assert np.mean(found.odom().angular_velocity[-200:, 2]) > 0.3
    for wrong in ('0,0', '0,0,9', 'left'):
        assert sim_main(['--offline', f'--velocity={wrong}', '-o', str(tmp_path / 'x')]) == 2
    assert 'expected VX,VY,YAW' in capsys.readouterr().err
