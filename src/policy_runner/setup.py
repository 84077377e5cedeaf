from setuptools import find_packages, setup

package_name = 'policy_runner'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/*.yaml', '**/*.safetensors']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools', 'numpy', 'safetensors', 'torch'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Runs walking policies on a robot, safely.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'run = policy_runner.commands.run:main',
        ],
    },
)
