from setuptools import find_packages, setup

package_name = 'policy_training'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/*.yaml', '**/py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'scipy',
        'mujoco',
        'torch',
        'rsl-rl-lib',
        'cma',
        'tensorboard',
        'tensordict',
        'pyyaml',
        'plotly',
        'matplotlib',
        'pillow',
        'rich',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Trains walking policies with electrical power in the reward, and evaluates them.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'train = policy_training.commands.arguments:train',
            'evaluate = policy_training.commands.arguments:evaluate',
            'blend = policy_training.commands.arguments:blend',
            'export = policy_training.commands.arguments:export',
            'optimise_gait = policy_training.commands.arguments:optimise_gait',
        ],
    },
)
