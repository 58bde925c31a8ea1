"""Runs of different scenarios or plants are not comparable."""

import json

import pytest

from bags.errors import BagError
from bags.report.comparability import check_comparable

PLANT = {'friction': 1.0, 'car.body.mass_kg': 1850.0, 'mode': 'lockstep', 'tyre_set': 'a.yaml'}


def info(scenario='s', sha='1', **plant):
    entries = {'plant': {**PLANT, **plant}, 'controller': {'weight': 1.0}}
    return {'scenario': scenario, 'scenario_sha256': sha, 'parameters': json.dumps(entries)}


def test_the_same_car_on_the_same_road_compares_however_it_was_run():
    check_comparable(['a', 'b'], [info(), info(mode='realtime', tyre_set='/elsewhere/a.yaml')])


@pytest.mark.parametrize(
    ('other', 'said'),
    [
        (info(scenario='t', sha='2'), "different scenarios ('s' and 't')"),
        (info(sha='2'), "two versions of 's'"),
        (info(friction=0.9), 'different plants (friction 1.0 and 0.9)'),
        ({'scenario': 's', 'scenario_sha256': '1'}, 'car.body.mass_kg 1850.0 and unknown'),
    ],
)
def test_another_road_or_car_does_not_compare_and_the_difference_is_named(other, said):
    with pytest.raises(BagError) as refused:
        check_comparable(['a', 'b', 'c'], [info(), info(), other])
    assert said in str(refused.value)
    assert 'a and c' in str(refused.value)
    assert '--force' in str(refused.value)


def test_many_differences_are_counted():
    other = info(**{f'car.p{k}': 1.0 for k in range(9)})
    with pytest.raises(BagError, match='and 6 more'):
        check_comparable(['a', 'b'], [info(), other])
