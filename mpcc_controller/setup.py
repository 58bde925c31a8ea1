from glob import glob

from setuptools import find_packages, setup

NAME = 'mpcc_controller'

setup(
    name=NAME,
    version='0.1.0',
    description='Model predictive contouring control of a car at the limit of handling.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    python_requires='>=3.10',
    # ROS packages come from apt or from requirements.txt, never from here: a ROS installation
    # must not pull in the wheels
    install_requires=[
        'setuptools',
        'casadi>=3.7',
        'numpy',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', glob('config/*.yaml')),
        # wheels ignore setup.cfg: these scripts let `ros2 run` find the nodes after pip
        (f'lib/{NAME}', glob('scripts/*')),
    ],
    entry_points={
        'console_scripts': [
            'controller_node = mpcc_controller.controller_node:main',
            'mpcc_node = mpcc_controller.controller_node:mpcc_main',
            'frenet_node = mpcc_controller.controller_node:frenet_main',
        ],
    },
)
