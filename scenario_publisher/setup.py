from glob import glob

from setuptools import setup

NAME = 'scenario_publisher'

setup(
    name=NAME,
    version='0.1.0',
    description='Scenarios of obstacle avoidance and the node that publishes them.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=[NAME],
    python_requires='>=3.10',
    # ROS packages come from apt or from requirements.txt, never from here: a ROS installation
    # must not pull in the wheels
    install_requires=[
        'setuptools',
        'numpy',
        'pyyaml',
        'scipy',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*.yaml')),
        (f'share/{NAME}/scenarios', glob('scenarios/*.yaml')),
        # wheels ignore setup.cfg: these scripts let `ros2 run` find the nodes after pip
        (f'lib/{NAME}', glob('scripts/*')),
    ],
    entry_points={
        'console_scripts': [
            'scenario_node = scenario_publisher.scenario_node:main',
        ],
    },
)
