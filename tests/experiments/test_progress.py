"""What is shown of a run: bars on a terminal, lines elsewhere."""

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from experiments import progress
from experiments.progress import RunProgress


@pytest.mark.parametrize('is_terminal', [True, False])
def test_60_s_of_a_run_are_a_line_that_changes_or_plain_ones_every_few_seconds(
    monkeypatch, is_terminal
):
    now = [0.0]
    # only where this module asks for the time: rich draws by its own clock
    monkeypatch.setattr(progress, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    text = io.StringIO()
    with RunProgress(Console(file=text, force_terminal=is_terminal, width=200)) as bars:
        bars.begin('mpcc', 100.0)
        for tenth in range(600):
            now[0] = tenth / 10
            bars.show(tenth / 10, tenth / 6, 20.0)
        bars.end('mpcc', True, 'finish line crossed')
    shown = text.getvalue()
    assert ('\x1b' in shown) == is_terminal
    assert ('mpcc: starting' in shown) != is_terminal
    if not is_terminal:
        first, *between, last = shown.splitlines()
        assert (first, last) == ('mpcc: starting the nodes', 'mpcc: finish line crossed')
        assert all(line.startswith('mpcc: t ') and 'station' in line for line in between)
        assert len(between) == 60 / progress.LINE_EVERY_S - 1
        assert '\r' not in shown
