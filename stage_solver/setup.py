from setuptools import setup

NAME = 'stage_solver'

setup(
    name=NAME,
    version='0.1.0',
    description='Optimal control problems in stages, solved by a generated interior-point method.',
    license='Apache-2.0',
    maintainer='maintainers',
    maintainer_email='maintainers@users.noreply.example',
    packages=[NAME],
    package_data={NAME: ['riccati_c/*']},
    python_requires='>=3.10',
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
    ],
)
