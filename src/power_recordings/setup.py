from setuptools import find_packages, setup

package_name = 'power_recordings'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/*.yaml', '**/*.css', '**/*.js', '**/py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'scipy',
        'mcap',
        'zstandard',
        'lz4',
        'rosbags',
        'pint',
        'rich',
    ],
    extras_require={
        'import': ['pyarrow', 'openpyxl', 'h5py'],
        'export': ['pyarrow'],
        'hebi': ['hebi-py==2.16.1'],
        'test': ['pytest'],
    },
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Recordings: writing, reading, repair and alignment.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'import = power_recordings.commands.arguments:import_logs',
            'info = power_recordings.commands.arguments:info',
            'index = power_recordings.commands.arguments:index',
        ],
    },
)
