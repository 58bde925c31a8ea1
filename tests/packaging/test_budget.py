"""The budget refuses what is above it, says what, and is no budget of nothing."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TABLE = 'car  {}  lines  car/*.py car/*.c\nproduct  1  files  *.py :!tests  # no tests\n'


def git(folder, *words):
    subprocess.run(['git', '-C', folder, *words], check=True, capture_output=True)


@pytest.fixture
def measure(tmp_path):
    """Return measure(table) -> (exit code, stdout, stderr) in a clone with two lines of a car."""
    files = {
        'car/a/drive.py': '"""Drive."""\n',
        'car/drive.c': '/* drive */\n',
        'tests/a.py': '\n' * 50,
        '.ci/budget.py': '',
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    git(tmp_path, 'init')
    git(tmp_path, 'add', 'car', 'tests')
    shutil.copy(ROOT / '.ci/budget.py', tmp_path / '.ci')

    def run(table):
        (tmp_path / '.ci/budget.txt').write_text(table)
        command = [sys.executable, tmp_path / '.ci/budget.py']
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        return done.returncode, done.stdout, done.stderr

    return run


def test_what_is_allowed_passes_and_is_printed(measure):
    code, table, errors = measure(TABLE.format('1000'))
    assert (code, errors) == (0, '')
    assert [line.split() for line in table.splitlines()] == [
        ['what', 'now', 'allowed'],
        ['car', '2', '1,000', 'lines'],
        ['product', '1', '1', 'files'],
    ]


def test_an_excess_is_refused_and_named(measure):
    code, table, errors = measure(TABLE.format('1'))
    assert (code, len(table.splitlines())) == (1, 3)
    assert errors == (
        'car has 2 lines, allowed 1: make it smaller, or raise the number in .ci/budget.txt in a '
        'commit that says what users get for it\n'
    )


def test_only_tracked_files_of_the_working_tree_count(measure, tmp_path):
    (tmp_path / 'car/drive.c').unlink()
    (tmp_path / 'car/more.py').write_text('\n' * 9)
    assert measure(TABLE.format('1'))[0] == 0
    git(tmp_path, 'add', 'car/more.py')
    assert 'car has 10 lines' in measure(TABLE.format('1'))[2]


@pytest.mark.parametrize(
    ('line', 'reason'),
    [
        ('lorry 5 lines lorry/*.py', 'lorry: git tracks no such file'),
        ('car 5 inches car/*.py', 'must be `WHAT NUMBER lines|files|MB PATHSPEC ...`'),
        ('car five lines car/*.py', 'must be'),
        ('car 5 lines', 'must be'),
    ],
)
def test_a_line_that_counts_nothing_is_an_error(measure, line, reason):
    code, _, error = measure(f'# comment\n{line}\n')
    assert code == 1
    assert error.startswith('error: .ci/budget.txt:2: ')
    assert reason in error


def test_without_git_nothing_is_counted(measure, tmp_path):
    shutil.rmtree(tmp_path / '.git')
    assert measure(TABLE.format('1')) == (0, 'this is no clone: nothing is counted\n', '')
