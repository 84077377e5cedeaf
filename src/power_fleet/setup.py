from setuptools import find_packages, setup

package_name = 'power_fleet'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={package_name: ['**/py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'scikit-learn',
        'statsmodels',
        'plotly',
        'rich',
        'threadpoolctl',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Changes of drives and meters over many recordings.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'track = power_fleet.commands.arguments:track',
            'challenge = power_fleet.commands.arguments:challenge',
            'reveal = power_fleet.commands.arguments:reveal',
        ],
    },
)
