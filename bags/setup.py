from glob import glob

from setuptools import find_packages, setup

NAME = 'bags'

setup(
    name=NAME,
    version='0.1.0',
    description='Runs recorded to MCAP in the rosbag2 layout, and compared offline.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.report': ['page/*']},
    python_requires='>=3.10',
    # ROS packages come from apt or from requirements.txt, never from here: a ROS installation
    # must not pull in the wheels
    install_requires=[
        'setuptools',
        'bokeh',
        'foxglove-sdk',
        'jinja2',
        'lz4',
        'matplotlib',
        'mcap',
        'numpy',
        'pyyaml',
        'rich',
        'zstandard',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*.yaml')),
        (f'share/{NAME}/viewers', glob('viewers/*')),
        # wheels ignore setup.cfg: these scripts let `ros2 run` find the nodes after pip
        (f'lib/{NAME}', glob('scripts/*')),
    ],
    entry_points={
        'console_scripts': [
            'player_node = bags.player_node:main',
            'markers_node = bags.markers_node:main',
            'recorder_node = bags.recorder_node:main',
            'view_node = bags.view_node:main',
            'bags = bags.cli:main',
        ],
    },
)
