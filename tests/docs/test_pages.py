"""Every command, file and snippet of README, the tutorials and the guides works.

A page runs from its text, in order, in a folder that looks like a clone to the reader
(`tutorial_page`). Of pages that are not run, each command is understood with its options.
"""

import os
import re
import shlex
import shutil
import sys
from collections import Counter
from importlib import import_module
from pathlib import Path

import pytest
import tutorial_page
from installation import PACKAGES, ROOT
from recorded_runs import RUNS

from msgs_yaml import share

DOCS = ROOT / 'docs'
# pages whose commands something else runs
ELSEWHERE = {
    'commands.md': 'a list; the tests of each command, and the other pages',
    'index.md': 'a table of contents',
    'managed_nodes.md': 'tests/ros/test_life_cycle.py',
    'packages.md': '`make wheels_test`; tests/packaging/test_installed.py builds with colcon',
}
LESSONS, GUIDES = (
    [*first, *(p for p in sorted(DOCS.glob(pattern)) if p.name not in ELSEWHERE)]
    for first, pattern in (
        ((ROOT / 'README.md', DOCS / 'extending.md'), 'tutorials/*.md'),
        ((), 'howto/*.md'),
    )
)
PAGES = [*LESSONS, *GUIDES]
# In the first lines of a page: `clone` has copies of the packages, which the page changes; `nodes`
# starts nodes of ROS; `driven` has the runs of the double lane change; `demo` calls `make demo`,
# which drives there; `quick` runs in `make test`; `launch` has `ros2 launch experiments FILE` and a
# ROS domain for the whole page. `make check` runs a page that changed, or what it names: a command
# and what that imports, a node, a file of a scenario or of parameters, a module of its Python. It
# always runs those with `quick`.
ABOUT = re.compile(r'<!-- page: (.+?) -->')
ON_THE_WALL_CLOCK = '<!-- on the wall clock -->'
COMMAND = re.compile(r'\b(bags|experiments) ([a-z]+(?:-[a-z]+)?)\b')
IMPORT = re.compile(r'^ *(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?', re.MULTILINE)
WORD = re.compile(r'[a-z]\w{2,}')
NOT_RUN = [
    page
    for page in (*DOCS.rglob('*.md'), *ROOT.glob('*/README.md'))
    if {page, *page.parents}.isdisjoint({*PAGES, DOCS / 'generated'})
    if COMMAND.search(page.read_text())
]
FENCED = re.compile(r'^(```+)(\w*)\n(.*?)^\1$', re.MULTILINE | re.DOTALL)
DATA = ('{}/config/{}.yaml', '{}/scenarios/{}.yaml', '{0}/{0}/{1}.py', '{}/launch/{}.launch.py')
THIS = 'tests/docs/test_pages.py'
SHIPPED = ('bags/reference', 'paper/picture')
# why a block is not run, and in how many blocks
ONLY_THE_READER = {
    'sets up the clone, as the tests do before they begin': 1,
    'needs an installation of ROS 2': 3,
    'changes the system of the reader': 1,
    'needs a second machine': 1,
}
# as the command does it where `launch` is installed, and with its stand-in elsewhere
ROS2_LAUNCH = """#!/bin/sh
test "$1 $2" = 'launch experiments' && file={}/$3 && shift 3 &&
exec {} {} $file "$@"
"""
# what pip does after a change, PYTHONPATH does here; a run takes a free domain, as in the terminal
# of a reader, where that of the other terminals is not set; `make demo` runs its recipe on the
# pages that are about it; a recording is played at twenty times its speed, a film has few frames
PRELUDE = """
experiments() { env -u ROS_DOMAIN_ID experiments "$@"; }
bags() {
    test "$1" != play || set -- "$@" --rate 20
    test "$1" != film || set -- "$@" --fps 2
    command bags "$@"
}
make() {
    command make --dry-run "$@" > dry-run.txt
    test "${DEMO-} $*" = 'yes demo' || return 0
    grep -x '.venv/bin/experiments demo' dry-run.txt > recipe.txt
    env -u ROS_DOMAIN_ID bash -e recipe.txt
}
"""


def about(page):
    words = ABOUT.search(page.read_text())
    return set(words[1].split()) if words else set()


def names_of(page):
    """Return patterns of the page, of the tools that run it, and of what its blocks name."""
    text, about_it = page.read_text(), about(page)
    names = {page.relative_to(ROOT).as_posix(), THIS, 'tests/helpers/*_page.py'}
    names |= {'Makefile', '.ci/install.py', 'requirements*'} if 'demo' in about_it else set()
    if 'launch' in about_it:
        names |= {'experiments/launch/*', 'tests/experiments/run/run_launch_file.py'}
    blocks = '\n'.join(f'{block.value}\n{block.text}' for block in tutorial_page.find_blocks(text))
    for package in PACKAGES:
        names |= {form.format(package, word) for form in DATA for word in WORD.findall(blocks)}
        names |= {*re.findall(rf'{package}/[\w./]+', blocks)}
    for program, command in COMMAND.findall(text):
        module = ROOT / program / program / 'commands' / f'{command.replace("-", "_")}.py'
        if module.exists():
            names |= {module.relative_to(ROOT).as_posix(), *imported_by(module.read_text())}
    names |= {f'{name}/*' for name in (*SHIPPED, 'docs/examples') if name in text}
    return names | imported_by(blocks)


def imported_by(source):
    """Return patterns of the modules that Python source imports."""
    names = set()
    for path, members in IMPORT.findall(source):
        folder = path.replace('.', '/')
        names |= {f'*/{folder}.py', *(f'*/{folder}/{name}.py' for name in WORD.findall(members))}
    return names


def each(pages):
    parameters = []
    for page in pages:
        words, marks = about(page), []
        if 'quick' not in words:
            marks = [pytest.mark.ros if 'nodes' in words else pytest.mark.slow]
            marks += [pytest.mark.reads(*names_of(page))]
            # beside other tests its nodes are late, and the car stops
            marks += [pytest.mark.alone] if ON_THE_WALL_CLOCK in page.read_text() else []
        parameters.append(pytest.param(page, id=page.relative_to(ROOT).as_posix(), marks=marks))
    return pytest.mark.parametrize('page', parameters)


@pytest.fixture
def home(tmp_path):
    """Return a folder with what a reader finds in a clone."""
    for name in ('Makefile', '.ci', *(file.name for file in ROOT.glob('requirements*.txt'))):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / '.venv').symlink_to(sys.prefix)
    (tmp_path / 'tmp').mkdir()
    for name in (*SHIPPED, 'docs/examples', 'docs/requirements.txt'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
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
    ros2.write_text(ROS2_LAUNCH.format(share.path('experiments', 'launch'), sys.executable, runner))
    ros2.chmod(0o755)
    return ros2.parent


def read(text, folder, environment):
    """Do in a folder what a page says."""
    with tutorial_page.Session(folder, environment, PRELUDE) as reader:
        for block in tutorial_page.find_blocks(text):
            try:
                reader.do(block)
            except AssertionError as error:
                raise AssertionError(f'line {block.line}: {error}') from None


def do(page, home, request):
    words = about(page)
    paths = os.pathsep.join((str(Path(sys.prefix, 'bin')), os.environ['PATH']))
    environment = os.environ | {'PATH': paths, 'COLUMNS': '120', 'MPLBACKEND': 'agg'}
    if 'clone' in words:
        environment['PYTHONPATH'] = copy_packages(home)
    if 'launch' in words:
        environment['PATH'] = f'{give_launch(home)}{os.pathsep}{paths}'
        environment['ROS_DOMAIN_ID'] = str(request.getfixturevalue('domain'))
    if 'driven' in words:
        runs = request.getfixturevalue('recorded_runs')
        shutil.copytree(runs.out / runs.scenario, home / RUNS / runs.scenario)
    if 'demo' in words:
        environment['DEMO'] = 'yes'
    read(page.read_text().replace('/tmp/', f'{home}/tmp/'), home, environment)


# a class is what one of several workers does
@pytest.mark.timeout(1800, func_only=True)
class TestLessons:
    @each(LESSONS)
    def test_a_page_does_what_it_says(self, page, home, request):
        do(page, home, request)


@pytest.mark.timeout(1800, func_only=True)
class TestGuides:
    @each(GUIDES)
    def test_a_page_does_what_it_says(self, page, home, request):
        do(page, home, request)


def test_blocks_that_only_the_reader_can_run_are_counted():
    blocks = [b for page in PAGES for b in tutorial_page.find_blocks(page.read_text())]
    assert Counter(b.value for b in blocks if b.kind == 'not run') == ONLY_THE_READER
    assert sum(b.kind in ('run', 'program', 'terminal') for b in blocks) > 50


def commands_of(page):
    """Yield the words of each command of our programs in the blocks of a page, options and all."""
    for _, language, text in FENCED.findall(page.read_text()):
        for line in text.replace('\\\n', ' ').splitlines() if language in ('', 'sh') else ():
            words = shlex.split(line, comments=True) if COMMAND.match(line) else []
            if words and not any(re.search(r'[\[(|]|\.\.\.', word) for word in words):
                yield words


@pytest.mark.parametrize('page', NOT_RUN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_each_command_of_a_page_that_is_not_run_is_understood(page, monkeypatch):
    for program, command, *words in commands_of(page):
        module = import_module(f'{program}.commands.{command.replace("-", "_")}')
        monkeypatch.setattr(module, 'run', lambda options: 0)
        assert import_module(f'{program}.cli').main([command, *words]) == 0


FAILS_AT_THE_END = 'sh -c "trap \'exit 3\' INT; echo up; while :; do sleep 0.1; done"'


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('~~~yaml\na: 1\n~~~\n', 'line 1: no kind of block: yaml'),
        ('<!-- fiel: a -->\n~~~sh\nls\n~~~\n', 'line 2: no kind of block: fiel: a'),
        ('~~~text\na\n~~~\n', 'line 1: output, but no command above it'),
        ('~~~sh\nfalse | cat\n~~~\n', 'exit code 1 of'),
        ('~~~sh\nfalse\ntrue\n~~~\n', 'exit code 1 of'),
        ('<!-- exit code: 1 -->\n~~~sh\ntrue\n~~~\n', 'exit code 0 of'),
        (f'{ON_THE_WALL_CLOCK}\n~~~sh\nexit 2\n~~~\n', 'exit code 2 of'),
        (f'<!-- terminal -->\n~~~sh\n{FAILS_AT_THE_END}\n~~~\n~~~text\nup\n~~~\n', 'exit code 3'),
        ('~~~sh\ncd /\nX=a\n~~~\n~~~sh\necho $X $PWD\n~~~\n~~~text\nb ...\n~~~\n', 'no line .b'),
        ('~~~python\nx = 0\n~~~\n~~~python\n1 / x\n~~~\n', 'ZeroDivisionError'),
        ('<!-- program -->\n~~~python\nassert 0\n~~~\n', 'exit code 1 of'),
        ('<!-- in a.py, after: x -->\n~~~python\ny\n~~~\n', "a.py has no line with 'x'"),
    ],
)
def test_a_page_that_does_not_work_fails(text, reason, tmp_path):
    (tmp_path / 'a.py').touch()
    with pytest.raises((AssertionError, ValueError), match=reason):
        read(text.replace('~~~', '```'), tmp_path, dict(os.environ))
