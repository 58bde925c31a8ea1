"""Workers share a folder that is built once; a failed build is repeated."""

import multiprocessing

import pytest
from session_cache import build_once, session_folder


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


def test_parallel_processes_share_one_folder_that_is_built_once(factory):
    processes = [
        multiprocessing.get_context('fork').Process(
            target=build_once, args=(factory, 'thing', note)
        )
        for _ in range(4)
    ]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
        assert process.exitcode == 0
    assert (session_folder(factory) / 'thing/file').read_text() == 'whole'
    assert (session_folder(factory) / 'thing.calls').read_text() == 'x'


def test_a_failed_build_is_repeated_in_an_empty_folder(factory):
    def half(folder):
        (folder / 'half').touch()
        raise OSError('half made')

    with pytest.raises(OSError, match='half made'):
        build_once(factory, 'thing', half)
    assert [one.name for one in build_once(factory, 'thing', note).iterdir()] == ['file']
