import pytest
import yaml

from experiments.tuning import tuned_file
from msgs_yaml import share

BASE = share.path('mpcc_controller', 'config', 'mpcc.yaml')


def numbers(text):
    return yaml.safe_load(text)['/**']['ros__parameters']


def test_only_the_named_weights_change():
    base = BASE.read_text()
    changed = {'tolerances.lag_m': 0.0123, 'priorities.obstacle': 54321.0}
    made = tuned_file.text(base, changed, ['From a test.'])
    expected = numbers(base)
    expected['tolerances']['lag_m'] = 0.0123
    expected['priorities']['obstacle'] = 54321.0
    assert numbers(made) == expected
    assert made.startswith('# From a test.\n/**:\n')


def test_comments_stay_in_their_column():
    made = tuned_file.text(BASE.read_text(), {'tolerances.force_rate_nps': 1234.0}, [])
    line = next(one for one in made.splitlines() if 'force_rate_nps' in one)
    other = next(one for one in made.splitlines() if 'steer_rate_radps' in one)
    assert line.index('#') == other.index('#')


def test_a_comment_does_not_go_on_stating_the_old_value():
    changed = {'tolerances.heading_rad': 0.3, 'tolerances.steer_rate_radps': 0.2}
    lines = tuned_file.text(BASE.read_text(), changed, []).splitlines()
    (heading,) = (line for line in lines if 'heading_rad' in line)
    (rate,) = (line for line in lines if 'steer_rate_radps: 0.2' in line)
    assert heading.endswith('# rad, from the path')
    assert rate.endswith('# rad/s')


def test_long_headers_are_wrapped():
    made = tuned_file.text(BASE.read_text(), {}, ['word ' * 60])
    header = [line for line in made.splitlines() if line.startswith('#')]
    assert len(header) == 4
    assert all(len(line) <= tuned_file.WIDTH for line in header)


@pytest.mark.parametrize('value', [1e-07, 1.0, 123456.0, 2.5e22, 0.349])
def test_a_weight_is_read_back_as_the_number_it_is(value):
    assert yaml.safe_load(tuned_file.yaml_float(value)) == value


def test_an_unknown_weight_is_refused():
    with pytest.raises(KeyError, match=r'tolerances\.lug_m'):
        tuned_file.text(BASE.read_text(), {'tolerances.lug_m': 1.0}, [])
