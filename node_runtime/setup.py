from setuptools import setup

NAME = 'node_runtime'

setup(
    name=NAME,
    version='0.1.0',
    description='What every node needs: parameters, topics, clocks, life cycle.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=[NAME],
    python_requires='>=3.10',
    install_requires=[
        'setuptools',
        'pyyaml',
    ],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
    ],
)
