from setuptools import find_packages, setup

package_name = 'power_daq'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={
        package_name: ['**/*.yaml', '**/*.dbc', '**/py.typed'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'python-can',
        'cantools',
        'pyvisa',
        'pyvisa-py',
        'pysoem',
        'rich',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Measurement of the drives of a robot: bus, clocks, DAQ, supply and recorder.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'daq = power_daq.commands.arguments:daq',
            'record = power_daq.commands.arguments:record',
            'watch = power_daq.commands.arguments:watch',
            'supply = power_daq.commands.arguments:supply',
            'topics = power_daq.commands.arguments:topics',
        ],
        'can.interface': ['unixsocket = power_daq.bus.unix_socket:UnixSocketBus'],
    },
)
