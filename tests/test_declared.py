"""Packages declare what they import: no more, no less, in package.xml and in setup.cfg."""

import ast
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from configparser import ConfigParser
from importlib.util import find_spec
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[1] / 'src'
PACKAGES = sorted(file.parent.name for file in SOURCES.glob('*/setup.py'))
OF_PIP = {
    'can': 'python-can',
    'hebi': 'hebi-py',
    'yaml': 'pyyaml',
    'PIL': 'pillow',
    'sklearn': 'scikit-learn',
    'rsl_rl': 'rsl-rl-lib',
}
"""Distributions by import name, where they differ."""
OF_ROS = {'rclpy', 'rosidl_runtime_py', 'ament_index_python', 'launch', 'launch_ros'}
PARTS = {'pydantic_core'}
"""Of distributions that are declared."""
ROSDEP_KEYS = {
    **{name: f'python3-{name}' for name in ('can', 'h5py', 'matplotlib', 'numpy', 'openpyxl')},
    **{name: f'python3-{name}' for name in ('rich', 'scipy', 'sklearn', 'soundfile', 'yaml')},
}
"""What Ubuntu 24.04 has new enough; requirements.txt alone has the rest (docs/how-to/ros2.md)."""
BY_NAME_IN_XML = {
    'power_daq': {'geometry_msgs', 'nav_msgs'},  # types of topics that are recorded
    'power_recordings': {'drive_power_msgs'},  # its .msg files
    'wattwalk_bringup': {
        *('policy_runner', 'power_daq', 'power_estimator', 'sim_bridge'),  # nodes that it starts
        *('ros2launch', 'ros2bag', 'rosbag2_storage_mcap'),  # commands that it starts
    },
}
BY_NAME_IN_SETUP = {
    'power_daq': {'pysoem', 'pyvisa-py'},  # loaded on use; backend of pyvisa
    'wattwalk_core': {'cryptography'},  # of the engine's temporary certificates
    'sound_levels': {'statsmodels'},  # of arch
    'wattwalk_bringup': {'policy_runner', 'power_daq', 'power_estimator', 'sim_bridge'},
    'policy_training': {'tensorboard'},  # of torch.utils.tensorboard
}
OPTIONAL = (
    'torch',
    'mujoco',
    'pyvisa',
    'can',
    'cantools',
    'plotly',
    'arch',
    'statsmodels',
    'rsl_rl',
)
"""Looked for where a package does not declare them; others are used by those that are declared."""


def imports(package, files=None):
    """Top-level names of what the modules of a package import, without Python's own."""
    found = set()
    for file in files or (SOURCES / package / package).rglob('*.py'):
        for node in ast.walk(ast.parse(file.read_text('utf-8'))):
            if isinstance(node, ast.Import):
                found |= {item.name.partition('.')[0] for item in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.partition('.')[0])
    return found - {*sys.stdlib_module_names, package}


def declared_in_setup(package, *keywords):
    config = ConfigParser()
    config.read(SOURCES / package / 'setup.cfg', 'utf-8')
    names = config['options']['install_requires'].split()
    if 'extras_require' in keywords:
        extras = config['options.extras_require']
        names = [name for kind in extras if kind != 'test' for name in extras[kind].split('; ')]
    return {name.partition('=')[0].lower() for name in names}


def declared_in_xml(package):
    root = ElementTree.parse(SOURCES / package / 'package.xml').getroot()
    return {entry.text for tag in ('depend', 'exec_depend') for entry in root.iter(tag)}


def is_of_ros(name):
    return name in PACKAGES or name in OF_ROS or name.endswith(('_msgs', '_srvs', '_interfaces'))


def is_of_pip(name):
    return name in PACKAGES or not is_of_ros(name)


@pytest.mark.parametrize('package', PACKAGES)
def test_package_xml_has_the_packages_and_rosdep_keys_of_what_is_imported(package):
    used = imports(package)
    packages = {name for name in used if is_of_ros(name)}
    keys = {ROSDEP_KEYS[name] for name in used if name in ROSDEP_KEYS}
    assert declared_in_xml(package) == packages | keys | BY_NAME_IN_XML.get(package, set())


@pytest.mark.parametrize('package', PACKAGES)
def test_setup_cfg_has_the_distributions_of_what_is_imported(package):
    used = {OF_PIP.get(name, name) for name in imports(package) if is_of_pip(name)}
    used |= BY_NAME_IN_SETUP.get(package, set())
    always = declared_in_setup(package)
    now_and_then = declared_in_setup(package, 'extras_require')
    assert always & now_and_then == set()
    assert always | now_and_then == used - PARTS


def test_what_is_declared_is_pinned():
    lines = (SOURCES.parent / 'requirements.txt').read_text('utf-8').splitlines()
    pinned = {line.partition('=')[0].lower() for line in lines}
    declared = set().union(*(declared_in_setup(package) for package in PACKAGES))
    assert declared - pinned - {'torch', *PACKAGES} == set()


PROGRAM = """
import importlib, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {absent!r}:
            raise ModuleNotFoundError(f'{{name}} is not declared by {package}')

sys.meta_path.insert(0, Absent())
for name in {modules!r}:
    importlib.import_module(name)
"""


@pytest.mark.parametrize('package', PACKAGES)
def test_a_package_imports_alone_with_what_it_and_its_packages_declare(package):
    needed, waiting = set(), [package]
    while waiting:
        needed.add(waiting.pop())
        waiting += [n for some in needed for n in declared_in_xml(some) & {*PACKAGES} - needed]
    third = set().union(*(imports(name) for name in PACKAGES)) - {*PACKAGES}
    allowed = set().union(*(imports(name) | BY_NAME_IN_SETUP.get(name, set()) for name in needed))
    folder = SOURCES / package
    files = sorted((folder / package).rglob('*.py'))
    if find_spec('launch') is None:
        files = [file for file in files if 'launch' not in imports(package, [file])]
    parts = [file.relative_to(folder).with_suffix('').parts for file in files]
    modules = ['.'.join(part).removesuffix('.__init__') for part in parts]
    absent = ({*PACKAGES} - needed) | {n for n in third - allowed if not is_of_ros(n)} & {
        *OPTIONAL
    }
    program = PROGRAM.format(absent=sorted(absent), package=package, modules=modules)
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
