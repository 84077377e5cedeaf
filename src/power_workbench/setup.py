from setuptools import find_packages, setup

package_name = 'power_workbench'

setup(
    name=package_name,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    include_package_data=True,
    package_data={package_name: ['**/py.typed', '**/*.css', '**/*.js', '**/*.html']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=[
        'setuptools',
        'numpy',
        'starlette',
        'uvicorn',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='The loop of power_lab on one page in the browser.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'open = power_workbench.commands.arguments:open',
            'replay_session = power_workbench.commands.arguments:replay_session',
        ],
    },
)
