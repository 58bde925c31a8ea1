"""What is installed for tests: by pip into an environment that was empty, and by colcon."""

import os
import shutil
import sys

import pytest
from installation import PACKAGES, ROOT, environment, make_environment, run_checked
from session_cache import build_once

MADE = shutil.ignore_patterns('build', '*.egg-info', '__pycache__', 'runs')


@pytest.fixture(scope='session')
def sources(tmp_path_factory):
    """Copies of the packages, in which builds may leave files."""
    return copy_sources(tmp_path_factory.mktemp('sources'))


def copy_sources(folder):
    return [shutil.copytree(ROOT / name, folder / name, ignore=MADE) for name in PACKAGES]


@pytest.fixture(scope='session')
def empty(tmp_path_factory):
    """Return an interpreter without any of our packages, but with all that tests need."""
    folder = build_once(
        tmp_path_factory,
        'empty',
        lambda made: make_environment(made / 'venv', 'requirements-test.txt'),
    )
    return folder / 'venv/bin/python'


@pytest.fixture(scope='session')
def wheels(tmp_path_factory, sources):
    """The five wheels."""
    folder = tmp_path_factory.mktemp('wheels')
    pip = [sys.executable, '-m', 'pip', 'wheel', '--no-index', '--no-deps', '--no-build-isolation']
    run_checked([*pip, '--wheel-dir', folder, *sources])
    return sorted(folder.glob('*.whl'))


@pytest.fixture(scope='session')
def installed(tmp_path_factory, wheels):
    """An interpreter with what `make demo` installs, our packages as wheels, and no more."""
    python = make_environment(tmp_path_factory.mktemp('installed') / 'venv')
    pip = [sys.executable, '-m', 'pip', '--python', python, 'install']
    run_checked([*pip, '--no-index', '--no-deps', *wheels])
    return python


@pytest.fixture(scope='session')
def colcon(tmp_path_factory, empty):
    """Build the packages with colcon; return the environment that `install/setup.bash` makes.

    The interpreter of the build knows our packages from there only.
    """

    def build(base):
        (base / 'sources').mkdir()
        places = ['--build-base', base / 'build', '--install-base', base / 'install']
        places += ['--base-paths', *copy_sources(base / 'sources')]
        run_checked([empty, '-m', 'colcon', '--log-base', base / 'log', 'build', *places], cwd=base)

    base = build_once(tmp_path_factory, 'colcon', build)
    # as `source venv/bin/activate` does, and then `source install/setup.bash`
    active = environment(PATH=f'{empty.parent}:{os.environ["PATH"]}')
    command = ['bash', '-c', f'source {base}/install/setup.bash && env -0']
    pairs = (entry.split('=', 1) for entry in run_checked(command, env=active).split('\0'))
    return {pair[0]: pair[1] for pair in pairs if len(pair) == 2}
