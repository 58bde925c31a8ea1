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
    return made


def kill_at_rename(staged, monkeypatch, number):
    """Let `keep` get as far as before its rename of this number, then give up as a kill does."""
    done = []
    rename = Path.rename

    def last(path, target):
        done.append(path)
        if len(done) == number:
            raise Killed
        return rename(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, 'rename', last)
        with pytest.raises(Killed):
            staged.keep()
    # the kernel opens the lock of a dead program
    staging.os.close(staged._lock)


@pytest.mark.parametrize('number', [1, 2, 3])
def test_a_kill_while_a_bag_is_replaced_loses_neither(tmp_path, staged, monkeypatch, number):
    kill_at_rename(staged, monkeypatch, number)
    text = staging.recover(tmp_path)
    assert (staged.final / 'metadata.yaml').read_text() == 'old'
    assert (staged.bag / 'metadata.yaml').read_text() == 'new'
    assert any(str(staged.bag) in line for line in text)
    assert any('put back' in line for line in text) == (number == 3)


@pytest.mark.parametrize('refused', ['bag', 'final'])
def test_a_bag_that_cannot_be_put_in_its_place_is_left_whole_with_the_older_one(
    staged, refuse_moves, refused
):
    (staged.logs / 'plant_node.log').write_text('text')
    refuse_moves(lambda path: path == getattr(staged, refused))
    for _ in range(2):
        with pytest.raises(PermissionError):
            staged.keep()
        assert (staged.final / 'metadata.yaml').read_text() == 'old'
        assert (staged.bag / 'metadata.yaml').read_text() == 'new'
        assert (staged.logs / 'plant_node.log').read_text() == 'text'
    folder = staged.keep_failed()
    assert (folder / 'mpcc/metadata.yaml').read_text() == 'new'
    assert (staged.final / 'metadata.yaml').read_text() == 'old'


def test_an_incomplete_staging_folder_is_removed(tmp_path, monkeypatch):
    def full(path, *how, **named):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'touch', full)
    with pytest.raises(OSError, match='No space left'):
        StagingDirectory(tmp_path, 'mpcc')
    assert list(tmp_path.iterdir()) == []


def test_a_run_in_progress_is_left_alone(tmp_path, staged):
    assert staging.recover(tmp_path) == []
    staged.keep()
    assert (tmp_path / 'mpcc/metadata.yaml').read_text() == 'new'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['mpcc', 'mpcc@1']


def test_an_older_bag_gets_the_first_free_number(tmp_path, staged):
    for name in ('mpcc@1', 'mpcc@3', 'mpcc@soft'):
        (tmp_path / name).mkdir()
    staged.keep()
    assert staged.older == tmp_path / 'mpcc@2'
    assert (staged.older / 'metadata.yaml').read_text() == 'old'
    assert (staged.final / 'metadata.yaml').read_text() == 'new'
    assert not staged.has_replaced


def test_an_older_bag_is_removed_on_request(tmp_path, staged):
    staged.keeps_older = False
    staged.keep()
    assert staged.older is None
    assert staged.has_replaced
    assert [path.name for path in tmp_path.iterdir()] == ['mpcc']


def test_a_kill_before_the_older_bag_has_its_number_loses_neither(tmp_path, staged, monkeypatch):
    kill_at_rename(staged, monkeypatch, 4)
    (text,) = staging.recover(tmp_path)
    assert 'mpcc@1' in text
    assert (tmp_path / 'mpcc@1/metadata.yaml').read_text() == 'old'
    assert (tmp_path / 'mpcc/metadata.yaml').read_text() == 'new'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['mpcc', 'mpcc@1']


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


def test_a_bag_that_was_replaced_already_is_removed(tmp_path):
    (tmp_path / 'mpcc').mkdir()
    (tmp_path / '.mpcc.abc/replaced/mpcc').mkdir(parents=True)
    (tmp_path / '.mpcc.abc' / staging.MARKER_FILE).touch()
    assert staging.recover(tmp_path) == []
    assert [path.name for path in tmp_path.iterdir()] == ['mpcc']


@pytest.mark.parametrize('name', ['.cache.d', '.mpcc.backup'])
def test_a_foreign_folder_is_left_alone(tmp_path, name):
    file = tmp_path / name / 'replaced' / 'mpcc'
    file.parent.mkdir(parents=True)
    file.write_text('precious')
    assert staging.recover(tmp_path) == []
    assert file.read_text() == 'precious'


def test_a_run_that_fails_replaces_the_failed_one_before(tmp_path, staged):
    for _ in range(2):
        folder = (staged or StagingDirectory(tmp_path, 'mpcc')).keep_failed()
        staged = None
    assert folder == tmp_path / 'mpcc.failed'
    assert sorted(path.name for path in tmp_path.iterdir()) == ['mpcc', 'mpcc.failed']
    assert not (tmp_path / 'mpcc.failed/replaced').exists()
    assert not (tmp_path / 'mpcc.failed' / staging.MARKER_FILE).exists()
