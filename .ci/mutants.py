"""Count which seeded faults of the product the tests notice; cosmic-ray makes the faults.

    PYTEST_ADDOPTS=-n2 python .ci/mutants.py lines TESTS...   # which test runs which line
    python .ci/mutants.py judge TABLE.csv FILES...     # a sample of FILES, against these tests
    python .ci/mutants.py judge TABLE.csv --again OLD.csv   # what is killed in OLD.csv

Needs `pip install cosmic-ray` beside the packages of requirements-test.txt. The sample is fixed:
mutants are ordered by a hash of what they change, and of 100 lines the first --per-100 are taken. A
mutant is judged by the tests that run its line in process, the quickest first, until one fails.
Sources are changed in place and restored: use a clone that nothing else uses. A table that exists
is continued.
"""

import argparse
import csv
import hashlib
import itertools
import os
import sqlite3
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import cosmic_ray.plugins
import pytest
from cosmic_ray.commands.init import _all_work_items
from cosmic_ray.mutating import mutate_code

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent.name for path in ROOT.glob('*/package.xml'))
LINES, SECONDS, CHOICE = (ROOT / 'build' / name for name in ('lines.db', 'tests.xml', 'chosen'))
SEPARATOR = '\n\n'  # in no name of a test
MUTANT = 'file', 'line', 'operator', 'occurrence'
# of annotations; of what a cache gives back
SKIPPED = 'BitOr', 'RemoveDecorator', 'NoOp'
TIME_LIMIT_S = 200
MOST_S = 40  # of tests for a mutant
IN_PROCESS = 'not ros and not slow and not alone and not nightly'
SEEN_BY = """
    select context, numbits from line_bits
    join file on file.id = file_id join context on context.id = context_id where path like ?
"""


def run_tests(*arguments, **options):
    """Run the tests in process that `arguments` name, with the same examples each time."""
    command = sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-m', IN_PROCESS
    paths = os.pathsep.join([str(ROOT / '.ci'), os.environ.get('PYTHONPATH', '')])
    environment = {**os.environ, 'PYTHONPATH': paths, 'PROPERTY_SEED': '1'}
    environment['COVERAGE_FILE'] = str(LINES)
    return subprocess.run(
        [*command, *arguments], cwd=ROOT, check=False, text=True, env=environment, **options
    )


@pytest.hookimpl(trylast=True)  # after the order of conftest.py
def pytest_collection_modifyitems(items):
    """Keep what is in CHOICE, in its order: this module is a plug-in of the pytest that judges."""
    places = {test: place for place, test in enumerate(CHOICE.read_text().split(SEPARATOR))}
    items[:] = sorted(
        (item for item in items if item.nodeid in places), key=lambda item: places[item.nodeid]
    )


def record_lines(tests):
    """Write which test runs which line, and how long each takes; return the exit code."""
    LINES.parent.mkdir(exist_ok=True)
    covered = [f'--cov={name}' for name in PACKAGES]
    files = '--cov-report=', f'--junitxml={SECONDS}', '-o', 'junit_family=xunit1'
    return run_tests(*tests, *covered, '--cov-context=test', *files).returncode


def seconds_of_tests():
    """Return how long each test took, by its node id."""
    cases = ET.parse(SECONDS).iter('testcase')
    return {f'{case.get("file")}::{case.get("name")}': float(case.get('time')) for case in cases}


def tests_of(mutant, seconds):
    """Return the node ids of the tests that run the line of `mutant`, the quickest first."""
    byte, bit = divmod(int(mutant['line']), 8)
    with sqlite3.connect(LINES) as database:
        rows = database.execute(SEEN_BY, [f'%/{mutant["file"]}']).fetchall()
    # a context is `node id|run`, or empty for what runs on import
    runs = {
        context.rpartition('|')[0]
        for context, bits in rows
        if byte < len(bits) and bits[byte] >> bit & 1
    }
    ordered = sorted(runs - {''}, key=lambda test: seconds.get(test, 1.0))
    ends = itertools.accumulate(seconds.get(test, 1.0) for test in ordered)
    return [test for test, end in zip(ordered, ends, strict=True) if end <= MOST_S]


def sample(file, per_100):
    """Return the mutants of `file` that are judged, as rows of the table."""
    mutants = [
        dict(zip(MUTANT, (file, m.start_pos[0], m.operator_name, m.occurrence), strict=True))
        for item in _all_work_items([ROOT / file], {})
        for m in item.mutations
        if not any(name in m.operator_name for name in SKIPPED)
    ]
    mutants.sort(key=lambda row: hashlib.sha256(repr(sorted(row.items())).encode()).digest())
    lines = len((ROOT / file).read_text().splitlines())
    return mutants[: round(lines * per_100 / 100)]


def judge(mutant, seconds):
    """Return killed, survived, not run or undecided, and the test that killed."""
    tests = tests_of(mutant, seconds)
    if not tests:
        return 'not run', ''
    CHOICE.write_text(SEPARATOR.join(tests))
    files = dict.fromkeys(test.partition('::')[0] for test in tests)
    path = ROOT / mutant['file']
    source = path.read_text()
    operator = cosmic_ray.plugins.get_operator(mutant['operator'])()
    path.write_text(mutate_code(source, operator, int(mutant['occurrence'])))
    try:
        run = run_tests('-x', '-p', 'mutants', *files, timeout=TIME_LIMIT_S, capture_output=True)
    except subprocess.TimeoutExpired:
        return 'killed', 'time limit'
    finally:
        path.write_text(source)
    failed = [x.split()[1] for x in run.stdout.splitlines() if x.startswith(('FAILED', 'ERROR'))]
    # the product may be broken so that pytest cannot even start
    results = {0: 'survived', 5: 'undecided'}
    return results.get(run.returncode, 'killed'), failed[0] if failed else ''


def judge_all(options):
    """Judge the mutants that the table does not have yet; return the exit code."""
    if options.again:
        with options.again.open() as table:
            mutants = [row for row in csv.DictReader(table) if row['result'] == 'killed']
    else:
        mutants = [row for file in options.files for row in sample(file, options.per_100)]
    judged = set()
    if options.table.exists():
        with options.table.open() as table:
            judged = {tuple(row[name] for name in MUTANT) for row in csv.DictReader(table)}
    seconds = seconds_of_tests()
    with options.table.open('a') as table:
        writer = csv.writer(table)
        if not judged:
            writer.writerow((*MUTANT, 'result', 'test'))
        for mutant in mutants:
            key = tuple(str(mutant[name]) for name in MUTANT)
            if key not in judged:
                writer.writerow((*key, *judge(mutant, seconds)))
                table.flush()
    return 0


def main():
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest='command', required=True)
    commands.add_parser('lines').add_argument('tests', nargs='+', help='folders of tests')
    parser_of_judge = commands.add_parser('judge')
    parser_of_judge.add_argument('table', type=Path)
    parser_of_judge.add_argument('files', nargs='*')
    parser_of_judge.add_argument('--per-100', type=float, default=1.5)
    parser_of_judge.add_argument('--again', type=Path, metavar='OLD.csv')
    options = parser.parse_args()
    return record_lines(options.tests) if options.command == 'lines' else judge_all(options)


if __name__ == '__main__':
    sys.exit(main())
