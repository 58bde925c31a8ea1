"""Builds the message of /tf, of which there is no wheel, with the generators of the wheels and gcc.

`python tests/bags/viewers/tf2_build.py FOLDER`: a process with FOLDER in LD_LIBRARY_PATH,
PYTHONPATH and AMENT_PREFIX_PATH then has tf2_msgs. Takes g++ and the headers of Python; some
seconds.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

PACKAGE = 'tf2_msgs'
PREFIX = Path(sys.prefix)
IDL = """
#include "geometry_msgs/msg/TransformStamped.idl"
module tf2_msgs { module msg { struct TFMessage {
  sequence<geometry_msgs::msg::TransformStamped> transforms;
}; }; };
"""
OTHERS = ('geometry_msgs', 'std_msgs', 'builtin_interfaces')
C = 'rosidl_typesupport_c'
FAST = 'rosidl_typesupport_fastrtps_c'
LOOK_INTO = 'rosidl_typesupport_introspection_c'


def generate(folder: Path) -> None:
    """Write the sources; one folder per generator."""
    # `rosidl generate` finds each generator twice, by the wheel's metadata and by the egg's
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    idl = folder / 'msg' / 'TFMessage.idl'
    idl.parent.mkdir(parents=True)
    idl.write_text(IDL)
    arguments = PACKAGE, [f'{folder}:msg/TFMessage.idl'], [str(PREFIX / 'share')]
    hashes = HashTypeDescription('hash').generate_type_hashes(*arguments, folder / 'hash')
    _install_definition(folder)
    GenerateC('c').generate(*arguments, folder / 'c' / PACKAGE, type_description_files=hashes)
    GeneratePython('py').generate(*arguments, folder / 'py')
    for name, generator in (
        (C, GenerateCTypesupport),
        (FAST, GenerateFastRTPSCTypesupport),
        (LOOK_INTO, GenerateIntrospectionCTypesupport),
    ):
        generator(name).generate(*arguments, folder / name / PACKAGE)


def _install_definition(folder):
    """Write what an installation has in share: the message as text, and its hash."""
    share = folder / 'share' / PACKAGE / 'msg'
    share.mkdir(parents=True)
    (share / 'TFMessage.msg').write_text('geometry_msgs/TransformStamped[] transforms\n')
    (described,) = (folder / 'hash').rglob('TFMessage.json')
    (share / 'TFMessage.json').write_bytes(described.read_bytes())


def compile_all(folder: Path) -> None:
    """Compile libraries and the Python module into the folder."""
    generator_c, generator_py = 'rosidl_generator_c', 'rosidl_generator_py'
    _library(folder, generator_c, 'c', '**/*.c', ('rosidl_runtime_c', 'rcutils'))
    runtime = (f'{PACKAGE}__{generator_c}', 'rosidl_runtime_c', 'rcutils')
    cdr = ('rosidl_typesupport_fastrtps_cpp', 'fastcdr', 'rmw')
    _library(folder, FAST, FAST, '**/*.cpp', (FAST, *cdr, *runtime))
    _library(folder, LOOK_INTO, LOOK_INTO, '**/*.c', (LOOK_INTO, *runtime))
    _library(folder, C, C, '**/*.cpp', (C, f'{PACKAGE}__{FAST}', f'{PACKAGE}__{LOOK_INTO}'))
    python = folder / 'py' / 'msg'
    _library(folder, generator_py, 'py', 'msg/*_s.c', (f'{PACKAGE}__{C}', *runtime))
    module = folder / PACKAGE
    (module / 'msg').mkdir(parents=True)
    (module / '__init__.py').touch()
    for source in python.glob('*.py'):
        (module / 'msg' / source.name).write_bytes(source.read_bytes())
    links = (f'{PACKAGE}__{generator_py}', f'{PACKAGE}__{C}', C, *runtime)
    sources = [folder / 'py' / f'_{PACKAGE}_s.ep.{C}.c']
    _compile(folder, module / f'{PACKAGE}_s__{C}.so', sources, links)


def _library(folder, name, sources, pattern, links):
    result = sorted((folder / sources).glob(pattern))
    kinds = [f'{other}__{name}' for other in OTHERS if name != C]
    _compile(folder, folder / f'lib{PACKAGE}__{name}.so', result, (*kinds, *links))


def _compile(folder, target, sources, links):
    includes = [folder / name for name in ('c', FAST, LOOK_INTO)]
    includes += [sysconfig.get_path('include'), np.get_include()]
    includes += [PREFIX / 'include', *(PREFIX / 'include').iterdir()]
    subprocess.run(
        [
            'g++' if sources[0].suffix == '.cpp' else 'gcc',
            *('-O1', '-w', '-fPIC', '-shared', '-o', target, *sources),
            *(f'-I{include}' for include in includes),
            f'-DROSIDL_GENERATOR_C_BUILDING_DLL_{PACKAGE}',
            *(f'-L{folder}', f'-L{PREFIX / "lib"}', '-Wl,--allow-shlib-undefined'),
            *(f'-l{name}' for name in links),
        ],
        check=True,
    )


def main() -> None:
    """Build into the folder that the command line names."""
    folder = Path(sys.argv[1]).absolute()
    os.environ['AMENT_PREFIX_PATH'] = str(PREFIX)
    generate(folder)
    compile_all(folder)


if __name__ == '__main__':
    main()
