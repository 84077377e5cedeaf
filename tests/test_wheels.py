"""Wheels of the suite in a bare venv, in another folder: the quick start."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(file.parent for file in ROOT.glob('src/*/setup.cfg'))
LEFT_BEHIND = shutil.ignore_patterns('*.egg-info', 'build', '__pycache__', 'test')
SLOW = 300.0
"""s that a step may take beside much other work."""
needs_build = pytest.mark.skipif(find_spec('build') is None, reason='no module build')
without_ros = pytest.mark.skipif('ROS_DISTRO' in os.environ, reason='of machines without ROS 2')


def versions():
    """Versions that are written down, by file."""
    found = {}
    for file in ROOT.glob('src/*/package.xml'):
        found[file.parent.name] = ElementTree.parse(file).findtext('version')
    for file in (ROOT / 'pyproject.toml', ROOT / 'embedded' / 'pyproject.toml'):
        project = tomllib.loads(file.read_text())['project']
        found[project['name']] = project['version']
    citation = (ROOT / 'CITATION.cff').read_text()
    found['CITATION.cff'] = re.search(r'^version: (.*)$', citation, re.MULTILINE)[1]
    for file in ROOT.glob('src/*/CHANGELOG.rst'):
        found[str(file)] = re.search(r'^(\d\S*) \(', file.read_text(), re.M)[1]
    return found


def test_all_versions_are_one():
    assert len({*versions().values()}) == 1, versions()
    assert len(versions()) == 2 * len([*ROOT.glob('src/*/package.xml')]) + 3


def test_the_distribution_has_every_package_at_its_version():
    project = tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']
    needed = [*project['dependencies'], *project['optional-dependencies']['train']]
    named = {re.match(r'[\w-]+', text)[0] for text in needed}
    assert named == {'wattwalk-embedded', *(folder.name for folder in PACKAGES)}
    extras = [text for some in project['optional-dependencies'].values() for text in some]
    assert all(text.endswith(f'=={project["version"]}') for text in (*needed, *extras))


class Bare:
    """A venv with the wheels and nothing else of the suite, and an empty folder."""

    def __init__(self, folder):
        self.home, self.folder = folder / 'venv', folder / 'elsewhere'
        self.folder.mkdir()
        kept = {'HOME', 'TMPDIR', 'LANG', 'OMP_NUM_THREADS', 'ROS_DOMAIN_ID'}
        self.environment = {key: value for key, value in os.environ.items() if key in kept}
        self.environment['PATH'] = f'{self.home / "bin"}:/usr/bin:/bin'

    def run(self, *command, code=0):
        done = subprocess.run(
            [self.home / 'bin' / command[0], *command[1:]],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=SLOW,
        )
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout + done.stderr


@pytest.fixture(scope='module')
def bare(tmp_path_factory):
    folder = tmp_path_factory.mktemp('wheels')
    # Building in the checkout would change the metadata of its editable installations.
    copy = folder / 'source'
    shutil.copytree(ROOT / 'src', copy / 'src', ignore=LEFT_BEHIND)
    shutil.copytree(ROOT / 'embedded', copy / 'embedded', ignore=LEFT_BEHIND)
    for name in ('pyproject.toml', 'README.md', 'LICENSE'):
        shutil.copy(ROOT / name, copy)
    sources = ('.', 'embedded', *(f'src/{package.name}' for package in PACKAGES))
    for source in sources:
        build = ('-m', 'build', '-q', '--no-isolation', '--outdir', folder / 'dist', source)
        subprocess.run([sys.executable, *build], cwd=copy, check=True, timeout=SLOW)
    made = Bare(folder)
    subprocess.run([sys.executable, '-m', 'venv', made.home], check=True, timeout=SLOW)
    made.run('pip', 'install', '-q', '--no-index', '--no-deps', *(folder / 'dist').glob('*.whl'))
    # Third-party libraries are those of this Python; its editable packages are not seen so.
    found = made.run('python', '-c', 'import sysconfig; print(sysconfig.get_path("purelib"))')
    others = {path for path in sys.path if path.endswith('site-packages')}
    others.add(sysconfig.get_path('purelib'))
    Path(found.strip(), 'others.pth').write_text('\n'.join(sorted(others)))
    return made


@pytest.mark.alone
@needs_build
@without_ros
def test_the_quick_start_runs_from_wheels_in_any_folder(bare):
    where = bare.run('python', '-c', 'import power_lab, rclpy; print(power_lab.__file__)')
    assert str(bare.home) in where
    bare.run('wattwalk', 'recordings', 'example', '-o', 'walk')
    fit = ('fit', 'walk', '--effects', 'shaft,copper_loss,idle')
    bare.run('wattwalk', 'lab', *fit, '-o', 'base.yaml')
    bare.run('ros2', 'run', 'power_lab', *fit, '-o', 'same.yaml')
    base, same = ((bare.folder / f'{name}.yaml').read_text() for name in ('base', 'same'))
    assert same.replace('name: same', 'name: base') == base
    models = ('--models', 'ppn:ppn_small', 'torque_squared')
    assert 'ppn' in bare.run('ros2', 'run', 'power_estimator', 'benchmark', 'walk', *models)
    page = bare.run(
        'wattwalk', 'lab', 'compare', 'walk', '--models', 'base.yaml', '--report', 'f.html'
    )
    assert (bare.folder / 'f.html').stat().st_size > 10_000, page
    offline = ('sim', '--offline', '--controller', 'economy', '--duration', '2', '-o', 'short')
    bare.run('ros2', 'run', 'sim_bridge', *offline)
    assert 'drive_supply' in bare.run('ros2', 'run', 'power_recordings', 'info', 'short')


@pytest.mark.alone
@needs_build
@without_ros
def test_all_nodes_start_from_wheels(bare, tmp_path):
    given = ('--channel', str(tmp_path / 'bus'), '--record', 'live', '--duration', '10')
    output = bare.run('ros2', 'run', 'wattwalk_bringup', 'live', *given)
    assert 'estimator: estimating' in output
    assert (bare.folder / 'live' / 'metadata.yaml').exists()


@pytest.mark.alone
@needs_build
@without_ros
def test_wheels_put_no_command_beside_ros2_and_wattwalk_into_the_path(bare):
    names = {path.name for path in (bare.home / 'bin').iterdir()}
    own = {name for name in names if not name.lower().startswith(('activate', 'pip', 'python'))}
    assert own == {'ros2', 'wattwalk'}
    assert 'sim_bridge sim\n' in bare.run('ros2', 'pkg', 'executables')
    assert 'fit' in bare.run('wattwalk')
    assert 'there is no command lab fly' in bare.run('wattwalk', 'lab', 'fly', code=2)
