"""Every command of README and of the pages with commands runs from its text as they say."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
from markdown_commands import Command, find_commands
from recorded_runs import DEMO, ON_THE_WALL_CLOCK
from session_cache import build_once
from tyre_files import property_file
from wait_until import wait_until

from experiments.run import domain
from msgs_yaml import share

pytestmark = [pytest.mark.ros, pytest.mark.timeout(900, func_only=True)]
ROOT = Path(__file__).parents[2]
PAGES = ('README.md', 'docs/howto/commands.md', 'docs/howto/ubuntu.md')
BIN = Path(sys.prefix, 'bin')
OURS = {'bags', 'experiments', 'identify', 'manoeuvre'}
NODES = {'scenario_node', 'mpcc_node', 'frenet_node', 'recorder_node', 'plant_node', 'player_node'}
SHELL = {'cd', 'export', 'git', 'make', 'pip', 'python', 'python3', 'ros2', 'source', 'sudo'}
COMMANDS = [
    command
    for page in PAGES
    for command in find_commands((ROOT / page).read_text(), OURS | NODES | SHELL)
]
SECONDS = 600.0  # of wall time for one command
TUTORIAL = 'docs/tutorials/01_first_run.md'
FIRST_RUN = 'experiments run double_lane_change --controller mpcc'
# what only the reader can run or another test runs, and where the same is tested
ELSEWHERE = {
    f'{FIRST_RUN}$': f'tests/docs/test_pages.py runs it in {TUTORIAL}',
    f'experiments {" ".join(ON_THE_WALL_CLOCK)}$': 'tests/ros/test_realtime.py drives it for 4 s',
    r'source (\.venv|venv)/bin/activate': 'every command here runs in the virtual environment',
    r'source (/opt/ros|install)/': 'tests/packaging sources what colcon installs',
    r'(sudo|pip|git|cd|export) ': 'needs a network or changes the shell of the reader',
    r'python3? -m venv ': 'tests/packaging installs into an empty virtual environment',
    r'python3? -m colcon build ': 'tests/packaging builds with colcon',
    r'ros2 ': 'needs an installation of ROS 2',
}
RUN = re.compile(r'^bags/runs/([^/]+)/([^/]+)/?$')


class Home:
    """A folder in which the commands of the pages find what they speak of.

    `once(name, make)` returns a folder that `make(folder)` fills for the homes of all workers.
    """

    def __init__(self, folder: Path, recordings: list[Path], once: Callable):
        self.folder, self.once = folder, once
        self._recordings = {(path.parent.name, path.name): path for path in recordings}
        (folder / 'bags').mkdir()
        (folder / 'tmp').mkdir()
        (folder / 'experiments').mkdir()
        (folder / 'paper').mkdir()
        for shipped in ('bags/reference', 'experiments/config', 'paper/settings', 'paper/picture'):
            (folder / shipped).symlink_to(ROOT / shipped)
        own = {
            'my_scenario.yaml': share.path('scenario_publisher', 'scenarios', 'straight.yaml'),
            'my_mpcc.yaml': share.path('mpcc_controller', 'config', 'mpcc.yaml'),
        }
        for name, example in own.items():
            shutil.copy(example, folder / name)
        (folder / 'my_tyre.tir').write_text(property_file('tyre_205_60r15.yaml'))

    def run(self, *words: object, code: int = 0) -> str:
        """Run a program of the virtual environment in the folder; return what it says."""
        done = subprocess.run(
            self.command(words),
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=SECONDS,
        )
        assert done.returncode == code, done.stdout
        assert 'Traceback' not in done.stdout, done.stdout
        return done.stdout

    def command(self, words) -> list[str]:
        """Return the words with what is in /tmp put below the folder, and drive what they read."""
        for word in map(str, words):
            if run := RUN.match(word):
                self.driven(*run.groups())
        first, *others = (str(word).replace('/tmp/', f'{self.folder}/tmp/') for word in words)
        return [str(BIN / first), *others]

    def driven(self, scenario: str, controller: str) -> Path:
        """Return a recording of the pages: a copy of the one that the tests share."""
        folder = self.folder / 'bags/runs' / scenario / controller
        if not folder.exists() and controller != 'by_hand':
            shutil.copytree(self._recordings[scenario, controller], folder)
        return folder

    def batch(self) -> Path:
        """Return the folder of the batch of the pages, driven once for all homes."""
        words, folder = BATCH.words, self.folder / 'tmp/batch'
        out = words.index('--out') + 1
        assert words[out] == '/tmp/batch'

        def drive(shared):
            self.run(*words[:out], os.path.relpath(shared, self.folder), *words[out + 1 :])

        if not folder.exists():
            shutil.copytree(self.once('batch_of_the_pages', drive), folder)
        return folder


@pytest.fixture(scope='module')
def home(recorded_runs, recorded_circle, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv('ROS_DOMAIN_ID', raising=False)
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('COLUMNS', '200')
        recordings = [
            *(recorded_runs.bag(controller) for controller in DEMO[1:]),
            recorded_circle.bag('mpcc_no_ca'),
        ]
        once = partial(build_once, tmp_path_factory)
        yield Home(tmp_path_factory.mktemp('readme'), recordings, once)


def drives(home, words):
    said = home.run(*words)
    given = {k: v for k, v in pairwise(words) if k in ('--controller', '--out')}
    out = Path(given.get('--out', 'bags/runs').replace('/tmp/', f'{home.folder}/tmp/'))
    controller = Path(given.get('--controller', 'mpcc')).stem
    scenario = Path(words[2]).stem
    scenario = {'my_scenario': 'straight'}.get(scenario, scenario)
    folder = home.folder / out / scenario
    assert (folder / controller / 'metadata.yaml').is_file()
    assert (folder / 'comparison.json').is_file()
    assert (folder / 'report.html').is_file()
    assert controller in said
    if '--set' in words:  # it is compared with no other run
        shutil.rmtree(folder)


def compares(home, words):
    said = home.run(*words)
    assert all(Path(bag).name in said for bag in words[2:])


def plays(home, words):
    at = words.index('--rate') + 1
    home.command(words)  # drives it, in a domain of its own
    with domain.reserved({}) as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_DOMAIN_ID', str(number))
        said = home.run(*words[:at], '20.0', *words[at + 1 :])
    assert re.search(r'played \d{4,} messages', said), said


def measures_distances(home, words):
    home.run(*words)
    assert (home.driven(*RUN.match(words[2]).groups()).parent / 'distances.json').is_file()


def repairs(home, words):
    """Repair what a recorder leaves that is killed; the bag is whole again for the others."""
    bag = home.driven(*RUN.match(words[2]).groups())
    kept = shutil.copytree(bag, bag.parent / 'kept')
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[: 2 * file.stat().st_size // 3])
    (bag / 'metadata.yaml').unlink()
    said = home.run(*words)
    assert re.search(r'repaired; .*\n.*recovered \d{4,} messages', said, re.DOTALL), said
    assert (bag / 'metadata.yaml').is_file()
    shutil.rmtree(bag)
    kept.rename(bag)


def tunes(home, words):
    home.run(*words, '--trials', '1', '1', '--jobs', '1')
    assert list((home.folder / 'paper/tuning').rglob('*_tuned.yaml'))


def drives_emergencies(home, words):
    home.run(*words, '--draws', '1', '--jobs', '1')
    assert list((home.folder / 'tmp').rglob('results.parquet'))


def drives_a_batch(home, words):
    assert words == BATCH.words
    assert (home.batch() / 'results.parquet').is_file()


def reads_a_batch(home, words):
    """Read the table that the command above writes."""
    home.batch()
    said = home.run(*words)
    assert re.search(r'min_v2o_m of mpcc minus mpcc_no_ca\n|survived\.png\n', said), said


def makes(home, words):
    """Make knows how; what `make demo` runs once it is set up is run here."""
    dry = ('--dry-run', '--old-file=setup', '--no-print-directory')
    recipe = subprocess.run(
        [*words, *dry], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    ).stdout
    if words[1] != 'demo':
        return
    (line,) = recipe.splitlines()
    command = [Path(word).name if word.startswith('.venv/') else word for word in line.split()]
    drives(home, command)
    for controller in DEMO[1:]:
        assert (home.folder / 'bags/runs' / DEMO[0] / controller / 'metadata.yaml').is_file()


def writes(option):
    def rule(home, words):
        home.run(*words)
        out = Path(words[words.index(option) + 1].replace('/tmp/', f'{home.folder}/tmp/'))
        assert out.is_file() or any(out.iterdir())

    return rule


def says(*expected):
    def rule(home, words):
        said = home.run(*words)
        for pattern in expected:
            assert re.search(pattern, said), said

    return rule


class Rule(NamedTuple):
    """How the commands that a pattern matches are run."""

    pattern: str
    run: Callable[[Home, list[str]], None]


RULES = [
    Rule(r'make ', makes),
    Rule(r'experiments run .*/drive\.yaml', says('mpcc_no_ca_limit', 'frenet_limit')),
    Rule(r'experiments run ', drives),
    Rule(r'bags compare ', compares),
    Rule(r'bags distances ', measures_distances),
    Rule(r'bags play .*--rate ', plays),
    Rule(r'experiments replay-check ', says('the same in ')),
    Rule(r'experiments resolve .*--tick .*--set ', says('solved again: ', 'changed: ')),
    Rule(r'bags info ', says('/vehicle/odometry', 'lockstep')),
    Rule(r'bags timing ', says('transport', 'solve')),
    Rule(r'experiments compile ', says('the plant, mpcc_road')),
    Rule(r'experiments tune ', tunes),
    Rule(r'experiments study recompute', says('frenet_matched +sideslip +1 +222 ')),
    Rule(r'experiments batch .*--out ', drives_a_batch),
    Rule(r'experiments (table|plot) /tmp/batch ', reads_a_batch),
    Rule(r'experiments library ', drives_emergencies),
    Rule(r'bags repair ', repairs),
    Rule(r'manoeuvre --list', says('step_steer')),
    Rule(r'manoeuvre .*--out ', writes('--out')),
    Rule(r'identify .*--out ', writes('--out')),
]


def rule_of(command: Command) -> Rule | None:
    """Return the rule of a command, None where the reader alone can run it."""
    text = ' '.join(command.words)
    if any(re.match(pattern, text) for pattern in ELSEWHERE):
        return None
    for rule in RULES:
        if re.match(rule.pattern, text):
            return rule
    raise AssertionError(f'no rule runs {text!r}')


RECIPE = [c for c in COMMANDS if c.words[0] in NODES]
(BATCH,) = (c for c in COMMANDS if c.words[:2] == ['experiments', 'batch'])
RUNNABLE = [c for c in COMMANDS if c not in RECIPE and rule_of(c)]


@pytest.mark.parametrize('command', RUNNABLE, ids=lambda command: command.text)
def test_every_command_of_the_pages_runs(command, home):
    rule_of(command).run(home, command.words)


def test_the_pages_have_commands():
    assert {('experiments', 'run'), ('bags', 'compare'), ('bags', 'info')} <= {
        tuple(c.words[:2]) for c in RUNNABLE
    }
    assert len({command.block for command in RECIPE}) == 1


def test_what_is_left_to_a_tutorial_is_a_command_of_it():
    said = (ROOT / TUTORIAL).read_text()
    assert FIRST_RUN in [command.text for command in find_commands(said, OURS)]


def test_a_command_that_no_rule_runs_is_named():
    with pytest.raises(AssertionError, match="no rule runs 'bags fly'"):
        rule_of(Command('bags fly', 0))


def test_the_recipe_of_four_terminals_records_a_drive(home):
    with ExitStack() as ended, domain.reserved({}) as number:
        environment = os.environ | {'ROS_DOMAIN_ID': str(number)}
        logs, running = {}, {}
        for command in RECIPE:
            name = command.words[0]
            logs[name] = home.folder / f'{name}.log'
            running[name] = ended.enter_context(
                subprocess.Popen(
                    home.command(command.words),
                    cwd=home.folder,
                    env=environment,
                    stdout=logs[name].open('w'),
                    stderr=subprocess.STDOUT,
                )
            )
            ended.callback(running[name].kill)
        plant = running.pop('plant_node')

        def told():
            return '\n'.join(f'{name}:\n{log.read_text()}' for name, log in logs.items())

        wait_until(lambda: plant.poll() is not None, SECONDS, told)
        assert plant.returncode == 0, told()
        assert 'finish line crossed' in logs['plant_node'].read_text()
        for process in running.values():
            process.send_signal(signal.SIGTERM)
        for process in running.values():
            assert process.wait(60) == 0, told()
    (out,) = (
        word.removeprefix('out:=') for c in RECIPE for word in c.words if word.startswith('out:=')
    )
    said = home.run('bags', 'info', out)
    assert '/vehicle/odometry' in said
    assert '/controller/command' in said
