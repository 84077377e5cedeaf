from setuptools import find_packages, setup

package_name = 'wattwalk_core'

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
        'pyyaml',
        'matplotlib',
        'pydantic',
        'numpy',
        'numba',
        'plotly',
        'rich',
    ],
    extras_require={
        'tensors': ['torch', 'safetensors'],
        'engine': ['dask', 'distributed', 'cryptography', 'threadpoolctl'],
        'test': ['pytest'],
    },
    zip_safe=False,
    maintainer='wattwalk maintainers',
    maintainer_email='wattwalk@example.org',
    description='Errors, commands, node start-up, files, pages and plot style.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [],
    },
)
