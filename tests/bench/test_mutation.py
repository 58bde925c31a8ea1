"""A mutant counts as killed where the tests fail, and as a survivor where they pass."""

import mutation
import pytest

SOURCE = 'def least(a, b):\n    return min(a, b)\n'
TEST = 'import small\n\n\ndef test_least():\n    assert small.least(1, 2) == 1\n'


@pytest.fixture
def target(tmp_path, monkeypatch):
    """Return a module with one test; two mutants of it, of which one changes nothing."""
    (tmp_path / 'small.py').write_text(SOURCE)
    (tmp_path / 'test_small.py').write_text(TEST)
    mutants = SOURCE.replace('min', 'max'), SOURCE.replace('(a, b)', '(b, a)')
    monkeypatch.setattr(mutation, 'mutants', lambda source: iter(mutants))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr('sys.dont_write_bytecode', True)
    return mutation.Target('small', 'small.py', (str(tmp_path / 'test_small.py'),))


def test_killed_and_surviving_mutants_are_told_apart(target, tmp_path):
    score = mutation.run(target, tmp_path)
    assert (score.mutants, score.killed) == (2, 50.0)
    assert '+def least(b, a):' in score.survivors[0]
    assert (tmp_path / 'small.py').read_text() == SOURCE


def test_a_module_whose_tests_fail_has_no_score(target, tmp_path):
    (tmp_path / 'test_small.py').write_text(TEST.replace('== 1', '== 2'))
    with pytest.raises(RuntimeError, match='fails without any mutation'):
        mutation.run(target, tmp_path)


@pytest.mark.parametrize('target', mutation.TARGETS, ids=lambda target: target.name)
def test_the_files_of_every_target_exist(target):
    for name in (target.module, *target.tests):
        assert (mutation.ROOT / name).is_file()
