"""What workers share is made once, and by nobody who failed."""

import multiprocessing

import pytest
from once import made_once, session_folder


class Factory:
    """The part of pytest's factory of temporary folders that is used."""

    def __init__(self, base):
        self.base = base

    def getbasetemp(self):
        return self.base


def note(folder):
    """Count the calls in a file beside the folder."""
    with folder.with_suffix('.calls').open('a') as calls:
        calls.write('x')
    (folder / 'file').write_text('whole')


@pytest.fixture
def factory(tmp_path):
    """Return the factory of one worker: its own folder is below the shared one."""
    (tmp_path / 'worker').mkdir()
    return Factory(tmp_path / 'worker')


def test_processes_that_ask_at_once_get_one_folder_that_was_made_once(factory):
    asked = [
        multiprocessing.get_context('fork').Process(target=made_once, args=(factory, 'thing', note))
        for _ in range(4)
    ]
    for process in asked:
        process.start()
    for process in asked:
        process.join(60)
        assert process.exitcode == 0
    assert (session_folder(factory) / 'thing/file').read_text() == 'whole'
    assert (session_folder(factory) / 'thing.calls').read_text() == 'x'


def test_what_failed_is_tried_again_in_an_empty_folder(factory):
    def half(folder):
        (folder / 'half').touch()
        raise OSError('half made')

    with pytest.raises(OSError, match='half made'):
        made_once(factory, 'thing', half)
    assert [one.name for one in made_once(factory, 'thing', note).iterdir()] == ['file']
