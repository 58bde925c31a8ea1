"""How a fault is judged and tried again, what is kept of it, and the table of the page."""

import json
from pathlib import Path

import catalogue
import pytest
import ring
import stalls
import states
import suite
import table
import verdicts

from bags.errors import BagError


def test_the_table_has_a_row_for_every_fault_and_says_what_failed():
    first, second, *others = catalogue.load()
    made = verdict_of(first, 'a' * 40, remarks=('is stopped',), found='stopped', nonsense=2)
    rows = table.block([first, second, *others], {first.name: made}).splitlines()
    assert rows[0] == (
        '0 of 1 as expected, 0 tried again, 2 commands that must not be. '
        f'{1 + len(others)} not run.'
    )
    assert '| stopped **no** | 0.00 | 1 | is stopped |' in rows[6]
    assert '| not run |' in rows[7]
    assert len(rows) == 8 + len(others)


def test_the_table_says_what_was_tried_again_and_why():
    first, *others = catalogue.load()
    made = verdict_of(first, 'a' * 40, tries=2, earlier=('too late',), settled_s=0.5)
    rows = table.block([first, *others], {first.name: made}).splitlines()
    assert rows[0].startswith('1 of 1 as expected, 1 tried again, 0 commands')
    assert '| 0.50 | 2 | first try: too late |' in rows[6]


def verdict_of(fault, commit, **given):
    bound = {'expected': fault.expect, 'found': fault.expect, 'within_s': fault.within_s}
    known = {'settled_s': 0.0, 'visited': (), 'nonsense': 0, 'remarks': (), 'stall_s': 0.0}
    return verdicts.Verdict(**{'name': fault.name, 'commit': commit, **bound, **known, **given})


def test_the_table_says_which_rows_are_of_another_commit_than_the_last():
    first, second, third, *others = catalogue.load()
    older, newer, changed = 'a' * 40, 'b' * 40, 'b' * 40 + '-dirty'
    found = {
        first.name: verdict_of(first, older, at='2026-01-02T00:00:00', load=0.5, machine='M'),
        second.name: verdict_of(second, newer, at='2026-01-03T00:00:00', load=2.0, machine='M'),
        third.name: verdict_of(third, changed, at='2026-01-01T00:00:00', load=1.0, machine='M'),
    }
    rows = table.block([first, second, third, *others], found).splitlines()
    assert rows[2] == (
        '1 on commit `bbbbbbbbbb`, 1 on the older `aaaaaaaaaa`, 1 on the older `bbbbbbbbbb` with '
        'changes. M. Load average at the start of a fault: 0.5 to 2.0, median 1.0.'
    )
    notes = [row.split('|')[-2].strip() for row in rows[6:9]]
    assert notes == ['on `aaaaaaaaaa`', '', 'on `bbbbbbbbbb` with changes']


def test_a_table_of_other_expectations_or_of_nothing_is_refused():
    first, *others = catalogue.load()
    made = verdict_of(first, 'a' * 40, within_s=first.within_s + 1.0)
    with pytest.raises(table.TableError, match='was expected'):
        table.block([first, *others], {first.name: made})
    with pytest.raises(table.TableError, match='no verdict'):
        table.block([first, *others], {})


def test_a_table_takes_the_place_of_the_one_before():
    page = f'a\n{table.BEGIN}\nold\n{table.END}\nz\n'
    assert table.written(page, 'new') == f'a\n{table.BEGIN}\nnew\n{table.END}\nz\n'
    with pytest.raises(table.TableError, match='lacks'):
        table.written('a page without', 'new')


CALM = states.Ending('OK', 0.0, ('OK',), '')
UNFIT = CALM._replace(before='degraded (shifted: late)')
LATE = CALM._replace(settled_s=100.0)
STALL_S = stalls.STALL_S + 0.01


class Tried:
    """Faults that nothing is run for: what a ring would have left is given, one for each run."""

    def __init__(self, monkeypatch, endings=(CALM,), stall_s=0.0, **evidence):
        self.runs, self.endings, self.stall_s = [], endings, stall_s
        self.evidence = {'begins_ns': 1, **evidence}
        self.waits = 0
        monkeypatch.setattr(ring, 'drive', self.drive)
        monkeypatch.setattr(stalls, 'wait_until_calm', self.wait)
        monkeypatch.setattr(suite, 'readable', lambda folder: None)
        monkeypatch.setattr(suite, 'harmful', lambda fault, bag: 0)
        monkeypatch.setattr(states, 'ending', self.ending)

    def wait(self):
        self.waits += 1

    def ending(self, *given):
        return self.endings[min(len(self.runs), len(self.endings)) - 1]

    def drive(self, fault, folder, domain):
        self.runs.append(folder)
        folder.mkdir(parents=True)
        places = dict.fromkeys(('folder', 'bag', 'witness'), folder)
        given = {**places, 'plant': 0, 'hung': (), 'ended': (), **self.evidence}
        return ring.Evidence(**given, stall_s=self.stall_s)


def fault_of(mode):
    return faults_of(mode)[0]


def faults_of(mode):
    return [f for f in catalogue.load() if f.mode == mode and f.expect == 'OK']


def attempt(mode, out):
    return suite.attempt(fault_of(mode), out, suite.Retries())


@pytest.mark.parametrize('ending', [UNFIT, LATE])
def test_a_run_that_is_late_on_a_machine_that_stands_still_is_tried_once_more(
    monkeypatch, tmp_path, ending
):
    tried = Tried(monkeypatch, [ending, CALM], STALL_S)
    verdict = attempt('realtime', tmp_path)
    assert (verdict.passed, verdict.tries, len(tried.runs), tried.waits) == (True, 2, 2, 1)
    assert f'(try 2; before: {"; ".join(verdict.earlier)})' in suite.row(verdict)
    assert verdict.earlier[1:] == (f'the machine stood still for {STALL_S:.2f} s',)


def test_a_run_that_is_late_twice_has_failed(monkeypatch, tmp_path):
    tried = Tried(monkeypatch, [UNFIT], STALL_S)
    verdict = attempt('realtime', tmp_path)
    assert verdict.remarks == (f'{verdicts.NOT_CALM}: degraded (shifted: late)',)
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, 2, 2)


def test_a_run_that_is_not_ok_before_its_fault_is_tried_once_more_without_a_stall(
    monkeypatch, tmp_path
):
    tried = Tried(monkeypatch, [UNFIT, CALM], 0.0)
    verdict = attempt('realtime', tmp_path)
    assert (verdict.passed, verdict.tries, len(tried.runs), tried.waits) == (True, 2, 2, 1)
    assert verdict.earlier[0] == f'{verdicts.NOT_CALM}: degraded (shifted: late)'


@pytest.mark.parametrize(
    ('ending', 'mode', 'stall_s'),
    [(LATE, 'realtime', stalls.STALL_S), (LATE, 'lockstep', 1.0), (UNFIT, 'lockstep', 1.0)],
)
def test_a_run_that_is_late_without_a_stall_or_in_lockstep_has_failed(
    monkeypatch, tmp_path, ending, mode, stall_s
):
    tried = Tried(monkeypatch, [ending, CALM], stall_s)
    verdict = attempt(mode, tmp_path)
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, 1, 1)


@pytest.mark.parametrize(
    ('ending', 'evidence', 'told'),
    [
        (LATE._replace(state='stopped'), {}, 'is stopped'),
        (LATE._replace(state='braking'), {}, 'is braking'),
        (LATE, {'hung': ('controller',)}, 'hung: controller'),
        (UNFIT, {'ended': ('scenario',)}, 'ended early: scenario'),
        (CALM, {'begins_ns': None}, 'the run never came to the fault'),
    ],
)
def test_a_stall_excuses_nothing_but_lateness(monkeypatch, tmp_path, ending, evidence, told):
    tried = Tried(monkeypatch, [ending, CALM], STALL_S, **evidence)
    verdict = attempt('realtime', tmp_path)
    assert told in verdict.remarks
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, 1, 1)


def test_a_stall_excuses_no_command_that_must_not_be(monkeypatch, tmp_path):
    tried = Tried(monkeypatch, [LATE, CALM], STALL_S)
    monkeypatch.setattr(suite, 'harmful', lambda fault, bag: 1)
    verdict = attempt('realtime', tmp_path)
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, 1, 1)


def test_a_stall_excuses_no_bag_that_cannot_be_read(monkeypatch, tmp_path):
    def unreadable(folder):
        raise BagError('no bag')

    tried = Tried(monkeypatch, [LATE, CALM], STALL_S)
    monkeypatch.setattr(suite, 'readable', unreadable)
    verdict = attempt('realtime', tmp_path)
    assert 'no bag' in verdict.remarks
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, 1, 1)


def test_of_all_faults_together_two_are_tried_again_and_the_third_that_is_late_fails(
    monkeypatch, tmp_path
):
    Tried(monkeypatch, [LATE, CALM, LATE, CALM, LATE, CALM], STALL_S)
    found = suite.run(faults_of('realtime')[:4], tmp_path)
    assert [(one.passed, one.tries) for one in found] == [
        (True, 2),
        (True, 2),
        (False, 1),
        (True, 1),
    ]
    assert verdicts.total(found).startswith('3 of 4 as expected, 2 tried again, ')


def test_a_suite_that_goes_on_has_no_more_tries_than_one_that_was_not_interrupted(
    monkeypatch, tmp_path
):
    monkeypatch.setattr(suite.provenance, 'commit', lambda: 'a' * 40)
    monkeypatch.setattr(verdicts.provenance, 'commit', lambda: 'a' * 40)
    faults = faults_of('realtime')[:3]
    Tried(monkeypatch, [LATE, CALM, LATE, CALM], STALL_S)
    assert [one.tries for one in suite.run(faults[:2], tmp_path)] == [2, 2]
    Tried(monkeypatch, [LATE, CALM], STALL_S)
    assert [one.passed for one in suite.run(faults, tmp_path)] == [True, True, False]


def test_verdicts_of_a_version_that_noted_more_are_read(tmp_path):
    made = verdict_of(catalogue.load()[0], 'a' * 40)
    kept = tmp_path / verdicts.KEPT
    verdicts.save(kept, {made.name: made})
    kept.write_text(json.dumps([{**one, 'calm': True} for one in json.loads(kept.read_text())]))
    assert verdicts.load(kept)[made.name].passed


def test_an_interrupted_suite_goes_on_with_what_has_no_verdict_on_this_commit(
    monkeypatch, tmp_path
):
    first, second, third = catalogue.load()[:3]
    at = ['a' * 40]
    monkeypatch.setattr(suite.provenance, 'commit', lambda: at[0])
    tried = Tried(monkeypatch)
    suite.run([first, second], tmp_path)
    again = suite.run([first, second, third], tmp_path)
    assert [path.name for path in tried.runs] == [first.name, second.name, third.name]
    assert [one.name for one in again] == [first.name, second.name, third.name]
    assert verdicts.load(tmp_path / verdicts.KEPT).keys() == {v.name for v in again}

    for commit in ('b' * 40, 'b' * 40 + '-dirty', 'b' * 40 + '-dirty', '', ''):
        at[0], before = commit, len(tried.runs)
        suite.run([second], tmp_path)
        assert [path.name for path in tried.runs[before:]] == [second.name], commit
    kept = json.loads(Path(tmp_path, verdicts.KEPT).read_text())
    assert [(one['name'], one['commit']) for one in kept] == [
        (first.name, 'a' * 40),
        (third.name, 'a' * 40),
        (second.name, ''),
    ]
