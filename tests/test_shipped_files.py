"""Files for other programs name only what the nodes really publish, serve and are called."""

import json
import re
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from power_daq.recording.topics import TYPES

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / 'docs'
SOURCES = '\n'.join(path.read_text() for path in ROOT.glob('src/*/[a-z]*/*.py'))
SERVICES = {'start', 'stop', 'estop', 'push', 'reset'}
BY_JOINT = {'position', 'velocity', 'effort'}


def field_exists(topic, field):
    package, _, name = TYPES[topic].split('/')
    message = getattr(import_module(f'{package}.msg'), name)
    return field in message.get_fields_and_field_types()


def foxglove_paths():
    layout = json.loads((DOCS / 'foxglove_layout.json').read_text())
    for panel in layout['configById'].values():
        yield from (path['value'] for path in panel.get('paths', ()))


def plotjuggler_curves():
    root = ElementTree.parse(DOCS / 'plotjuggler_layout.xml').getroot()
    for kind in ('linked_source', *(f'v{i}' for i in range(1, 24))):
        yield from (element.text for element in root.iter(kind))
    made = {snippet.get('name') for snippet in root.iter('snippet')}
    plotted = {curve.get('name') for curve in root.iter('curve')}
    assert made <= plotted
    yield from plotted - made


@pytest.mark.parametrize('curves', [foxglove_paths, plotjuggler_curves])
def test_layouts_plot_fields_that_messages_have(curves):
    checked = 0
    for curve in curves():
        if curve.startswith('/studio_script/drive_power.'):
            continue
        parts = re.split(r'[./]', re.sub(r'\[\d+\]', '', curve.removeprefix('/')))
        topic, field = parts[0], parts[-1]
        assert field_exists(topic, field), curve
        assert len(parts) == 2 or field in BY_JOINT, curve
        checked += 1
    assert checked > 20


def test_the_panels_of_the_foxglove_layout_are_all_placed():
    layout = json.loads((DOCS / 'foxglove_layout.json').read_text())

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
            assert own <= set(TYPES), node
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
        named = {part.text for part in root if part.tag.endswith('depend')}
        code = '\n'.join(path.read_text() for path in manifest.parent.glob(f'{package}/**/*.py'))
        imported = set(re.findall(r'^(?:from|import) (\w+)', code, re.MULTILINE)) - {package}
        ros = {name for name in imported if name in known | ours or name.endswith('_msgs')}
        ros |= {'std_srvs'} & imported
        assert ros <= named, f'{manifest} lacks {ros - named}'
