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
            'fit = power_lab.commands.fit:main',
            'compare = power_lab.commands.compare:main',
            'diagnose = power_lab.commands.diagnose:main',
            'discover = power_lab.commands.discover:main',
            'add = power_lab.commands.add:main',
            'challenge = power_lab.commands.challenge:main',
            'reveal = power_lab.commands.challenge:reveal',
            'execute = power_lab.commands.execute:main',
            'to_plant = power_lab.commands.to_plant:main',
        ],
    },
)
