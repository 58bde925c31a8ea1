"""Every program of bench starts; of roads on ice and of nodes that grow, what they find."""

import re
import runpy
import subprocess
import sys
from pathlib import Path
from random import Random

import ice
import pytest

BENCH = Path(__file__).parents[2] / 'bench'
PROGRAMS = [
    path.name for path in sorted(BENCH.glob('*.py')) if "__name__ == '__main__'" in path.read_text()
]


@pytest.fixture
def run(monkeypatch, capsys):
    """Return run(program, word, ...) -> exit code and output of a program in this process."""

    def run_program(program, *words):
        monkeypatch.setattr(sys, 'argv', [program, *words])
        code = 0
        try:
            runpy.run_path(str(BENCH / program), run_name='__main__')
        except SystemExit as ended:
            code = ended.code
        return code, ''.join(capsys.readouterr())

    return run_program


@pytest.mark.parametrize('program', PROGRAMS)
def test_a_program_says_what_it_measures(run, program):
    code, text = run(program, '--help')
    assert code == 0
    assert 'usage: ' in text


def test_a_program_prints_its_table(run):
    code, text = run('plant.py')
    assert code in (0, None)
    assert re.search(r'step_us +\d+\.\d{3} +15\.0\n', text)


@pytest.mark.nightly
@pytest.mark.usefixtures('dds')
def test_a_short_drive_does_not_make_the_nodes_grow():
    command = [sys.executable, BENCH / 'soak.py', '--minutes', '0.4']
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'nothing grew' in done.stdout


@pytest.mark.parametrize(
    ('road', 'settings'),
    [
        pytest.param(ice.ICE, {'limits.drive_n': 6000.0}, id='as the road controller drives'),
        pytest.param(
            ice.ICE,
            {'limits.drive_n': 6000.0, 'limits.drive_friction_use': 0.95},
            id='a driving force beyond the friction of the ice',
        ),
        pytest.param(
            ice.draw(Random('test 0')), {'limits.drive_friction_use': 0.95}, id='a drawn road'
        ),
    ],
)
def test_on_ice_there_is_always_a_plan(road, settings):
    result = ice.drive(road, 'mpcc_road', settings)
    assert not ice.is_failed(result)
    if 'limits.drive_friction_use' not in settings:
        assert not result.failures
        assert result.largest_sideslip_deg <= ice.SIDESLIP_DEG
        assert result.end_mps > 20.0
