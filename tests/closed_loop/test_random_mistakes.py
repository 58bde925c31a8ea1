"""A random scenario with an invalid value gives one clear error, never a traceback.

The series is fixed, so that a failure is due to the change under test; RANDOM_SEED chooses another.
"""

import copy
import math
import os
import re

import independent_evaluation
import numpy as np
import pytest
import random_scenarios
import yaml

from scenario_publisher import scenario
from scenario_publisher.scenario import ScenarioError

SEED = int(os.environ.get('RANDOM_SEED', random_scenarios.SEED))
SCENARIOS, MISTAKES = 12, 25
# as docs/scenarios.md has them; a key with its parent counts before the key alone
RANGES = {
    'friction': (0.05, 1.5),
    'stop.progress_m': (1.0, 20000.0),
    'start.speed_mps': (0.0, 100.0),
    'yaw_rad': (-6.3, 6.3),
    'length_m': (0.5, 20000.0),
    'radius_m': (0.01, 50.0),
    'time_s': (0.5, 600.0),
    **dict.fromkeys(('x_m', 'y_m', 'points_m'), (-10000.0, 10000.0)),
    **dict.fromkeys(('progress_m', 'station_m', 'stations_m', 'from_m', 'to_m'), (0.0, 20000.0)),
    **dict.fromkeys(('curvature_1pm', 'start_curvature_1pm', 'end_curvature_1pm'), (-0.2, 0.2)),
    **dict.fromkeys(('offset_m', 'offsets_m', 'from_offset_m', 'to_offset_m'), (-100.0, 100.0)),
    **dict.fromkeys(('constant_mps', 'speeds_mps', 'speed_mps'), (1.0, 100.0)),
    **dict.fromkeys(('vx_mps', 'vy_mps', 'along_mps', 'across_mps'), (-50.0, 50.0)),
    **dict.fromkeys(('appears_at_s', 'disappears_at_s'), (0.0, 600.0)),
    **dict.fromkeys(('path_m', 'edges_m'), (0.1, 5.0)),
}
UNSUITABLE = (math.nan, math.inf, -math.inf, 'fast', True, None, [1.0], {'m': 1.0})


def numbers(value, key=''):
    """Return the dotted keys of all numbers, grouped by the key without indices."""
    found = {}
    parts = value.items() if isinstance(value, dict) else enumerate(value)
    for name, part in parts:
        inner = f'{key}[{name}]' if isinstance(value, list) else f'{key}.{name}'.strip('.')
        if isinstance(part, dict | list):
            for kind, keys in numbers(part, inner).items():
                found.setdefault(kind, []).extend(keys)
        elif isinstance(part, float):
            found.setdefault(re.sub(r'\[\d+\]', '', inner), []).append(inner)
    return found


def allowed(kind):
    parent = '.'.join(kind.split('.')[-2:])
    return RANGES[parent if parent in RANGES else kind.split('.')[-1]]


def outside(rng, low, high):
    """Return a number beyond a bound, by very little or by very much."""
    excess = 10.0 ** rng.uniform(-5.0, 8.0) * max(abs(low), abs(high))
    return high + excess if rng.random() < 0.5 else low - excess


def put(document, key, new):
    *path, last = [int(part) if part.isdigit() else part for part in re.findall(r'\w+', key)]
    for part in path:
        document = document[part]
    document[last] = new


@pytest.mark.parametrize('index', range(SCENARIOS))
def test_a_value_out_of_range_is_refused_with_its_key_and_what_is_allowed(index):
    rng = np.random.default_rng([SEED, index, 1])
    document = loaded(random_scenarios.draw(SEED, index).text)
    keys = numbers(document)
    for _ in range(MISTAKES):
        kind = str(rng.choice(sorted(keys)))
        key = str(rng.choice(keys[kind]))
        low, high = allowed(kind)
        wrong = copy.deepcopy(document)
        new = outside(rng, low, high)
        if rng.random() < 0.3:
            new = UNSUITABLE[rng.integers(len(UNSUITABLE))]
        put(wrong, key, new)
        error = refusal(wrong)
        assert error, f'{key} = {new} is accepted (seed {SEED}, index {index})'
        assert re.match(rf'drawn\.yaml:\d+: {re.escape(key)}[:.\[]', error), (
            f'{key} = {new}: {error}'
        )
        if isinstance(new, float):
            assert f'allowed {low:g} to {high:g}' in error, f'{key} = {new}: {error}'


def loaded(text):
    return yaml.load(text, Loader=getattr(yaml, 'CSafeLoader', yaml.SafeLoader))


def refusal(document):
    """Return why a scenario is refused, or ''."""
    text = yaml.dump(document, Dumper=random_scenarios.DUMPER, sort_keys=False)
    try:
        scenario.parse(text, 'drawn.yaml')
    except ScenarioError as error:
        return str(error)
    return ''


def test_a_start_off_the_road_or_across_it_is_refused():
    """Draws start anywhere now and then; the schema takes those on the road, along the path."""
    refused = 0
    for index in range(60):
        one = random_scenarios.draw(SEED, index)
        if one.start is None:
            continue
        scn, document = scenario.parse(one.text, 'drawn.yaml'), loaded(one.text)
        names = ('x_m', 'y_m', 'yaw_rad', 'speed_mps')
        document['start'] = dict(zip(names, map(float, one.start)))
        error = refusal(document)
        point = np.array([[one.start.X, one.start.Y]])
        left = -float(independent_evaluation.left_of(point, scn.edges.left)[0])
        right = float(independent_evaluation.left_of(point, scn.edges.right)[0])
        near = np.argmin(np.hypot(*(point.T - [scn.reference.X, scn.reference.Y])))
        turned = abs(math.remainder(one.start.psi - scn.reference.psi[near], math.tau))
        if min(left, right) < -0.1 or turned > math.pi / 2 + 0.1:
            refused += 1
            assert error, f'accepted (seed {SEED}, index {index})'
        if error:
            assert re.match(r'drawn\.yaml:\d+: (start|stop|obstacles)\b.*; allowed', error), error
    assert refused
