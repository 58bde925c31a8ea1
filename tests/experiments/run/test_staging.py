"""A run may be killed at any moment: an older bag survives, and nothing stays behind unsaid."""

from pathlib import Path

import pytest

from experiments.run import staging
from experiments.run.staging import StagingDirectory


class Killed(BaseException):
    """Stands for a kill: nobody may catch it."""


@pytest.fixture
def staged(tmp_path):
    """A staging directory with a recorded bag, beside an older one."""
    made = StagingDirectory(tmp_path, 'mpcc')
    made.final.mkdir()
    (made.final / 'metadata.yaml').write_text('old')
    made.bag.mkdir()
    (made.bag / 'metadata.yaml').write_text('new')
    (made.logs / 'plant_node.log').write_text('text')
    return made


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def text_of(folder):
    return (folder / 'metadata.yaml').read_text()


@pytest.mark.parametrize('number', range(1, 6))
def test_a_kill_while_a_bag_is_replaced_loses_neither(tmp_path, staged, monkeypatch, number):
    """The kill is before rename `number` of `keep`, of which there are four."""
    done, rename = [], Path.rename

    def last(path, target):
        done.append(path)
        if len(done) == number:
            raise Killed
        return rename(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, 'rename', last)
        if number < 5:
            with pytest.raises(Killed):
                staged.keep()
            # the kernel opens the lock of a dead program
            staging.os.close(staged._lock)
        else:
            staged.keep()
    lines = staging.recover(tmp_path)
    if number < 4:
        assert (text_of(tmp_path / 'mpcc'), text_of(staged.bag)) == ('old', 'new')
        assert any(str(staged.bag) in line and 'is whole' in line for line in lines)
        assert any('put back' in line for line in lines) == (number == 3)
    else:
        assert (text_of(tmp_path / 'mpcc'), text_of(tmp_path / 'mpcc@1')) == ('new', 'old')
        assert ['mpcc@1' in line for line in lines] == [True] * (number == 4)
        assert names(tmp_path) == ['mpcc', 'mpcc@1']


@pytest.mark.parametrize('refused', ['bag', 'final'])
def test_a_bag_that_cannot_be_put_in_its_place_is_left_whole_with_the_older_one(
    staged, refuse_moves, refused
):
    refuse_moves(lambda path: path == getattr(staged, refused))
    for _ in range(2):
        with pytest.raises(PermissionError):
            staged.keep()
        assert (text_of(staged.final), text_of(staged.bag)) == ('old', 'new')
        assert (staged.logs / 'plant_node.log').read_text() == 'text'
    folder = staged.keep_failed()
    assert (text_of(staged.final), text_of(folder / 'mpcc')) == ('old', 'new')


def test_an_incomplete_staging_folder_is_removed(tmp_path, monkeypatch):
    def full(path, *how, **named):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'touch', full)
    with pytest.raises(OSError, match='No space left'):
        StagingDirectory(tmp_path, 'mpcc')
    assert names(tmp_path) == []


def test_a_run_in_progress_is_left_alone_and_an_older_bag_gets_the_first_free_number(
    tmp_path, staged
):
    assert staging.recover(tmp_path) == []
    for name in ('mpcc@1', 'mpcc@3', 'mpcc@soft'):
        (tmp_path / name).mkdir()
    staged.keep()
    assert staged.older == tmp_path / 'mpcc@2'
    assert (text_of(staged.older), text_of(staged.final)) == ('old', 'new')
    assert (staged.final / 'logs/plant_node.log').is_file()
    assert not staged.has_replaced


@pytest.mark.parametrize(
    ('file', 'advice'),
    [('metadata.yaml', 'is whole'), ('mpcc_0.mcap', 'bags repair'), (None, 'no bag')],
)
def test_the_remains_of_a_killed_run_are_named_with_advice(tmp_path, file, advice):
    left = tmp_path / '.mpcc.abc'
    (left / 'logs').mkdir(parents=True)
    (left / staging.MARKER_FILE).touch()
    if file:
        (left / 'mpcc').mkdir()
        (left / 'mpcc' / file).write_text('')
    (text,) = staging.recover(tmp_path)
    assert str(left) in text
    assert advice in text


def test_a_bag_that_was_replaced_is_removed_and_a_foreign_folder_left_alone(tmp_path):
    (tmp_path / 'mpcc').mkdir()
    (tmp_path / '.mpcc.abc/replaced/mpcc').mkdir(parents=True)
    (tmp_path / '.mpcc.abc' / staging.MARKER_FILE).touch()
    foreign = ('.cache.d', '.mpcc.backup')
    for name in foreign:
        (tmp_path / name / 'replaced/mpcc').mkdir(parents=True)
    assert staging.recover(tmp_path) == []
    assert names(tmp_path) == [*foreign, 'mpcc']


def test_a_run_that_fails_replaces_the_failed_one_before(tmp_path, staged):
    staged.keep_failed()
    folder = StagingDirectory(tmp_path, 'mpcc').keep_failed()
    assert folder == tmp_path / 'mpcc.failed'
    assert names(tmp_path) == ['mpcc', 'mpcc.failed']
    assert names(folder) == ['logs']
