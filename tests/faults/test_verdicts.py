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


def test_the_table_has_a_row_for_every_fault_and_says_what_failed():
    first, second, *others = catalogue.load()
    made = verdict_of(first, 'a' * 40, remarks=('is stopped',), found='stopped', nonsense=2)
    rows = table.block([first, second, *others], {first.name: made}).splitlines()
    assert rows[0].startswith(f'0 of 1 as expected, {1 + len(others)} not run, 2 commands')
    assert '| stopped **no** | 0.00 | is stopped |' in rows[6]
    assert '| not run |' in rows[7]
    assert len(rows) == 8 + len(others)


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


class Tried:
    """Faults that nothing is run for: what a ring would have left is given."""

    def __init__(self, monkeypatch, ending=('OK', 0.0, ('OK',), ''), stood=(0.0,), **evidence):
        self.runs, self.stood, self.evidence = [], stood, {'begins_ns': 1, **evidence}
        self.waits = 0
        monkeypatch.setattr(ring, 'drive', self.drive)
        monkeypatch.setattr(stalls, 'wait_until_calm', self.wait)
        monkeypatch.setattr(suite, 'readable', lambda folder: None)
        monkeypatch.setattr(suite, 'harmful', lambda fault, bag: 0)
        monkeypatch.setattr(states, 'ending', lambda *given: states.Ending(*ending))

    def wait(self):
        self.waits += 1

    def drive(self, fault, folder, domain):
        stall_s = self.stood[min(len(self.runs), len(self.stood) - 1)]
        self.runs.append(folder)
        folder.mkdir(parents=True)
        places = dict.fromkeys(('folder', 'bag', 'witness'), folder)
        given = {**places, 'plant': 0, 'hung': (), 'ended': (), **self.evidence}
        return ring.Evidence(**given, stall_s=stall_s)


def fault_of(mode, expect='OK'):
    return next(f for f in catalogue.load() if f.mode == mode and f.expect == expect)


@pytest.mark.parametrize(('mode', 'tries'), [('realtime', 2), ('lockstep', 1)])
def test_a_car_that_is_never_ok_before_the_fault_has_failed_whatever_it_ended_in(
    monkeypatch, tmp_path, mode, tries
):
    tried = Tried(monkeypatch, ending=('OK', 0.0, ('OK',), 'degraded (shifted: late)'))
    verdict = suite.attempt(fault_of(mode), tmp_path, 0)
    assert verdict.remarks == (f'{suite.NOT_CALM}: degraded (shifted: late)',)
    assert (verdict.passed, verdict.tries, len(tried.runs)) == (False, tries, tries)
    assert tried.waits == tries - 1


def test_nothing_excuses_a_command_that_must_not_be(monkeypatch, tmp_path):
    Tried(monkeypatch, ending=('OK', 0.0, ('OK',), 'degraded (shifted: late)'), stood=(0.3,))
    monkeypatch.setattr(suite, 'harmful', lambda fault, bag: 1)
    verdict = suite.attempt(fault_of('realtime'), tmp_path, 0)
    assert (verdict.passed, verdict.tries) == (False, 1)


def test_a_run_that_says_nothing_about_the_fault_is_followed_by_one_that_does(
    monkeypatch, tmp_path
):
    Tried(monkeypatch)
    before = iter(['degraded (not a word)', '', ''])
    monkeypatch.setattr(
        states, 'ending', lambda *given: states.Ending('stopped', 0.0, ('stopped',), next(before))
    )
    verdict = suite.attempt(fault_of('realtime'), tmp_path, 0)
    assert (verdict.remarks, verdict.tries) == (('is stopped',), 2)
    assert verdict.earlier == ('is stopped', f'{suite.NOT_CALM}: degraded (not a word)')
    assert 'try 2; before: is stopped; not OK' in suite.row(verdict)


@pytest.mark.parametrize(
    ('mode', 'begins_ns', 'stall_s', 'tries'),
    [
        ('realtime', 1, stalls.STALL_S, 1),  # as long as a tick that comes late
        ('realtime', 1, stalls.STALL_S + 0.01, suite.TRIES),
        ('lockstep', 1, 1.0, 1),  # a drive in lockstep waits
        ('lockstep', None, 0.0, 1),
        ('lockstep', None, 1.0, suite.TRIES),
    ],
)
def test_only_a_measured_stall_that_matters_is_a_reason_to_try_again(
    monkeypatch, tmp_path, mode, begins_ns, stall_s, tries
):
    late = ('stopped', 0.0, ('OK', 'stopped'), '')
    Tried(monkeypatch, ending=late, stood=(stall_s,), begins_ns=begins_ns)
    verdict = suite.attempt(fault_of(mode), tmp_path, 0)
    assert (verdict.passed, verdict.tries) == (False, tries)


def test_an_interrupted_suite_goes_on_with_what_has_no_verdict_on_this_commit(
    monkeypatch, tmp_path
):
    first, second, third = catalogue.load()[:3]
    at = ['a' * 40]
    monkeypatch.setattr(suite.notes, 'commit', lambda: at[0])
    tried = Tried(monkeypatch)
    suite.run([first, second], tmp_path, 0)
    again = suite.run([first, second, third], tmp_path, 0)
    assert [path.name for path in tried.runs] == [first.name, second.name, third.name]
    assert [one.name for one in again] == [first.name, second.name, third.name]
    assert verdicts.load(tmp_path / verdicts.KEPT).keys() == {v.name for v in again}

    for commit in ('b' * 40, 'b' * 40 + '-dirty', 'b' * 40 + '-dirty', '', ''):
        at[0], before = commit, len(tried.runs)
        suite.run([second], tmp_path, 0)
        assert [path.name for path in tried.runs[before:]] == [second.name], commit
    kept = json.loads(Path(tmp_path, verdicts.KEPT).read_text())
    assert [(one['name'], one['commit']) for one in kept] == [
        (first.name, 'a' * 40),
        (third.name, 'a' * 40),
        (second.name, ''),
    ]
