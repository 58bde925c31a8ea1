from glob import glob

from setuptools import setup

NAME = 'vehicle_plant'

setup(
    name=NAME,
    version='0.1.0',
    description='A four-wheel vehicle with magic-formula tyres, integrated at 1 kHz.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=[NAME, f'{NAME}.manoeuvres'],
    python_requires='>=3.10',
    # ROS packages come from apt or from requirements.txt, never from here: a ROS installation
    # must not pull in the wheels
    install_requires=[
        'setuptools',
        'casadi>=3.7',
        'matplotlib',
        'numpy',
        'scipy',
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
            'plant_node = vehicle_plant.plant_node:main',
            'identify = vehicle_plant.identify:main',
            'manoeuvre = vehicle_plant.manoeuvre:main',
        ],
    },
)
