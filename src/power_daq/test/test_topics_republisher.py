"""Messages of a robot's own topics become samples by the maps of an import."""

import math

import numpy as np
import pytest
from power_daq.bus.description import DEVICE_ERROR, STALE
from power_daq.nodes.topics import TopicsNode
from power_daq.topics.health import TopicsHealth
from power_daq.topics.republisher import MessageField, Republisher, columns_of
from power_recordings.importing.convert import import_logs
from power_recordings.importing.map_file import load_map, parse_map
from power_recordings.importing.sources.bag import BagFile
from power_recordings.messages import cdr
from power_recordings.reading.reader import Recording
from power_recordings.writing.writer import BagWriter
from sensor_msgs.msg import BatteryState, JointState
from wattwalk_core.errors import InputError
from wattwalk_core.nodes.diagnostics import Level

MS = 1_000_000
START = 1_700_000_000_000 * MS


class Message:
    """A message of a type that is not of ROS."""

    def __init__(self, **fields):
        self.__dict__ = fields

    def get_fields_and_field_types(self):
        return dict.fromkeys(self.__dict__, '')


def odrive(t, node):
    """Messages that odrive_can publishes of an axis at a time in s."""
    controller = Message(
        pos_estimate=0.25 * t + node,
        vel_estimate=0.25,
        torque_estimate=0.1 + node,
        iq_measured=1.0,
        active_errors=0,
    )
    status = Message(bus_voltage=24.0, bus_current=1.0 + t, motor_temperature=40.0 + node)
    return controller, status


def joints(t, names=('a', 'b'), stamp=True):
    message = JointState(name=list(names), position=[t, 2 * t], velocity=[1.0, 2.0])
    message.effort = [0.5, -0.5]
    if stamp:
        ns = START + round(t * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
    return message


def battery(t):
    message = BatteryState(voltage=48.0, current=-2.0 - t)
    ns = START + round(t * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, 10**9)
    return message


def map_of(drives, **more):
    return parse_map({'format': 'import/1', 'drives': drives, **more}, 'map robot.yaml')


ARM = {
    '*': {
        'position': {'from': '/joint_states:position[*]', 'unit': 'rad'},
        'velocity': {'from': '/joint_states:velocity[*]'},
        'torque': {'from': '/joint_states:effort[*]', 'at': 'joint'},
    }
}
METERED = {
    'voltage': {'from': '/battery:voltage'},
    'current': {'from': '/battery:current', 'positive': 'fed'},
}


def run(republisher, messages):
    """Feed (ms, topic, message), beginning after the first of each topic; samples by group."""
    samples = []
    topics = {topic for _, topic, _ in messages}
    for ms, topic, message in messages:
        samples += republisher.take(topic, START + round(ms * MS), message)
        if republisher.plan is None and republisher.heard.keys() == topics:
            republisher.begin()
    return {name: [s for s in samples if s.group == name] for name in republisher.groups}


def odrive_run(count=100, skip=lambda topic, k: False, republisher=None):
    messages = []
    for k in range(count):
        for node in (0, 1):
            controller, status = odrive(0.01 * k, node)
            at = 10 * k + 3 * node
            base = f'/odrive_axis{node}'
            for offset, name, message in (
                (0, 'controller_status', controller),
                (2, 'odrive_status', status),
            ):
                if not skip(f'{base}/{name}', k):
                    messages.append((at + offset, f'{base}/{name}', message))
    republisher = republisher or Republisher(load_map('ros_odrive'), 'map ros_odrive')
    return republisher, run(republisher, messages)


def test_odrive_s_own_topics_become_supply_and_joint_states_in_si_units():
    republisher, samples = odrive_run()
    assert republisher.groups['joint_states'].drives == ('AXIS_0', 'AXIS_1')
    sample = samples['joint_states'][20]
    t = (sample.stamp - START) / 1e9
    expected = 2 * math.pi * np.array([0.25 * t, 0.25 * (t - 0.003) + 1])
    assert sample.values[0] == pytest.approx(expected)
    assert sample.values[1:].tolist() == [[0.5 * math.pi] * 2, [0.1, 1.1]]
    sample = samples['drive_supply'][20]
    t = (sample.stamp - START) / 1e9
    assert sample.values[0].tolist() == [24.0, 24.0]
    assert sample.values[1] == pytest.approx([1.0 + t - 0.002, 1.0 + t - 0.005])
    assert sample.values[2].tolist() == [0, 0]
    assert sample.values[4].tolist() == [40.0, 41.0]
    assert republisher.plan.torque_at == {'AXIS_0': 'motor', 'AXIS_1': 'motor'}
    for of in samples.values():
        assert [s.sequence for s in of] == list(range(len(of)))
        assert len(of) > 80


@pytest.mark.parametrize(
    ('quantity', 'value', 'watts'),
    [('efficiency', 0.5, [0.5 / 0.5, -1.0 * 0.5]), ('loss', 3.0, [0.5 + 3.0, -1.0 + 3.0])],
)
def test_power_by_efficiency_or_loss_is_that_of_an_import(quantity, value, watts):
    drive = {
        **ARM['*'],
        'voltage': {'value': 10.0, 'unit': 'V'},
        quantity: {'from': '/joint_states:share'},
    }
    messages = []
    for k in range(20):
        message = Message(
            **{f: getattr(joints(0.0), f) for f in ('name', 'position')}, share=value
        )
        message.velocity, message.effort = [1.0, 2.0], [0.5, -0.5]
        messages.append((10 * k, '/joint_states', message))
    mapping = map_of({'*': drive}, time={'stamp': 'log'})
    samples = run(Republisher(mapping, 'map robot.yaml'), messages)
    values = samples['drive_supply'][5].values
    assert values[3].tolist() == watts
    assert values[1].tolist() == [power / 10.0 for power in watts]


def test_a_topic_that_falls_silent_is_stale_and_the_others_go_on():
    _, samples = odrive_run(
        200, lambda topic, k: topic == '/odrive_axis0/odrive_status' and k > 80
    )
    late = [s for s in samples['drive_supply'] if s.stamp > START + 900 * MS]
    assert len(late) > 80
    assert all(s.values[2].tolist() == [STALE, 0] for s in late)
    assert all(np.isnan(s.values[:2, 0]).all() for s in late)
    assert len(samples['joint_states']) > 180


def test_a_robot_that_is_metered_as_a_whole_keeps_names_signs_and_header_stamps():
    republisher = Republisher(map_of(ARM, supply=METERED), 'map robot.yaml')
    samples = run(
        republisher,
        [
            m
            for k in range(50)
            for m in (
                (10 * k + 500, '/joint_states', joints(0.01 * k)),
                (10 * k + 501, '/battery', battery(0.01 * k)),
            )
        ],
    )
    assert set(samples) == {'joint_states', 'supply'}
    first = samples['joint_states'][0]
    assert first.stamp == START + 10 * MS, 'of the message, not of its receipt'
    assert first.values.tolist() == [[0.01, 0.02], [1.0, 2.0], [0.5, -0.5]]
    assert samples['supply'][0].values[:2, 0].tolist() == pytest.approx([48.0, 2.01])


def test_effort_in_amperes_is_known_as_such():
    mapping = load_map('ur_ros2')
    names = tuple(mapping.drives)
    republisher = Republisher(mapping, 'map ur_ros2')
    message = JointState(name=list(names), position=[0.0] * 6, velocity=[0.0] * 6)
    message.effort = [1.5] * 6
    republisher.take('/joint_states', 0, message)
    republisher.take('/supply', 0, battery(0.0))
    republisher.begin()
    assert set(republisher.plan.torque_unit.values()) == {'A'}
    assert republisher.plan.torque_at['elbow_joint'] == 'motor'


def test_numbers_in_arrays_of_messages_are_found_as_in_a_bag():
    motors = [Message(q=0.1 * i, dq=float(i), tau_est=0.5, lost=[i, i + 1]) for i in range(20)]
    state = Message(motor_state=motors, power_v=29.5, power_a=3.0, sn=[1, 2], name='go2')
    republisher = Republisher(load_map('unitree_go2'), 'map unitree_go2')
    samples = run(republisher, [(5 * k, '/lowstate', state) for k in range(5)])
    column = republisher.groups['joint_states'].drives.index('RL_calf')
    sample = samples['joint_states'][0]
    assert sample.values[:, column].tolist() == pytest.approx([1.1, 11.0, 0.5])
    assert MessageField('motor_state[2].lost[1]').read(state) == 3.0
    assert 'motor_state[19].lost[0]' in {
        c.address.partition(':')[2] for c in columns_of('/lowstate', state)
    }


@pytest.mark.parametrize(
    'path', ['motor_state[99].q', 'nothing', 'name', 'name[0]', 'power_v[0]', 'sn[two]', 'sn']
)
def test_what_a_message_does_not_have_is_no_number(path):
    state = Message(motor_state=[Message(q=1.0)], sn=[1, 2], name='go2', power_v=29.5)
    assert math.isnan(MessageField(path).read(state))


def test_power_becomes_current_and_velocity_the_rate_of_position():
    drives = {
        'wheel': {
            'position': {'from': '/motor:angle', 'unit': 'deg'},
            'voltage': {'value': 24.0, 'unit': 'V'},
            'power': {'from': '/motor:watts', 'unit': 'W'},
        }
    }
    republisher = Republisher(map_of(drives, time={'stamp': 'log'}), 'map robot.yaml')
    messages = [(5 * k, '/motor', Message(angle=90.0 * 0.005 * k, watts=48.0)) for k in range(60)]
    samples = run(republisher, messages)
    assert samples['joint_states'][20].values[1] == pytest.approx([math.pi / 2])
    assert samples['drive_supply'][20].values[:3, 0].tolist() == [24.0, 2.0, 0.0]
    assert republisher.plan.derived == ('wheel',)


def test_a_number_that_is_none_is_flagged_as_the_device_s():
    drives = {
        'wheel': {
            'velocity': {'from': '/motor:speed'},
            'voltage': {'from': '/motor:volts'},
            'current': {'from': '/motor:amps'},
        }
    }
    republisher = Republisher(map_of(drives, time={'stamp': 'log'}), 'map robot.yaml')
    message = Message(speed=1.0, volts=math.nan, amps=1.0)
    samples = run(republisher, [(5 * k, '/motor', message) for k in range(5)])
    assert samples['drive_supply'][0].values[2].tolist() == [DEVICE_ERROR]
    report = TopicsHealth(republisher).report(0.0, [])
    assert report.level is Level.WARN
    assert 'drive_supply not finite' in report.sentence


def test_stamps_that_go_back_begin_anew_with_the_next_number():
    republisher, samples = odrive_run(300)
    _, again = odrive_run(50, republisher=republisher)
    assert again['joint_states'][0].stamp < samples['joint_states'][-1].stamp
    assert again['joint_states'][0].sequence == samples['joint_states'][-1].sequence + 1
    assert republisher.groups['joint_states'].restarts == 1


def test_an_import_of_the_same_messages_has_the_same_samples(tmp_path):
    drives = {
        name: {
            **{
                q: {'from': f'/joint_states:{f}[{name}]'}
                for q, f in (
                    ('position', 'position'),
                    ('velocity', 'velocity'),
                    ('torque', 'effort'),
                )
            },
            'voltage': {'from': '/battery:voltage'},
            'current': {'from': '/battery:current', 'positive': 'fed'},
        }
        for name in ('a', 'b')
    }
    mapping = map_of(drives)
    t = 0.01 * np.arange(100)
    late = t[:-1] + 0.004
    with BagWriter(tmp_path / 'robot') as bag:
        stamps = START + np.rint(t * 1e9).astype(np.int64)
        states = cdr.in_a_list(
            cdr.joint_state_block(
                stamps,
                ['a', 'b'],
                np.outer(t, [1, 2]),
                np.tile([1.0, 2.0], (100, 1)),
                np.tile([0.5, -0.5], (100, 1)),
            )
        )
        handle = bag.add_topic('/joint_states', cdr.JOINT_STATE)
        for stamp, raw in zip(stamps, states, strict=True):
            bag.write(handle, int(stamp), raw)
        stamps = START + np.rint(late * 1e9).astype(np.int64)
        handle = bag.add_topic('/battery', cdr.BATTERY_STATE)
        for stamp, raw in zip(
            stamps,
            cdr.in_a_list(cdr.battery_block(stamps, np.full(99, 48.0), -2 - late)),
            strict=True,
        ):
            bag.write(handle, int(stamp), raw)
    import_logs([BagFile(tmp_path / 'robot')], mapping, 'map', tmp_path / 'out')
    recording = Recording.open(tmp_path / 'out')
    republisher = Republisher(mapping, 'map')
    messages = [(1000 * x, '/joint_states', joints(x)) for x in t]
    messages += [(1000 * x, '/battery', battery(x)) for x in late]
    samples = run(republisher, sorted(messages, key=lambda m: m[0]))
    imported, live = recording.joint_states(), samples['joint_states']
    at = np.searchsorted(imported.stamp_ns, [s.stamp for s in live])
    assert len(live) > 90
    np.testing.assert_allclose(imported.position[at], [s.values[0] for s in live], rtol=1e-6)
    np.testing.assert_allclose(imported.effort[at], [s.values[2] for s in live])
    imported, live = recording.drive_supply(), samples['drive_supply']
    at = np.searchsorted(imported.stamp_ns, [s.stamp for s in live])
    np.testing.assert_allclose(imported.current[at], [s.values[1] for s in live], rtol=1e-6)


def test_messages_without_a_time_of_their_own_say_what_the_map_needs():
    republisher = Republisher(map_of(ARM, supply=METERED), 'map robot.yaml')
    republisher.take('/joint_states', START, joints(0.0, stamp=False))
    republisher.take('/battery', START, battery(0.0))
    republisher.begin()
    with pytest.raises(InputError, match=r'robot\.yaml: the messages of /joint_states have no'):
        republisher.take('/joint_states', START, joints(0.0, stamp=False))


def test_a_field_that_is_not_there_is_named_with_those_alike():
    drives = {'a': {**ARM['*'], 'torque': {'from': '/joint_states:efort[a]'}}}
    drives['a']['position'] = drives['a']['velocity'] = {'from': '/joint_states:position[a]'}
    republisher = Republisher(map_of(drives, supply=METERED), 'map robot.yaml')
    republisher.take('/joint_states', START, joints(0.0))
    republisher.take('/battery', START, battery(0.0))
    with pytest.raises(InputError, match=r"efort\[a\]'; there is /joint_states:effort\[a\]"):
        republisher.begin()


@pytest.mark.parametrize('source', ['joint_states:position[a]', '/joint_states', 'actual_q_0'])
def test_a_map_of_a_table_is_refused(source):
    with pytest.raises(InputError, match='names no topic; expected /topic:field'):
        Republisher(map_of({'a': {'position': {'from': source}}}), 'map robot.yaml')


def test_an_unknown_type_is_one_line_with_what_to_do():
    with pytest.raises(InputError, match=r'/x is of type no_such_msgs/msg/Foo, which .* source'):
        TopicsNode._subscribe(None, '/x', ['no_such_msgs/msg/Foo'])


def test_diagnostics_say_what_is_waited_for_and_what_is_silent():
    republisher = Republisher(load_map('ros_odrive'), 'map ros_odrive')
    health = TopicsHealth(republisher)
    controller, status = odrive(0.0, 0)
    republisher.take('/odrive_axis0/controller_status', START, controller)
    report = health.report(0.0, ['/odrive_axis0/controller_status'])
    assert report.level is Level.ERROR
    assert report.sentence == 'waiting for /odrive_axis*/odrive_status (no such topic)'
    report = health.report(1.0, ['/odrive_axis0/odrive_status'])
    assert report.sentence == 'waiting for /odrive_axis*/odrive_status (no message yet)'
    republisher.take('/odrive_axis0/odrive_status', START, status)
    republisher.begin()
    for k in range(20):
        for name, message in (('controller', controller), ('odrive', status)):
            republisher.take(f'/odrive_axis0/{name}_status', START + 10 * k * MS, message)
    assert health.report(2.0, []).sentence == 'republishing'
    report = health.report(3.0, [])
    assert report.level is Level.ERROR
    assert 'no message in the last second of /odrive_axis0/controller_status' in report.sentence
    for name, message in (('controller', controller), ('odrive', status)):
        republisher.take(f'/odrive_axis0/{name}_status', START + 200 * MS, message)
    report = health.report(4.0, ['/odrive_axis7/odrive_status'])
    assert report.sentence.startswith('came too late and is left out: /odrive_axis7')


def test_topics_whose_stamps_lie_apart_are_told():
    republisher = Republisher(map_of(ARM, supply=METERED), 'map robot.yaml')
    drives = {
        'a': {k: dict(v, **{'from': v['from'].replace('*', 'a')}) for k, v in ARM['*'].items()}
    }
    drives['a']['torque'] = {'from': '/torque:effort[a]'}
    republisher = Republisher(map_of(drives, supply=METERED), 'map robot.yaml')
    messages = [
        m
        for k in range(20)
        for m in (
            (10 * k, '/joint_states', joints(0.01 * k)),
            (10 * k, '/torque', joints(0.01 * k - 5.0)),
            (10 * k, '/battery', battery(0.01 * k)),
        )
    ]
    run(republisher, messages)
    report = TopicsHealth(republisher).report(0.0, [])
    assert 'stamps lag behind those of other topics: /torque by 5.0 s' in report.sentence
