"""Files for other programs name only what the nodes really publish, serve and are called."""

import json
import re
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

import yaml
from power_daq.bus.description import BusDescription
from power_daq.nodes.card_topic import TOPIC as CARD
from power_recordings.messages.topics import TYPES

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
SOURCES = '\n'.join(path.read_text() for path in ROOT.glob('src/*/[a-z]*/**/*.py'))
SERVICES = {'start', 'stop', 'estop', 'push', 'reset'}
DRIVES = BusDescription.load().drives
NUMBERS = {'double', 'float', 'uint8', 'uint64'}


def message_fields(topic):
    """The fields of a topic's message and their types, such as 'sequence<double>'."""
    package, _, name = TYPES[topic].split('/')
    return getattr(import_module(f'{package}.msg'), name).get_fields_and_field_types()


def is_plottable(kind, index):
    """True for a number, or for an array with one for each drive, which an index chooses."""
    if index is None:
        return kind in NUMBERS
    return kind in {f'sequence<{number}>' for number in NUMBERS} and int(index) < len(DRIVES)


def foxglove_layout():
    return json.loads((DOCS / 'foxglove_layout.json').read_text())


def foxglove_paths():
    for panel in foxglove_layout()['configById'].values():
        yield from (path['value'] for path in panel.get('paths', ()))


def script_types(name):
    """The fields that a user script of the layout returns, as types of ROS."""
    source = foxglove_layout()['userNodes'][name]['sourceCode']
    fields = re.search(r'type Output = \{(.*?)\};', source, re.DOTALL)[1]
    of_typescript = {'number': 'double', 'number[]': 'sequence<double>'}
    found = re.findall(r'(\w+): ([^;]+);', fields)
    return {name: of_typescript.get(kind, kind) for name, kind in found}


def plotjuggler_curves():
    root = ElementTree.parse(DOCS / 'plotjuggler_layout.xml').getroot()
    for kind in ('linked_source', *(f'v{i}' for i in range(1, 24))):
        yield from (element.text for element in root.iter(kind))
    made = {snippet.get('name') for snippet in root.iter('snippet')}
    plotted = {curve.get('name') for curve in root.iter('curve')}
    assert made <= plotted
    yield from plotted - made


def test_foxglove_plots_numbers_that_messages_have():
    checked = 0
    for path in foxglove_paths():
        parts = re.fullmatch(r'/(studio_script/\w+|\w+)\.(\w+)(?:\[(\d+)\])?', path)
        assert parts, path
        topic, field, index = parts.groups()
        types = script_types(topic.split('/')[1]) if '/' in topic else message_fields(topic)
        assert is_plottable(types[field], index), path
        checked += 1
    assert checked > 20


def test_plotjuggler_plots_numbers_that_messages_have():
    checked = 0
    for curve in plotjuggler_curves():
        parts = re.fullmatch(r'/(\w+)(?:/([LR][FH]_\w+))?/(\w+?)(?:\[(\d+)\])?', curve)
        assert parts, curve
        topic, joint, field, index = parts.groups()
        if joint:
            assert TYPES[topic] == 'sensor_msgs/msg/JointState', 'the one type with joints by name'
            index = DRIVES.index(joint)
        assert is_plottable(message_fields(topic)[field], index), curve
        checked += 1
    assert checked > 20


def test_the_user_scripts_of_the_foxglove_layout_read_what_messages_have():
    scripts = foxglove_layout()['userNodes']
    assert set(scripts) == {'drive_power', 'robot_power'}
    for name, script in scripts.items():
        source = script['sourceCode']
        assert f'"/studio_script/{name}"' in source
        topics = re.findall(r'"/(\w+)"', re.search(r'inputs = \[(.*?)\]', source)[1])
        known = {field for topic in topics for field in message_fields(topic)}
        for read in re.findall(r'const \{ ([\w, ]+) \} = event\.message', source):
            assert set(read.split(', ')) <= known, name
        for topic in topics:
            assert f'Input<"/{topic}">' in source
        returned = re.findall(r'return (\{.+?\});', source, re.DOTALL)[-1]
        named = set(re.findall(r'(?:[{,])\s*(\w+)(?=,|:|\s*\})', returned))
        assert set(script_types(name)) == named, name


def test_the_foxglove_layout_shows_what_the_live_view_shows():
    shown = {path.split('[')[0] for path in foxglove_paths()}
    power = ('drive_power.power', 'drive_power.total', 'drive_power.flags', 'drive_power.lost')
    robot = ('supply', 'drives', 'electronics', 'supply_energy', 'drive_energy')
    assert shown >= {f'/studio_script/{name}' for name in power}
    assert shown >= {f'/studio_script/robot_power.{name}' for name in robot}
    assert shown >= {'/power_estimate.power', '/power_estimate.status', '/supply.voltage'}
    assert '/drive_supply.temperature' in shown
    panels = foxglove_layout()['configById'].values()
    selected = {panel.get('selectedName') for panel in panels} - {None}
    assert selected == {'power_daq: bus', 'power_daq: segment', 'recorder: bag'}


def test_the_diagnostics_panel_shows_the_topic_of_the_nodes():
    panels = foxglove_layout()['configById']
    for panel in panels.values():
        assert panel.get('topicToRender', '/diagnostics').lstrip('/') in TYPES


def test_the_panels_of_the_foxglove_layout_are_all_placed():
    layout = foxglove_layout()

    def leaves(part):
        if isinstance(part, str):
            return {part}
        return leaves(part['first']) | leaves(part['second'])

    assert leaves(layout['layout']) == set(layout['configById'])


def test_rosbag2_is_given_a_queue_of_a_second_for_each_topic_with_a_rate():
    profiles = yaml.safe_load((DOCS / 'rosbag2_qos.yaml').read_text())
    assert {name.lstrip('/') for name in profiles} == set(TYPES) - {'diagnostics', 'cmd_vel'}
    assert all(profile['depth'] >= 1000 for profile in profiles.values())


def test_the_security_policy_lets_each_node_do_what_it_does():
    root = ElementTree.parse(DOCS / 'sros2_policy.xml').getroot()
    allowed = {}
    for profile in root.iter('profile'):
        sides = allowed[profile.get('node')] = {}
        for part in profile:
            (side,) = part.attrib
            sides[side] = {entry.text for entry in part}
    for node, sides in allowed.items():
        assert node == 'operator' or f"super().__init__('{node}')" in SOURCES, node
        for side in ('publish', 'subscribe'):
            own = {name for name in sides[side] if not name.startswith('/')} - {'rosout'}
            assert own <= {*TYPES, CARD, 'robot_description'}, node
    assert {'drive_supply', 'joint_states'} <= allowed['power_daq']['publish']
    assert set(TYPES) <= allowed['recorder']['subscribe']
    assert allowed['operator']['request'] >= SERVICES
    served = [side['reply'] for side in allowed.values() if 'reply' in side]
    assert set().union(*served) >= SERVICES


def test_packages_name_the_ros_packages_that_they_import():
    known = {'rclpy', 'rcl_interfaces', 'builtin_interfaces', 'drive_power_msgs'}
    ours = {path.parent.name for path in ROOT.glob('src/*/package.xml')}
    for manifest in ROOT.glob('src/*/package.xml'):
        package = manifest.parent.name
        root = ElementTree.parse(manifest).getroot()
        assert root.get('format') == '3'
        depends = [(part.tag, part.text) for part in root if part.tag.endswith('depend')]
        assert len(depends) == len(set(depends)), f'{manifest} names a package twice'
        named = {name for _, name in depends}
        code = '\n'.join(path.read_text() for path in manifest.parent.glob(f'{package}/**/*.py'))
        imported = set(re.findall(r'^(?:from|import) (\w+)', code, re.MULTILINE)) - {package}
        ros = {name for name in imported if name in known | ours or name.endswith('_msgs')}
        ros |= {'std_srvs'} & imported
        assert ros <= named, f'{manifest} lacks {ros - named}'
