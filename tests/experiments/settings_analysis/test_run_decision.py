"""The commands on many settings, with real drives."""

import dataclasses
import json

import pandas as pd
import pytest
import yaml
from rich.console import Console

from bags.errors import BagError
from experiments import simulation
from experiments.pool import Pool
from experiments.settings import arms, preregistration
from experiments.settings import setting as settings
from experiments.settings.setting import Setting
from experiments.settings_analysis import picture as pictures
from experiments.settings_analysis import picture_search, run_decision
from experiments.settings_analysis.run_decision import Request

# the first settings of this seed pose the problems of few solvers: each is compiled for 15 s
SEED = 10


def request(part, out, **changes):
    values = {'folders': (), 'number': None, 'seed': SEED, 'trials': None, 'jobs': 1}
    return Request(**values | {'part': part, 'out': out, 'quick': True} | changes)


@pytest.mark.parametrize('part', ['decide', 'setting'])
def test_what_is_missing_is_named(tmp_path, part):
    with pytest.raises(BagError, match=part):
        run_decision.run(request(part, tmp_path), Console(quiet=True))


def test_a_folder_without_tables_is_refused(tmp_path):
    with pytest.raises(BagError, match=r'drives\.parquet'):
        run_decision.run(request('decide', tmp_path, folders=[tmp_path]), Console(quiet=True))


@pytest.fixture(scope='module')
def admissible():
    plan = preregistration.load()
    drawn = enumerate(settings.draw(plan, SEED, 0, 256))
    built = (settings.build(plan, number, values) for number, values in drawn)
    return next(one for one in built if isinstance(one, Setting))


@pytest.mark.slow
def test_one_setting_alone_can_be_driven_again_by_hand(tmp_path, admissible):
    number = admissible.number
    run_decision.run(request('setting', tmp_path, number=number), Console(quiet=True))
    folder = tmp_path / f'setting_{number}'
    drives = pd.read_csv(folder / 'drives.csv').set_index('arm')
    assert set(drives.index) == {arms.NO_CA, arms.MPCC, arms.MATCHED, arms.LINEAGE}
    # its files are enough for any other command
    plant = dict(admissible.plant.settings) | {'command_delay_ms': admissible.values['latency_ms']}
    scenario, controller = (str(folder / name) for name in ('setting.yaml', 'setting_mpcc.yaml'))
    setup = simulation.prepare(scenario, controller, {'plant': plant})
    own = arms.build(preregistration.load(), admissible, arms.MPCC)
    assert setup.params.safety.obstacle_m == own.settings['safety.obstacle_m']
    assert setup.params.tolerances.lag_m == own.settings['tolerances.lag_m']


@pytest.mark.slow
def test_a_search_goes_on_where_it_stopped(tmp_path):
    plan, picture = preregistration.load(), pictures.load()
    with Pool(1) as pool:

        def search(trials, folder):
            return picture_search.search(plan, picture, trials, folder, pool, lambda _: None)

        # of these three points the last one is a setting, which is driven
        first, longer = search(2, tmp_path / 'a'), search(3, tmp_path / 'a')
        whole = search(3, tmp_path / 'b')
    assert longer[:2] == first
    assert [one.rejected == '' for one in longer] == [False, False, True]
    assert [one.values for one in longer] == [one.values for one in whole]
    assert [one.distance for one in longer] == [one.distance for one in whole]


@pytest.mark.slow
def test_the_search_writes_the_nearest_setting(tmp_path, monkeypatch):
    picture = pictures.load()
    few = dataclasses.replace(picture.hold_out, perturbations=1, neighbours=1)
    drawn = dataclasses.replace(picture.search, seed=SEED)
    small = dataclasses.replace(picture, hold_out=few, search=drawn)
    monkeypatch.setattr(pictures, 'load', lambda: small)
    run_decision.run(request('exists', tmp_path, trials=2), Console(quiet=True))
    result = json.loads((tmp_path / 'existence.json').read_text())
    assert result['trials'] == 2
    assert len(result['judged']) == 2
    nearest = yaml.safe_load((tmp_path / 'nearest_setting.yaml').read_text())
    assert nearest == {
        name.removeprefix('value.'): value
        for name, value in result['judged'][0].items()
        if name.startswith('value.')
    }
