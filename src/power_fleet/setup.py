import sys
from configparser import ConfigParser
from xml.etree import ElementTree

from setuptools import setup

settings = ConfigParser(interpolation=None)
settings.read('setup.cfg')
entry_points = dict(settings['options.entry_points'])
# As console_scripts, those of a wheel would be programs called `run` and `import` in the PATH.
if not {'develop', 'install'} & {*sys.argv}:
    entry_points['wattwalk.commands'] = entry_points.pop('console_scripts')
version = ElementTree.parse('package.xml').findtext('version')
setup(version=version, entry_points=entry_points)
