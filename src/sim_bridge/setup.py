from setuptools import find_packages, setup

package_name = 'sim_bridge'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/*.yaml', '**/*.dbc', '**/*.safetensors', '**/py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy', 'scipy', 'mujoco', 'python-can', 'pyyaml', 'rich'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description=(
        'A walking robot and its drives, simulated to the terminals of the power meter, '
        'behind the CAN bus of the hardware.'
    ),
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'sim = sim_bridge.commands.arguments:sim',
            'bench = sim_bridge.commands.arguments:bench',
            'record = sim_bridge.commands.arguments:record',
            'supply_instrument = sim_bridge.commands.arguments:supply_instrument',
            'ethercat_segment = sim_bridge.commands.arguments:ethercat_segment',
        ],
    },
)
