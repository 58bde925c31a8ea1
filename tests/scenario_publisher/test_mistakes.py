"""Every mistake in a scenario is one line that names file, line, key and what is allowed.

Whatever happens to a file, it is a scenario that can be driven or such a line.
"""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenario_publisher import scenario
from scenario_publisher.friction_patches import MAX_QUADRILATERALS
from scenario_publisher.scenario import ScenarioError

LINE = re.compile(r'bend\.yaml:\d+: [A-Za-z_. \[\]0-9]+: ', re.DOTALL)


def put(tree, key, new):
    """Set a dotted key, where [i] selects from a list."""
    *path, last = [int(s) if s.isdigit() else s for s in re.findall(r'\w+', key)]
    for step in path:
        tree = tree[step]
    tree[last] = new


def path_of(x, y):
    return {'points_m': np.column_stack([x, y]).tolist()}


def patch(from_m, to_m, from_offset_m, to_offset_m, friction=0.3):
    names = ('from_m', 'to_m', 'from_offset_m', 'to_offset_m', 'friction')
    return dict(zip(names, (from_m, to_m, from_offset_m, to_offset_m, friction)))


def patches(number):
    # each a dict of its own: the same one again would be written as an alias
    return [patch(2 * i, 2 * i + 1, 0, 4) for i in range(number)]


# name: (key, its new value, what the error says of it); the long values, the others are in the file
X = np.linspace(0.0, 40.0, 41)
LONG = {
    'path that doubles back': (
        'path',
        path_of([*X[:30], *X[10:29][::-1]], np.zeros(49)),
        r'points_m\[29\]: the line turns by 180 deg here',
    ),
    'path that jumps to the side': (
        'path',
        path_of(X, np.where(X > 20, 1.5, 0.0)),
        r'points_m\[20\]: the line turns by 56 deg here .* allowed at most 29 deg',
    ),
    'path with a kink': (
        'path',
        path_of(X, np.where((X > 20) & (X < 22), 0.2, 0.0)),
        'has a curvature of .*; allowed -0.2 to 0.2',
    ),
    'path with a gap': (
        'path',
        path_of([*X[:10], *X[30:]], np.zeros(21)),
        r'points_m\[9\]: a gap of 21 m beside a step of 1 m; allowed at most 10 times',
    ),
    'path that repeats a point': (
        'path',
        path_of([*X[:9], *X[8:]], np.zeros(42)),
        r'points_m\[9\]: repeats the point before; allowed at least 0.001 m',
    ),
    'too many obstacles': (
        'obstacles',
        [{'x_m': 20.0, 'y_m': 2.0, 'radius_m': 0.5} for _ in range(201)],
        'has 201 obstacles; allowed at most 200',
    ),
    'too many patches': (
        'friction_patches',
        patches(MAX_QUADRILATERALS + 1),
        'has 17 patches; allowed at most 16',
    ),
    'patch whose pieces no longer fit': (
        'friction_patches',
        [*patches(MAX_QUADRILATERALS - 2), patch(40, 80, 0, 4)],
        r'\[14\]: needs more than 2 quadrilaterals to follow the road; '
        'allowed 16 for all patches, 14 are taken by those before',
    ),
}
FILE = Path(__file__).parent / 'mistakes.yaml'
MISTAKES = yaml.safe_load(FILE.read_text()) | LONG


@pytest.mark.parametrize('mistake', MISTAKES)
def test_mistake_is_named_with_line_key_and_what_is_allowed(make, tree, mistake):
    key, new, message = MISTAKES[mistake]
    put(tree, key, new)
    with pytest.raises(ScenarioError, match=message) as caught:
        make(tree)
    assert LINE.match(str(caught.value)), str(caught.value)
    assert '\n' not in str(caught.value)
    assert 'allowed' in str(caught.value) or 'nothing could' in str(caught.value)


def nodes(tree):
    """Return (container, key) of everything in a tree."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, inside in list(pairs):
        yield tree, key
        if isinstance(inside, dict | list):
            yield from nodes(inside)


odd_values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=5),
    st.lists(st.floats(-50, 50), max_size=4),
    st.lists(st.lists(st.floats(-50, 50), min_size=2, max_size=2), max_size=5),
    st.dictionaries(st.sampled_from(['x_m', 'offset_m', 'points_m', 'arc']), st.floats(0, 9)),
    st.sampled_from([-1.0, 0.0, 0.5, 1.0, 3.0, 9.0, 39.0, 1e3, 1e4]),
)


def scenario_or_error(make, given):
    """Return the scenario, or None where an error names the file."""
    try:
        scn = make(given)
    except ScenarioError as caught:
        said, scn = str(caught), None
    else:
        said = 'bend.yaml'
    assert said.startswith('bend.yaml')
    if scn is None:
        return None
    assert np.all(np.isfinite(np.concatenate([*scn.reference[1:]])))
    assert np.all(np.diff(scn.reference.t) > 0.0)
    assert np.isfinite(scn.patches.corners_m).all()
    assert len(scn.patches.friction) <= MAX_QUADRILATERALS
    return scn


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_corruption_is_a_scenario_or_a_named_error(make, tree, data):
    corrupted = copy.deepcopy(tree)
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(list(nodes(corrupted))))
        container[key] = data.draw(odd_values)
    scenario_or_error(make, corrupted)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(numbers=st.lists(st.floats(-2.0, 90.0) | st.floats(), min_size=5, max_size=5))
def test_any_numbers_are_patches_the_plant_takes_or_a_named_error(make, tree, numbers):
    tree['friction_patches'] = [patch(*numbers)]
    scn = scenario_or_error(make, tree)
    assert scn is None or scn.patches.friction


def test_files_that_are_none_are_refused(tmp_path):
    huge, binary = tmp_path / 'huge.yaml', tmp_path / 'a.yaml'
    with huge.open('wb') as file:
        file.truncate(scenario.MAX_BYTES + 1)
    binary.write_bytes(b'\x89PNG\xff\xfe')
    wrong = {
        huge: r'allowed at most 8000000 bytes',  # before it is read
        binary: r'is no UTF-8 text',
        tmp_path / 'none.yaml': str(tmp_path),
        tmp_path / '.yaml': str(tmp_path),
    }
    for path, error in wrong.items():
        with pytest.raises(ScenarioError, match=error):
            scenario.load(path)
