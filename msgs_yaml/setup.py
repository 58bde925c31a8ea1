from glob import glob

from setuptools import setup

NAME = 'msgs_yaml'

setup(
    name=NAME,
    version='0.1.0',
    description='The contract of every topic, and the shared types.',
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
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}', glob('topics.yaml')),
        (f'share/{NAME}/examples', glob('examples/*.yaml')),
    ],
)
