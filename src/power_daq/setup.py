from setuptools import find_packages, setup

package_name = 'power_daq'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={
        package_name: [
            '**/*.yaml',
            '**/*.dbc',
            '**/*.safetensors',
            '**/py.typed',
            '**/*.css',
            '**/*.js',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'pyyaml',
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
    description='Measures the drives of a robot: bus drivers, clock mapping, the DAQ node, '
    'the recorder and aligned reading of recordings.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'daq = power_daq.nodes.daq:main',
            'record = power_daq.nodes.recorder:main',
            'watch = power_daq.nodes.watch:main',
            'supply = power_daq.nodes.supply:main',
        ],
        'can.interface': ['unixsocket = power_daq.bus.unix_socket:UnixSocketBus'],
    },
)
