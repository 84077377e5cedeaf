from setuptools import find_packages, setup

package_name = 'power_estimator'

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
    install_requires=[
        'setuptools',
        'numpy',
        'scipy',
        'threadpoolctl',
        'torch',
        'safetensors',
        'matplotlib',
        'rich',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Power models of joint drives: the Power Prediction Network, proxies, models of '
    'named effects, and the live estimate.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'estimate = power_estimator.commands.arguments:estimate',
            'train = power_estimator.commands.arguments:train',
            'benchmark = power_estimator.commands.arguments:benchmark',
            'replay = power_estimator.commands.arguments:replay',
            'sweep = power_estimator.commands.arguments:sweep',
            'distil = power_estimator.commands.arguments:distil',
            'export = power_estimator.commands.arguments:export',
        ],
    },
)
