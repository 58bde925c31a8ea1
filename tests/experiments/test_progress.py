"""What is shown of a run: bars on a terminal, lines elsewhere."""

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from experiments import progress
from experiments.progress import RunProgress


@pytest.fixture
def shown(monkeypatch):
    """Return shown(is_terminal): what 60 s of a run with ten looks per second write."""
    now = [0.0]
    # only where this module asks for the time: rich draws by its own clock
    monkeypatch.setattr(progress, 'time', SimpleNamespace(monotonic=lambda: now[0]))

    def run(is_terminal):
        text = io.StringIO()
        console = Console(file=text, force_terminal=is_terminal, width=200)
        with RunProgress(console) as bars:
            bars.begin('mpcc', 100.0)
            for tenth in range(600):
                now[0] = tenth / 10
                bars.show(tenth / 10, tenth / 6, 20.0)
            bars.end('mpcc', True, 'finish line crossed')
        return text.getvalue()

    return run


def test_without_a_terminal_there_is_a_plain_line_every_few_seconds(shown):
    text = shown(False)
    first, *between, last = text.splitlines()
    assert first == 'mpcc: starting the nodes'
    assert all(line.startswith('mpcc: t ') and 'station' in line for line in between)
    assert len(between) == 60 / progress.LINE_EVERY_S - 1
    assert last == 'mpcc: finish line crossed'
    assert '\r' not in text
    assert '\x1b' not in text


def test_on_a_terminal_a_line_changes_in_place(shown):
    text = shown(True)
    assert '\x1b' in text
    assert 'mpcc: starting' not in text
