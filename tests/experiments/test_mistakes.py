"""Every mistake in a command, a run file or a study is one line that says what is allowed.

Nothing is driven and no file is left behind. One table per kind of input; all in this process.
"""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pandas
import pytest
import yaml
from capabilities import ORDINARY_USER

from experiments import cli
from msgs_yaml import share

SLOW = ('casadi', 'matplotlib', 'bokeh', 'rclpy')  # to import
PLAN = Path(__file__).parents[2] / 'paper/study/study.yaml'
STRAIGHT = share.path('scenario_publisher', 'scenarios', 'straight.yaml').read_text()
FILES = {
    'road.yaml': STRAIGHT.replace('name: straight', 'name: road'),
    'other.yaml': STRAIGHT.replace('name: straight', 'name: road'),
    'wish.yaml': STRAIGHT.replace('name: straight', 'name: wish') + 'expect: {survive: true}\n',
    'broken.yaml': '/**: [1',
    'bad.yaml': '/**: {ros__parameters: {base: mpcc.yaml, safety: {obstacle_m: -1.0}}}',
    'baseless.yaml': '/**: {ros__parameters: {base: mpc.yaml}}',
    'sub/mpcc.yaml': '',
    'frenet_mine.yaml': '/**: {ros__parameters: {safety: {obstacle_m: 0.4}}}',
    'steer.py': '',
    'sub/steer': '',  # nobody may execute it
}


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Return refused(words) -> what a command wrote before it ended with 1 and no file was made."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)

    def run(words):
        before = sorted(tmp_path.rglob('*'))
        assert cli.main(words) == 1
        assert sorted(tmp_path.rglob('*')) == before
        shown = capsys.readouterr()
        assert shown.err.startswith('error: ')
        assert shown.err.count('\n') == 1
        assert 'Errno' not in shown.err
        return shown

    return run


def is_said(text, parts):
    """Check that a text has each of the parts, which '...' separates, in their order."""
    pattern = '.*'.join(map(re.escape, parts.split(' ... ')))
    assert re.search(pattern, text), text


SETTINGS = [
    ('friction=1', "--set friction=1: ... did you mean 'estimator.friction' or 'plant.friction'?"),
    ('solver.mdoe=one_step', "did you mean 'controller.solver.mode'?"),
    ('contoller.solver.mode=one_step', "did you mean 'controller.solver.mode'?"),
    ('weights.lag=0', 'weights.lag=0: ... controller.tolerances'),
    ('plant.friction', '--set plant.friction: '),
    ('wheel.size=1', '--set wheel.size=1: '),
    ('plant.x=[1', '--set plant.x=[1: '),
    ('plant.friction=', 'plant.friction: friction: has no value; allowed 0.05 to 1.5'),
    ('controller.tolerances=1', 'is a group, not a parameter; allowed tolerances.'),
    ('controller.tolerances.contorting_m=1', "did you mean 'tolerances.contouring_m'"),
    ('controller.model.friction=9.0', '--set controller.model.friction: '),
    ('plant.plant_params=1', 'plant_params: must be a text'),
    ('plant.start.from=foo', 'start.from: '),
    ('recorder.chnk_s=0.1', "chnk_s: this node has no such param ... did you mean 'chunk_s'?"),
    ('recorder.realtime.priority=high', 'realtime.priority: '),
    ('scenario.speed=24', 'speed: this node has no such parameter'),
    ('scenario.mode=fast', 'mode: '),
    ('controller.car_file=~nosuchuser/car.yaml', 'there is no file ~nosuchuser/car.yaml'),
    ('controller.car_file=no.yaml', 'car_file: ... config/no.yaml; it has car.yaml, car_commonro'),
    ('plant.tyre_set=no.yaml', 'tyre_set: ... config/no.yaml; it has tyre_205_60r15.yaml, tyre_2'),
    ('plant.plant_params=vw_gti.yaml', 'does not fit the plant: wheelbase'),
    (
        'controller.limits.steer_rate_radps=0.9',
        '--set controller.limits.steer_rate_radps: limits.steer_rate_radps: is 0.9; allowed up '
        'to 0.8, which the car can do (actuators.steer_rate_radps)',
    ),
    (
        'controller.limits.brake_n=0',
        'limits.brake_n: is 0; allowed from 14000, 0.5 of what the car',
    ),
    ('controller.formulation.name=trackin', "did you mean 'tracking'?; allowed mpcc or frenet or "),
]
PAGE = Path(__file__).parents[2] / 'docs/controllers.md'
ON_PAGE = re.findall(r'^\| `(\w+)\.yaml` \|', PAGE.read_text(), re.MULTILINE)
CONTROLLERS = [
    ('mpc', "did you mean 'mpcc'"),
    ('frenet.yaml', "did you mean 'frenet'"),
    ('car', f"'car'; there are {', '.join(sorted(ON_PAGE))}"),
    ('mpcc,frenet', 'once for each: --controller mpcc --controller frenet'),
    ('broken', "'broken' ... give its path, ./broken.yaml"),
    ('./raod.yaml', "did you mean 'road.yaml'"),
    ('broken.yaml', 'broken.yaml'),
    ('bad.yaml', 'bad.yaml:1: safety.obstacle_m: '),
    ('baseless.yaml', 'baseless.yaml:1: base: there is no file mpc.yaml'),
    ('frenet_mine.yaml', 'frenet_mine.yaml: ... add `base: frenet.yaml`'),
    ('sub/steer', 'no controller'),
    ('./steer', 'no controller'),
    ('./sub/no.py', 'there is no such file ... there is no Python file in sub'),
]


@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        *((('straight', '--set', setting), said) for setting, said in SETTINGS),
        *((('straight', '--controller', name), said) for name, said in CONTROLLERS),
        (('strait',), "no scenario 'strait'; available: ... did you mean 'straight'"),
        (('./raod.yml',), "did you mean 'road.yaml'"),
        (('wish.yaml',), 'expect.survive: no such metric ... survived'),
        (('straight', '--controller', 'mpcc', '--controller', 'sub/mpcc.yaml'), "called 'mpcc'"),
        (('straight', '--controller', './steer.py', '--set', 'controller.x=1'), 'is a program'),
        (('straight', '--plant', 'no_car.py'), '--plant no_car.py: ... there is no such file'),
        (('straight', '--plant', 'bad.yaml'), 'neither a Python file nor a program'),
        (('straight', '--out', '/dev/null'), '--out /dev/null: cannot create the folder'),
        (('straight', '--out', 'bad.yaml/x'), '--out bad.yaml/x: cannot ... bad.yaml is not a fo'),
    ],
    ids=lambda value: ' '.join(value[-2:]) if isinstance(value, tuple) else None,
)
def test_mistakes_in_a_run(refused, words, expected):
    shown = refused(['run', *words])
    assert shown.out == ''
    is_said(shown.err, expected)


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('controllers: [mpcc]', "1: key 'scenario' is missing"),
        ('scenario: straight\ncontroler: mpcc', "2: controler: unknown key; did you mean 'contro"),
        ('scenario: 3', '1: scenario: must be a text, is 3; allowed a name or a file'),
        ('scenario: straight\ncontrollers: []', '2: controllers: is empty; allowed at'),
        (
            'scenario: straight\nsettings:\n  plnt.friction: 1',
            "3: settings.plnt.friction: is no setting; did you mean 'plant.friction'?; allowed rec",
        ),
        ('scenario: straight\nsettings: {plant.friction: {a: 1}}', '2: settings. ... is no param'),
        ('scenario: straight\nsettings: {plant.friction: 9.0}', '2: ... allowed 0.05 to 1.5'),
        ('scenario: straight\nlabels: [7]', '2: labels[0]: must be a text, is 7; allowed 1 to 40'),
        ('scenario: straight\ncontrollers: [a, b, c]\nlabels: [a, b]', '3: ... allowed 1 or 3'),
    ],
)
def test_mistakes_in_a_run_file(refused, tmp_path, text, expected):
    (tmp_path / 'run.yaml').write_text(text + '\n')
    is_said(refused(['run', 'run.yaml']).err, f'run.yaml:{expected}')


STUDY = {
    'schema': 1,
    'scenarios': ['./road.yaml'],
    'controllers': ['mpcc_no_ca'],
    'set': {'plant.friction': [0.8, 1.0]},
    'runs': 2,
    'seed': 1,
}


FRICTION = 'plant.friction'
IN_A_PROCESS = ':9: set.plant.friction[1]: ... 0.05 to 1.5'  # as every study is checked


def draw_of(name, distribution, **more):
    return {'set': {}, 'draws': 2, 'draw': {name: distribution}, **more}


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'schema': 2}, 'schema: ... allowed 1'),
        ({'scenarios': None}, 'scenarios: is missing'),
        ({'controllers': None}, "key 'controllers' is missing"),
        ({'run': 3}, "run: ... did you mean 'runs'?; allowed schema, controllers, scenarios"),
        ({'scenarios': []}, 'scenarios: ... at least one'),
        ({'scenarios': ['straight', 3]}, 'scenarios[1]: ... a name or a file'),
        ({'scenarios': ['./*.yml']}, 'scenarios[0]: ... fits no file'),
        ({'scenarios': ['pop_up:3']}, "scenarios[0]: 'pop_up:3' is a draw ... allowed under fam"),
        ({'scenarios': ['strait']}, "scenarios: no scenario 'strait'; available: ... 'straight'"),
        ({'scenarios': ['./road.yaml', './other.yaml']}, "other.yaml have one name, 'road'"),
        ({'controllers': ['mpc']}, "controllers: no controller 'mpc'; there are"),
        ({'controllers': ['./no.yaml']}, 'controllers: no controller ... no.yaml ... no such file'),
        ({'controllers': ['./bad.yaml']}, 'controllers: ... bad.yaml ... safety.obstacle_m'),
        ({'controllers': ['./steer.py']}, 'only `experiments run` drives it'),
        ({'runs': 0}, 'runs: ... allowed 1 to 10000'),
        ({'set': {'friction': [1.0]}}, 'set.friction: ... allowed plant.*, controller.*, '),
        ({'set': {'plant.friction': 1.0}}, 'set.plant.friction: must be a list'),
        ({'set': {'plant.friction': []}}, 'set.plant.friction: ... at least one'),
        ({'set': {'plant.friction': [{'a': 1}]}}, 'set.plant.friction[0]: ... allowed a number'),
        ({'set': {'plant.friction': [1.0, 9.0]}}, IN_A_PROCESS),
        ({'set': {'plant.stop.x_m': [9.0]}}, 'set.plant.stop.x_m: ... allowed plant.friction, pla'),
        ({'set': {'plant.car.no_such': [1, 2]}}, 'set.plant.car.no_such[0]: ... no such parameter'),
        ({'set': {'controller.safety.obstacle_m': [0.5, -1.0]}}, '_m[1]: ... allowed 0.01 to 10 m'),
        ({'set': {'scenario.speed_mps': [20.0, 200.0]}}, '_mps[1]: ... allowed 1 to 100 m/s'),
        ({'set': {f'plant.car.{name}': [*range(100)] for name in 'abc'}}, '2,000,000 drives; al'),
        ({'difficulty': 'hard'}, 'difficulty: ... no effect without families'),
        ({'draws': 3}, 'draws: ... no effect without draw or families'),
        ({'families': ['pop_up']}, 'draws: is missing'),
        ({'families': ['popup'], 'draws': 3}, 'families[0]: ... allowed pop_up or'),
        (
            {'families': ['pop_up'], 'draws': 2, 'set': {'scenario.speed_mps': [20.0]}},
            'families: ... without scenario.speed_mps',
        ),
        (draw_of(FRICTION, {'uniform': [0.5, 1.0]}, draws=None), 'draws: is missing'),
        (draw_of(FRICTION, {'uniform': [0.5, 1]}, set={FRICTION: [1.0]}), 'is in set, too'),
        (draw_of('friction', {'uniform': [0.5, 1]}), "draw.friction: ... mean 'scenario.friction'"),
        (draw_of('scenario.speed_mps', {'uniform': [20, 101]}), 'is 101.0; allowed 1 to 100 m/s'),
        (draw_of(FRICTION, {'uniform': [0.5, 9.0]}), '9.0: ... allowed 0.05 to 1.5'),
        (draw_of('controller.no_such', {'uniform': [0, 1]}), 'no_such: ... no such parameter'),
        (draw_of('plant.command_delay_ms', {'choice': [0, 0.5]}), '_ms: ... 0.5: ... whole number'),
        *(
            (draw_of(FRICTION, distribution), said)
            for distribution, said in (
                ({'unifrom': [0, 1]}, "unifrom: is no distribution; did you mean 'uniform'"),
                ({'uniform': [1, 0]}, 'uniform: is from 1 to 0; allowed ... low < high'),
                ({'uniform': [0, float('inf')]}, 'uniform[1]: must be finite, is .inf'),
                ({'log_uniform': [0, 1]}, 'log_uniform: begins at 0; allowed above 0'),
                ({'normal': [0, 1]}, 'within is missing'),
                ({'normal': [0, 0], 'within': [0, 1]}, 'standard deviation 0; allowed above 0'),
                ({'normal': [0, 1], 'within': [9, 10]}, 'is from 9 to 10; allowed ... 8 standard'),
                ({'choice': []}, 'choice: is empty'),
                ({'uniform': [0, 1], 'choice': [1]}, 'exactly one of uniform'),
                ({'uniform': [0, 1], 'within': [0, 1]}, 'within: is no distribution'),
            )
        ),
    ],
    ids=lambda value: str(value)[:60],
)
def test_mistakes_in_a_study(refused, tmp_path, request, given, expected):
    if expected != IN_A_PROCESS:
        request.getfixturevalue('tasks_here')
    fields = {name: value for name, value in (STUDY | given).items() if value is not None}
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(fields, sort_keys=False))
    error = refused(['batch', 'study.yaml', '--out', 'out', '--jobs', '1']).err
    assert 'study.yaml:' in error
    is_said(error, expected)


@pytest.mark.parametrize(
    ('place', 'value', 'expected'),
    [
        ('serach', {}, "serach: unknown key; did you mean 'search'?"),
        ('judged_tasks', 0, ':6: judged_tasks: is 0; allowed 1 to'),
        ('starts speed_kph', 'fast', "starts.speed_kph: must be a number, is 'fast'; allowed 0 to"),
        ('stop widths', [0.05], 'stop.widths: has 1 elements; allowed exactly 2'),
        ('confirmatory avoidance_gap margin', 5, 'margin: is 5; allowed 0 to 1'),
        ('balance kept_m', -1.0, 'balance.kept_m: is -1.0; allowed'),
        ('picture items onset_lead_m', [10.0, 40.0, 0.0], 'onset_lead_m[2]: is 0.0; allowed'),
        ('search first points', 1.5, 'search.first.points: must be a whole number, is 1.5'),
        ('search ranges tolerances.lug_m', [1, 2], "is no parameter ... 'tolerances.lag_m'"),
        ('search ranges tolerances.lag_m', [2.0, 1.0], 'is from 2 to 1; allowed low < high'),
        ('search ranges tolerances.lag_m', [1e-9, 1.0], 'lag_m: is 1e-09; allowed'),
        ('tuned frenet without', ['tolerances.heading_rad'], 'tuned.frenet: must have ... _rad'),
        ('tuned mpcc', None, "tuned: key 'mpcc' is missing"),
        ('tuned mpcc without', ['tolerances.lug_m'], "no 'tolerances.lug_m'; did you mean"),
        ('tuned mpcc controller', 'mpc', "tuned.mpcc.controller: no controller 'mpc'"),
        ('tuned mpcc settings', {'formulation.headng': True}, "mean 'formulation.heading'?"),
        ('tuned mpcc settings', {'formulation.heading': 1}, 'heading: must be true or false, is 1'),
        ('derived mpcc', {'controller': 'mpcc'}, 'derived.mpcc: is in tuned, too'),
        ('derived frenet_matched weights', 'mpc', "weights: ... no 'mpc'; did you mean 'mpcc'?"),
        ('factors frme', {}, "factors.frme: ... did you mean 'frame'?"),
    ],
)
def test_mistakes_in_the_plan_of_a_study(refused, tmp_path, place, value, expected):
    plan = yaml.safe_load(PLAN.read_text())
    *blocks, name = place.split()
    block = plan
    for key in blocks:
        block = block[key]
    block[name] = value
    if value is None:
        del block[name]
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(plan, sort_keys=False))
    error = refused(['study', 'run', '.', '--jobs', '1']).err
    assert 'study.yaml:' in error
    is_said(error, expected)


@pytest.fixture
def drives(tmp_path):
    """Write a small table of drives into the folder `drives`."""
    (tmp_path / 'drives').mkdir()
    rows = [
        {'controller': name, 'speed': 15.0 + k, 'friction': 0.1 * k, 'draw': k, 'error': ''}
        | {'survived': k > 4, 'clearance_m': 0.1 * k, 'lost_by': 'slid'}
        for k in range(9)
        for name in 'ab'
    ]
    pandas.DataFrame(rows).to_parquet(tmp_path / 'drives/results.parquet')


@pytest.mark.usefixtures('drives')
@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        ('library --draws 1', '--out is missing'),
        ('library --family popup --out x', "did you mean 'pop_up'"),
        ('library --entries --entry slalon --out x', "no 'slalon'; there are bend"),
        ('library --entries --family slalom --out x', '--entries drives no family'),
        ('library --entries --difficulty hard --out x', '--difficulty: has no effect with --entr'),
        ('library --entry slalom --out x', '--entry: goes with --entries'),
        ('library --draw slalom:-1 --out x', 'allowed FAMILY:INDEX'),
        ('library --family slalom --controller mpc --out x', "no controller 'mpc'"),
        ('library --family slalom --set plant.nothing=1 --out x', 'nothing'),
        ('library --family slalom --set recorder.x=1 --out x', "--set: unknown name 'recorder.x'"),
        ('library --set scenario.speed_mps=20 --out x', 'families draw their own speeds'),
        ('library --set scenario.friction=9 --out x', '--set scenario.friction: ... 9 ... allowed'),
        ('library --entries --set scenario.speed_mps=fast --out x', 'scenario.speed_mps: ... allo'),
        ('library --set plnt.friction=1 --out x', 'must be NODE.parameter=value'),
        ('demo', 'paper/picture/drive.yaml: is not here; ... runs in a clone'),
        ('study run sub', 'study.yaml: is no file; it has the plan of the study'),
        ('parameters contoring', "no parameter has 'contoring'; did you mean 'contouring_m'"),
        ('scenario straight --plot x.jpg', 'must end in .png, .svg or .pdf'),
        ('survivable sub', 'results.parquet: is no table of experiments library'),
        ('table sub', 'there is no such table'),
        ('table drives --metric surviving', "no such column; did you mean 'survived'"),
        ('table drives --metric lost_by', '--metric lost_by: ... holds words'),
        ('table drives --metric clearance_m --pair a c', "no drive of 'c'; there are a, b"),
        ('table drives --pair a b --by lost_by', '--by lost_by: goes with --pair only for'),
        ('plot drives', '--by: is given 0 times; allowed 1 or 2'),
        ('plot drives --by sped', "did you mean 'speed'"),
        ('plot drives --by speed --surface', 'allowed exactly 2 with --surface'),
        ('plot drives --by speed --by friction --surface --metric clearance_m', 'true or false'),
        ('plot drives --by speed --by controller --surface', '--by controller: a surface needs nu'),
        ('replay-check sub', 'sub'),
    ],
)
def test_mistakes_in_other_commands(refused, words, expected):
    is_said(refused(words.split()).err, expected)


@pytest.mark.parametrize(
    ('words', 'meant'),
    [
        ('rnu straight', "did you mean 'run'?"),
        ('run straight --contoller mpcc', "did you mean '--controller'?"),
        ('resolve bag --at closst', "did you mean 'closest'?"),
        ('library --difficulty hrd', "did you mean 'hard'?"),
        *((f'run straight --time-limit {s}', '--time-limit') for s in ('0', 'nan', 'soon')),
        ('library --at-least 1.1', 'must be from 0 to 1, is 1.1'),
        ('library --seed -1', 'must be 0 or more, is -1'),
        ('tune mpcc --seed -1', 'must be from 0 to 4294967295, is -1'),
        ('survivable x --budget -1', 'must be 0 or more, is -1'),
        ('tune mpcc --jobs 0', 'must be a positive number, is 0'),
        *((word, f'did you mean {meant!r}?') for word, meant in cli.MEANT.items()),
    ],
)
def test_mistakes_in_options(capsys, words, meant):
    with pytest.raises(SystemExit) as ended:
        cli.main(words.split())
    assert ended.value.code == 2
    assert meant in capsys.readouterr().err


def test_a_folder_without_permission_to_write_is_refused(refused, monkeypatch):
    # root may write everywhere, so the system is asked through this call
    monkeypatch.setattr(os, 'access', lambda path, mode: mode != os.W_OK | os.X_OK)
    error = refused(['run', 'straight', '--out', 'runs']).err
    is_said(error, '--out runs: no permission to write')


@pytest.mark.needs('ordinary_user')
def test_a_folder_below_one_that_may_not_be_entered_is_refused_with_its_option(tmp_path):
    locked = tmp_path / 'locked'
    locked.mkdir(mode=0o600)
    out = locked / 'runs'
    command = [*ORDINARY_USER, sys.executable, '-m', 'experiments.cli', 'run', 'straight']
    done = subprocess.run(
        [*command, '--out', str(out)], capture_output=True, text=True, timeout=240, cwd=tmp_path
    )
    assert done.returncode == 1
    expected = f'error: --out {out}: cannot create the folder {out}/straight: Permission denied\n'
    assert done.stderr == expected


def test_mistakes_are_reported_without_slow_imports():
    script = f"""
import sys
from experiments import cli

for words in (['nonsense'], ['straight', '--controller', 'nonsense']):
    assert cli.main(['run', *words]) == 1
assert not {{*{SLOW}, 'scipy.interpolate'}} & set(sys.modules)
assert cli.main(['run', 'straight', '--set', 'plant.nonsense=1']) == 1
assert not {{*{SLOW}}} & set(sys.modules)
"""
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures('tasks_here')
@pytest.mark.parametrize('words', [('library', '--draws', '1'), ('batch', 'study.yaml')])
def test_without_the_package_that_writes_the_table_nothing_is_driven(
    refused, tmp_path, monkeypatch, words
):
    (tmp_path / 'study.yaml').write_text(yaml.safe_dump(STUDY))
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name, *a: None if name == 'pyarrow' else find(name, *a)
    )
    assert 'pip install pyarrow' in refused([*words, '--out', 'table']).err
