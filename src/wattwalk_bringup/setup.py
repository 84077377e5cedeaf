from glob import glob

from setuptools import find_packages, setup

package_name = 'wattwalk_bringup'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/*.yaml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/launch', sorted(glob('launch/*.launch.py'))),
        ('share/' + package_name + '/config', sorted(glob(package_name + '/config/*.yaml'))),
    ],
    install_requires=['setuptools', 'pyyaml', 'rich'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Brings up the nodes of a measured robot, simulated or real, as one.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'live = wattwalk_bringup.commands.arguments:live',
        ],
    },
)
