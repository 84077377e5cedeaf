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
        'scipy',
        'scikit-learn',
        'statsmodels',
        'arch',
        'plotly',
        'rich',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Judges power models: where they fail and which physical effect they miss.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'fit = power_lab.fit_command:main',
            'compare = power_lab.compare_command:main',
            'diagnose = power_lab.diagnose_command:main',
            'add = power_lab.add_command:main',
            'challenge = power_lab.challenge_command:main',
            'reveal = power_lab.challenge_command:reveal',
            'execute = power_lab.execute_command:main',
            'to_plant = power_lab.to_plant_command:main',
        ],
    },
)
