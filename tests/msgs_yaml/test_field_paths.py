"""Field paths: what they select, and what is no path."""

from types import SimpleNamespace as Has

import pytest

from msgs_yaml import field_paths

LEFT = Has(ns='left', points=[Has(x=1.0), Has(x=2.0)])
RIGHT = Has(ns='right', points=[Has(x=3.0)])
MESSAGE = Has(markers=[LEFT, RIGHT], pose=Has(x=7.0), status=[Has(name='a', level=1)])


@pytest.mark.parametrize(
    ('path', 'values'),
    [
        ('pose.x', [7.0]),
        ('markers', [[LEFT, RIGHT]]),
        ('markers[*].ns', ['left', 'right']),
        ('markers[*].points[*].x', [1.0, 2.0, 3.0]),
        ('markers[left].points[*].x', [1.0, 2.0]),
        ('markers[*ght].points[*].x', [3.0]),
        ('markers[centre].points[*].x', []),
        ('markers[right]', [RIGHT]),
        ('status[a].level', [1]),
    ],
)
def test_a_path_gives_every_value_it_leads_to_in_order(path, values):
    assert field_paths.getter(path)(MESSAGE) == values


@pytest.mark.parametrize('path', ['', '.', 'a..b', 'a[', 'a[]', 'A', 'a[*]b', 'a.b.', 'a b', '1'])
def test_what_is_no_path_is_rejected(path):
    with pytest.raises(ValueError, match='is no field path'):
        field_paths.parse(path)


def test_only_labelled_things_can_be_selected_by_label():
    with pytest.raises(TypeError, match='has no namespace, name or key'):
        field_paths.getter('pose[left]')(Has(pose=[3.0]))
