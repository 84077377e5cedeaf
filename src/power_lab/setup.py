from setuptools import find_packages, setup

package_name = 'power_lab'

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
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'scipy',
        'scikit-learn',
        'statsmodels',
        'arch',
        'plotly',
        'rich',
        'pyyaml',
        'threadpoolctl',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Judges power models: where they fail and which physical effect they miss.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'fit = power_lab.commands.arguments:fit',
            'compare = power_lab.commands.arguments:compare',
            'diagnose = power_lab.commands.arguments:diagnose',
            'discover = power_lab.commands.arguments:discover',
            'add = power_lab.commands.arguments:add',
            'challenge = power_lab.commands.arguments:challenge',
            'reveal = power_lab.commands.arguments:reveal',
            'execute = power_lab.commands.arguments:execute',
            'to_plant = power_lab.commands.arguments:to_plant',
        ],
    },
)
