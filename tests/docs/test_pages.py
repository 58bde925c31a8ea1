"""Every command, file and snippet of the quickstart, the tutorials and the how-to pages works.

A page runs from its text, in order, in a folder that looks like a clone to the reader
(`tutorial_page`).
"""

import os
import re
import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest
import tutorial_page
from installation import PACKAGES, ROOT
from recorded_runs import DEMO, PRINTED, RUNS, run_arguments

from msgs_yaml import share

DOCS = ROOT / 'docs'
# pages whose commands something else runs
ELSEWHERE = {
    'commands.md': 'tests/docs/test_readme_commands.py',
    'index.md': 'a table of contents',
    'managed_nodes.md': 'tests/ros/test_life_cycle.py',
    'packages.md': '`make wheels_test`',
    'python.md': 'tests/docs/test_python_examples.py',
    'ubuntu.md': 'tests/docs/test_readme_commands.py',
}
PAGES = [
    DOCS / 'quickstart.md',
    *(p for p in sorted(DOCS.glob('tutorials/*.md')) if p.name not in ELSEWHERE),
    *(p for p in sorted(DOCS.glob('howto/*.md')) if p.name not in ELSEWHERE),
]
# In the first lines of a page: `clone` has copies of the packages, which the page changes; `nodes`
# starts nodes of ROS; `driven` has the runs of `make demo`; `demo` calls it; `quick` runs in `make
# test`; `launch` has `ros2 launch experiments FILE` and a ROS domain for the whole page.
ABOUT = re.compile(r'<!-- page: (.+?) -->')
# why a block is not run, and in how many blocks
ONLY_THE_READER = {
    'sets up the clone, as the tests do before they begin': 1,
    'needs an installation of ROS 2': 2,
    'changes the system of the reader': 1,
    'needs a second machine': 3,
}
# as the command does it where `launch` is installed, and with its stand-in elsewhere
ROS2_LAUNCH = """#!/bin/sh
test "$1 $2" = 'launch experiments' && file={launch_files}/$3 && shift 3 &&
exec {python} {runner} $file "$@"
"""
# what pip does after a change, PYTHONPATH does here; a run takes a free domain, as in the terminal
# of a reader, where that of the other terminals is not set; what `make demo` drives and prints, the
# command in its recipe has driven and printed for all tests
RECIPE = ' '.join(('.venv/bin/experiments', *run_arguments(*DEMO)))
PRELUDE = f"""
experiments() {{
    env -u ROS_DOMAIN_ID experiments "$@"
}}
make() {{
    case "$*" in
    setup)
        grep -q '^setup:' Makefile;;
    demo)
        command make -n demo | grep -xF '{RECIPE}' > /dev/null
        cp -r "$DRIVEN/{RUNS}" {RUNS}
        cat "$DRIVEN/{PRINTED}";;
    *)
        command make "$@";;
    esac
}}
"""


def about(page: Path) -> set[str]:
    found = ABOUT.search(page.read_text())
    return set(found[1].split()) if found else set()


def marks(page):
    words = about(page)
    if 'nodes' in words:
        yield pytest.mark.ros
    elif 'quick' not in words:
        yield pytest.mark.slow


def parameters():
    for page in PAGES:
        name = page.relative_to(DOCS).with_suffix('').as_posix()
        yield pytest.param(page, id=name, marks=list(marks(page)))


@pytest.fixture
def home(tmp_path):
    """Return a folder with what a reader finds in a clone."""
    for name in ('Makefile', '.ci', *(file.name for file in ROOT.glob('requirements*.txt'))):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / '.venv').symlink_to(sys.prefix)
    for name in ('bags/reference', 'experiments/config', 'paper/picture', 'docs/examples'):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def copy_packages(folder):
    """Give a folder copies of the packages, and return where Python finds them."""
    ignored = shutil.ignore_patterns('__pycache__', 'runs', 'build', '*.egg-info')
    for package in PACKAGES:
        shutil.rmtree(folder / package, ignore_errors=True)
        shutil.copytree(ROOT / package, folder / package, ignore=ignored)
    return os.pathsep.join(str(folder / package) for package in PACKAGES)


def give_launch(folder):
    """Write the program `ros2` of a page; return its folder."""
    (folder / 'bin').mkdir()
    ros2 = folder / 'bin/ros2'
    runner = ROOT / 'tests/experiments/run/run_launch_file.py'
    launch_files = share.path('experiments', 'launch')
    ros2.write_text(
        ROS2_LAUNCH.format(launch_files=launch_files, python=sys.executable, runner=runner)
    )
    ros2.chmod(0o755)
    return ros2.parent


@pytest.mark.timeout(900, func_only=True)
@pytest.mark.parametrize('page', parameters())
def test_a_page_does_what_it_says(page, home, request):
    words = about(page)
    paths = os.pathsep.join((str(Path(sys.prefix, 'bin')), os.environ['PATH']))
    environment = os.environ | {'PATH': paths, 'COLUMNS': '120', 'MPLBACKEND': 'agg'}
    if 'clone' in words:
        environment['PYTHONPATH'] = copy_packages(home)
    if 'launch' in words:
        environment['PATH'] = f'{give_launch(home)}{os.pathsep}{paths}'
        environment['ROS_DOMAIN_ID'] = str(request.getfixturevalue('domain'))
    if words & {'demo', 'driven'}:
        runs = request.getfixturevalue('recorded_runs')
        environment['DRIVEN'] = str(runs.folder)
    if 'driven' in words:
        shutil.copytree(runs.out / runs.scenario, home / 'bags/runs' / runs.scenario)
    with tutorial_page.Session(home, environment, PRELUDE) as reader:
        for block in tutorial_page.find_blocks(page.read_text()):
            try:
                reader.do(block)
            except AssertionError as error:
                raise AssertionError(f'{page.name}:{block.line}: {error}') from None


def test_blocks_that_only_the_reader_can_run_are_counted():
    blocks = [b for page in PAGES for b in tutorial_page.find_blocks(page.read_text())]
    assert Counter(b.value for b in blocks if b.kind == 'not run') == ONLY_THE_READER
    assert sum(b.kind in ('run', 'run as', 'terminal') for b in blocks) > 40
