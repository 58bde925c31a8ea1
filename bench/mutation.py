"""Mutation testing: how many mutants of the gates and the fallback logic do their tests kill?

cosmic-ray makes the mutants: copies of a module with one operator, number or condition changed. The
tests of that module run against each of them, in a fork of this process with the large libraries
loaded. Prints the share of killed mutants, and the survivors as differences of the source;
docs/safety.md explains why each may survive. The exit code is 1 when a module stays below --least.

    .venv/bin/pip install cosmic-ray==8.7.0
    .venv/bin/python bench/mutation.py [--least 90] [--module gate]
"""

import argparse
import difflib
import importlib
import os
import shutil
import sys
import tempfile
import time
from importlib import util
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ('msgs_yaml', 'node_runtime', 'stage_solver', 'mpcc_controller', 'vehicle_plant')
COPIED = (*PACKAGES, 'tests', 'pyproject.toml')
LOADED = ('casadi', 'hypothesis', 'numpy', 'pytest')
TIMEOUT_S = 30.0  # of the tests of one mutant; a mutant that exceeds it is killed, too
POLL_S = 0.005


class Target(NamedTuple):
    """A module and its tests."""

    name: str
    module: str
    tests: tuple[str, ...]


TARGETS = (
    Target(
        'fallback',
        'mpcc_controller/mpcc_controller/driving/fallback.py',
        ('tests/mpcc_controller/driving/test_fallback.py',),
    ),
    Target(
        'gate of the controller',
        'mpcc_controller/mpcc_controller/driving/gate.py',
        ('tests/mpcc_controller/driving/test_gate.py',),
    ),
    Target(
        'gate of the plant',
        'vehicle_plant/vehicle_plant/gate.py',
        ('tests/vehicle_plant/test_gate.py', 'tests/vehicle_plant/test_gate_friction.py'),
    ),
)


class Score(NamedTuple):
    """The result of the mutants of one module."""

    mutants: int
    survivors: list[str]  # differences of the source

    @property
    def killed(self) -> float:
        """Share of the mutants that were killed [%]."""
        return 100 * (1 - len(self.survivors) / self.mutants)


def make_copy(folder: Path) -> None:
    """Copy what the tests need, and import it from there from now on."""
    skip = shutil.ignore_patterns('__pycache__', 'build', '*.egg-info')
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, ignore=skip)
        else:
            shutil.copy(ROOT / name, folder / name)
    os.chdir(folder)
    sys.path[:0] = [str(folder / package) for package in PACKAGES]
    # two mutants of one second and one size look alike to the cache of compiled modules
    sys.dont_write_bytecode = True
    os.environ['PYTEST_DISABLE_PLUGIN_AUTOLOAD'] = '1'  # none is needed; loading them takes longest
    for name in LOADED:
        importlib.import_module(name)


def passes(tests: tuple[str, ...]) -> bool:
    """Run tests in a fork; return whether all of them pass in time."""
    child = os.fork()
    if not child:
        import pytest

        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        os._exit(pytest.main(['-x', '-q', '-p', 'no:cacheprovider', *tests]))
    deadline = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status == 0
        time.sleep(POLL_S)
    os.kill(child, 9)
    os.waitpid(child, 0)
    return False


def mutants(source: str):
    """Yield the source of every mutant."""
    from cosmic_ray import plugins
    from cosmic_ray.mutating import mutate_code

    for name in sorted(plugins.operator_names()):
        operator = plugins.get_operator(name)
        if operator.arguments():
            continue  # needs arguments, and has none here
        occurrence = 0
        while (mutant := mutate_code(source, operator(), occurrence)) is not None:
            yield mutant
            occurrence += 1


def run(target: Target, folder: Path) -> Score:
    """Test every mutant of one module. Raises RuntimeError when the module itself fails."""
    module = folder / target.module
    source = module.read_text()
    if not passes(target.tests):
        raise RuntimeError(f'{", ".join(target.tests)} fails without any mutation')
    count, survivors = 0, []
    for mutant in mutants(source):
        module.write_text(mutant)
        count += 1
        if passes(target.tests):
            lines = source.splitlines(), mutant.splitlines()
            survivors.append('\n'.join(difflib.unified_diff(*lines, n=0, lineterm='')))
        print(f'\r{target.name}: {count} mutants, {len(survivors)} alive', end='', file=sys.stderr)
    print(file=sys.stderr)
    module.write_text(source)
    return Score(count, survivors)


def main() -> int:
    """Print survivors and scores; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--least', type=float, default=90.0, help='percent killed')
    parser.add_argument('--module', default='', help='part of the name of what to run')
    arguments = parser.parse_args()
    if util.find_spec('cosmic_ray') is None:
        print('cosmic-ray is missing: pip install cosmic-ray==8.7.0')
        return 2
    with tempfile.TemporaryDirectory() as folder:
        make_copy(Path(folder))
        chosen = [target for target in TARGETS if arguments.module in target.name]
        scores = {target.name: run(target, Path(folder)) for target in chosen}
        os.chdir(ROOT)
    for name, score in scores.items():
        for number, survivor in enumerate(score.survivors, 1):
            print(f'{name}: survivor {number}\n{survivor}\n')
    for name, (count, survivors) in scores.items():
        percent = scores[name].killed
        print(f'{name}: {count - len(survivors)} of {count} mutants killed, {percent:.1f} %')
    return int(any(score.killed < arguments.least for score in scores.values()))


if __name__ == '__main__':
    sys.exit(main())
