"""How fault runs are evaluated, retried and saved, and their table."""

import json
from pathlib import Path

import catalogue
import fault_results
import fault_run
import faults_table
import pytest
import stalls
import states
import suite

from bags.errors import BagError


def test_the_table_has_a_row_for_every_fault_with_its_deviations():
    first, second, *others = catalogue.load()
    result = result_of(
        first, 'a' * 40, remarks=('is stopped',), final_state='stopped', invalid_commands=2
    )
    rows = faults_table.block([first, second, *others], {first.name: result}).splitlines()
    assert rows[0] == (
        f'0 of 1 as expected, 0 retried, 2 invalid commands. {1 + len(others)} not run.'
    )
    assert '| stopped **no** | 0.00 | 1 | is stopped |' in rows[6]
    assert '| not run |' in rows[7]
    assert len(rows) == 8 + len(others)


def test_the_table_names_retries_and_their_reasons():
    first, *others = catalogue.load()
    result = result_of(first, 'a' * 40, tries=2, first_try=('too late',), settled_s=0.5)
    rows = faults_table.block([first, *others], {first.name: result}).splitlines()
    assert rows[0].startswith('1 of 1 as expected, 1 retried, 0 invalid commands')
    assert '| 0.50 | 2 | first try: too late |' in rows[6]


def result_of(fault, commit, **given):
    bound = {'expected': fault.expect, 'final_state': fault.expect, 'within_s': fault.within_s}
    known = {'settled_s': 0.0, 'visited': (), 'invalid_commands': 0, 'remarks': (), 'stall_s': 0.0}
    return fault_results.FaultResult(
        **{'name': fault.name, 'commit': commit, **bound, **known, **given}
    )


def test_the_table_names_the_commits_of_older_rows():
    first, second, third, *others = catalogue.load()
    older, newer, changed = 'a' * 40, 'b' * 40, 'b' * 40 + '-dirty'
    found = {
        first.name: result_of(first, older, at='2026-01-02T00:00:00', load=0.5, machine='M'),
        second.name: result_of(second, newer, at='2026-01-03T00:00:00', load=2.0, machine='M'),
        third.name: result_of(third, changed, at='2026-01-01T00:00:00', load=1.0, machine='M'),
    }
    rows = faults_table.block([first, second, third, *others], found).splitlines()
    assert rows[2] == (
        '1 on commit `bbbbbbbbbb`, 1 on the older `aaaaaaaaaa`, 1 on the older `bbbbbbbbbb` with '
        'changes. M. Load average at the start of a fault: 0.5 to 2.0, median 1.0.'
    )
    notes = [row.split('|')[-2].strip() for row in rows[6:9]]
    assert notes == ['on `aaaaaaaaaa`', '', 'on `bbbbbbbbbb` with changes']


def test_a_table_of_other_expectations_or_without_results_is_refused():
    first, *others = catalogue.load()
    result = result_of(first, 'a' * 40, within_s=first.within_s + 1.0)
    with pytest.raises(faults_table.TableError, match='the run expected'):
        faults_table.block([first, *others], {first.name: result})
    with pytest.raises(faults_table.TableError, match='no result'):
        faults_table.block([first, *others], {})


CALM = states.FinalState('OK', 0.0, ('OK',), '')
NOT_OK_BEFORE = CALM._replace(before='degraded (shifted: late)')
LATE = CALM._replace(settled_s=100.0)
STALL_S = stalls.STALL_S + 0.01


class FakeRuns:
    """Replaces the runs of faults: the final state of each run is given."""

    def __init__(self, monkeypatch, endings=(CALM,), stall_s=0.0, **evidence):
        self.runs, self.endings, self.stall_s = [], endings, stall_s
        self.evidence = {'begins_ns': 1, **evidence}
        self.waits = 0
        monkeypatch.setattr(fault_run, 'run_fault', self.run_fault)
        monkeypatch.setattr(stalls, 'wait_until_calm', self.wait)
        monkeypatch.setattr(suite, 'load_bag', lambda folder: None)
        monkeypatch.setattr(suite, 'count_invalid_commands', lambda fault, bag: 0)
        monkeypatch.setattr(states, 'final_state', self.final_state)

    def wait(self):
        self.waits += 1

    def final_state(self, *given):
        return self.endings[min(len(self.runs), len(self.endings)) - 1]

    def run_fault(self, fault, folder, domain):
        self.runs.append(folder)
        folder.mkdir(parents=True)
        places = dict.fromkeys(('folder', 'bag', 'witness'), folder)
        given = {**places, 'plant': 0, 'hung': (), 'ended': (), **self.evidence}
        return fault_run.Evidence(**given, stall_s=self.stall_s)


def fault_of(mode):
    return faults_of(mode)[0]


def faults_of(mode):
    return [f for f in catalogue.load() if f.mode == mode and f.expect == 'OK']


def run_one(mode, out):
    (result,) = suite.run_faults([fault_of(mode)], out, suite.Retries())
    return result


@pytest.mark.parametrize('ending', [NOT_OK_BEFORE, LATE])
def test_a_late_run_on_a_stalled_machine_is_retried_once(monkeypatch, tmp_path, ending):
    fakes = FakeRuns(monkeypatch, [ending, CALM], STALL_S)
    result = run_one('realtime', tmp_path)
    assert (result.passed, result.tries, len(fakes.runs), fakes.waits) == (True, 2, 2, 1)
    assert f'(try 2; before: {"; ".join(result.first_try)})' in suite.row(result)
    assert result.first_try[1:] == (f'the machine stalled for {STALL_S:.2f} s',)


def test_a_run_that_is_late_twice_has_failed(monkeypatch, tmp_path):
    fakes = FakeRuns(monkeypatch, [NOT_OK_BEFORE], STALL_S)
    result = run_one('realtime', tmp_path)
    assert result.remarks == (f'{fault_results.NOT_OK_BEFORE}: degraded (shifted: late)',)
    assert (result.passed, result.tries, len(fakes.runs)) == (False, 2, 2)


def test_a_run_that_is_not_ok_before_its_fault_is_retried_once_without_a_stall(
    monkeypatch, tmp_path
):
    fakes = FakeRuns(monkeypatch, [NOT_OK_BEFORE, CALM], 0.0)
    result = run_one('realtime', tmp_path)
    assert (result.passed, result.tries, len(fakes.runs), fakes.waits) == (True, 2, 2, 1)
    assert result.first_try[0] == f'{fault_results.NOT_OK_BEFORE}: degraded (shifted: late)'


@pytest.mark.parametrize(
    ('ending', 'mode', 'stall_s'),
    [(LATE, 'realtime', stalls.STALL_S), (LATE, 'lockstep', 1.0), (NOT_OK_BEFORE, 'lockstep', 1.0)],
)
def test_a_run_that_is_late_without_a_stall_or_in_lockstep_has_failed(
    monkeypatch, tmp_path, ending, mode, stall_s
):
    fakes = FakeRuns(monkeypatch, [ending, CALM], stall_s)
    result = run_one(mode, tmp_path)
    assert (result.passed, result.tries, len(fakes.runs)) == (False, 1, 1)


@pytest.mark.parametrize(
    ('ending', 'evidence', 'remark'),
    [
        (LATE._replace(state='stopped'), {}, 'is stopped'),
        (LATE._replace(state='braking'), {}, 'is braking'),
        (LATE, {'hung': ('controller',)}, 'hung: controller'),
        (NOT_OK_BEFORE, {'ended': ('scenario',)}, 'ended early: scenario'),
        (CALM, {'begins_ns': None}, 'the run never reached the fault'),
    ],
)
def test_a_stall_explains_nothing_but_lateness(monkeypatch, tmp_path, ending, evidence, remark):
    fakes = FakeRuns(monkeypatch, [ending, CALM], STALL_S, **evidence)
    result = run_one('realtime', tmp_path)
    assert remark in result.remarks
    assert (result.passed, result.tries, len(fakes.runs)) == (False, 1, 1)


def test_a_stall_explains_no_invalid_command(monkeypatch, tmp_path):
    fakes = FakeRuns(monkeypatch, [LATE, CALM], STALL_S)
    monkeypatch.setattr(suite, 'count_invalid_commands', lambda fault, bag: 1)
    result = run_one('realtime', tmp_path)
    assert (result.passed, result.tries, len(fakes.runs)) == (False, 1, 1)


def test_a_stall_explains_no_unreadable_bag(monkeypatch, tmp_path):
    def unreadable(folder):
        raise BagError('no bag')

    fakes = FakeRuns(monkeypatch, [LATE, CALM], STALL_S)
    monkeypatch.setattr(suite, 'load_bag', unreadable)
    result = run_one('realtime', tmp_path)
    assert 'no bag' in result.remarks
    assert (result.passed, result.tries, len(fakes.runs)) == (False, 1, 1)


def test_a_suite_retries_two_faults_and_the_third_late_one_fails(monkeypatch, tmp_path):
    FakeRuns(monkeypatch, [LATE, CALM, LATE, CALM, LATE, CALM], STALL_S)
    found = suite.run_suite(faults_of('realtime')[:4], tmp_path)
    assert [(one.passed, one.tries) for one in found] == [
        (True, 2),
        (True, 2),
        (False, 1),
        (True, 1),
    ]
    assert fault_results.summarize(found).startswith('3 of 4 as expected, 2 retried, ')


def test_a_continued_suite_has_no_more_retries_than_an_uninterrupted_one(monkeypatch, tmp_path):
    monkeypatch.setattr(suite.provenance, 'commit', lambda: 'a' * 40)
    monkeypatch.setattr(fault_results.provenance, 'commit', lambda: 'a' * 40)
    faults = faults_of('realtime')[:3]
    FakeRuns(monkeypatch, [LATE, CALM, LATE, CALM], STALL_S)
    assert [one.tries for one in suite.run_suite(faults[:2], tmp_path)] == [2, 2]
    FakeRuns(monkeypatch, [LATE, CALM], STALL_S)
    assert [one.passed for one in suite.run_suite(faults, tmp_path)] == [True, True, False]


def test_an_interrupted_suite_continues_with_the_faults_without_a_result_on_this_commit(
    monkeypatch, tmp_path
):
    first, second, third = catalogue.load()[:3]
    at = ['a' * 40]
    monkeypatch.setattr(suite.provenance, 'commit', lambda: at[0])
    fakes = FakeRuns(monkeypatch)
    suite.run_suite([first, second], tmp_path)
    again = suite.run_suite([first, second, third], tmp_path)
    assert [path.name for path in fakes.runs] == [first.name, second.name, third.name]
    assert [one.name for one in again] == [first.name, second.name, third.name]
    assert fault_results.load(tmp_path / fault_results.RESULTS_FILE).keys() == {
        v.name for v in again
    }

    for commit in ('b' * 40, 'b' * 40 + '-dirty', 'b' * 40 + '-dirty', '', ''):
        at[0], before = commit, len(fakes.runs)
        suite.run_suite([second], tmp_path)
        assert [path.name for path in fakes.runs[before:]] == [second.name], commit
    kept = json.loads(Path(tmp_path, fault_results.RESULTS_FILE).read_text())
    assert [(one['name'], one['commit']) for one in kept] == [
        (first.name, 'a' * 40),
        (third.name, 'a' * 40),
        (second.name, ''),
    ]
