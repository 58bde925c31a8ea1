"""A tuned controller file holds the tuned weights over the file that was tuned."""

import pytest
import yaml

from experiments.tuning import tune
from msgs_yaml import share
from node_runtime import parameters

CONFIG = share.path('mpcc_controller', 'config')
BASE = CONFIG / 'mpcc.yaml'


def read(folder, text):
    path = folder / 'tuned.yaml'
    path.write_text(text)
    return parameters.read_file(path, CONFIG).values


def test_only_the_named_weights_change(tmp_path):
    changed = {'tolerances.lag_m': 0.0123, 'priorities.obstacle': 54321.0}
    text = tune.controller_text(BASE, changed, ['From a test.'])
    assert read(tmp_path, text) == parameters.read_file(BASE, CONFIG).values | changed
    assert text.startswith('# From a test.\n/**:\n')
    assert set(yaml.safe_load(text)['/**']['ros__parameters']) == {
        'base',
        'tolerances',
        'priorities',
    }


def test_a_base_outside_of_the_config_folder_is_named_by_its_path(tmp_path):
    own = tmp_path / 'sub/mine.yaml'
    own.parent.mkdir()
    own.write_text(BASE.read_text().replace('lag_m: 0.5', 'lag_m: 0.6'))
    values = read(tmp_path, tune.controller_text(own, {'priorities.edge': 2.0}, []))
    assert values['tolerances.lag_m'] == 0.6
    assert values['priorities.edge'] == 2.0


def test_long_headers_are_wrapped():
    text = tune.controller_text(BASE, {}, ['word ' * 60])
    header = [line for line in text.splitlines() if line.startswith('#')]
    assert len(header) == 4
    assert all(len(line) <= tune.WIDTH for line in header)


@pytest.mark.parametrize('value', [1e-07, 1.0, 123456.0, 2.5e22, 0.349])
def test_a_weight_is_read_back_as_the_number_it_is(value, tmp_path):
    text = tune.controller_text(BASE, {'tolerances.lag_m': value}, [])
    assert read(tmp_path, text)['tolerances.lag_m'] == value


def test_an_unknown_weight_is_refused():
    with pytest.raises(KeyError, match=r'tolerances\.lug_m'):
        tune.controller_text(BASE, {'tolerances.lug_m': 1.0}, [])
