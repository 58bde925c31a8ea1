"""Every mistake in a scenario is one line that names file, line, key and what is allowed.

Whatever happens to a file, it is a scenario that can be driven or such a line.
"""

import copy
import re

import numpy as np
import pytest
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


def line_of(x, y):
    return np.column_stack([x, y]).tolist()


def slow(x_m, y_m, **more):
    return {'x_m': x_m, 'y_m': y_m, 'radius_m': 0.5, **more}


def patch(from_m, to_m, from_offset_m, to_offset_m, friction=0.3):
    names = ('from_m', 'to_m', 'from_offset_m', 'to_offset_m', 'friction')
    return dict(zip(names, (from_m, to_m, from_offset_m, to_offset_m, friction)))


def patches(number):
    # each a dict of its own: the same one again would be written as an alias
    return [patch(2 * i, 2 * i + 1, 0, 4) for i in range(number)]


X = np.linspace(0.0, 40.0, 41)
WAY_BACK = [*X[:30], *X[10:29][::-1]]
JUMP = line_of(X, np.where(X > 20, 1.5, 0.0))
KINK = line_of(X, np.where((X > 20) & (X < 22), 0.2, 0.0))

MISTAKES = {
    'schema of another version': ('schema', 2, 'is 2; allowed 1'),
    'name that is no folder': ('name', '../up', 'allowed 1 to 64 of a-z'),
    'unknown key': ('stop.progres_m', 1.0, r"unknown key; did you mean 'progress_m'\?; allowed"),
    'friction': ('friction', 0.0, 'is .*; allowed 0.05 to 1.5'),
    'not finite': ('road.edges.left.offset_m', float('nan'), 'must be finite'),
    'speed': ('speed.constant_mps', 500.0, 'is .*; allowed'),
    'edge on the other side': ('road.edges.left.offset_m', -1.0, r'must not cross\); allowed 0.5'),
    'right edge on the left': ('road.edges.right.offset_m', 4.5, r'allowed -100 to -0.5 m'),
    'edge beyond the centre of the bend': (
        'road.edges.left.offset_m',
        49.0,
        'folds back in the bend of radius 50 m',
    ),
    'edge that jumps': (
        'road.edges.left',
        {'stations_m': [0, 10, 11], 'offsets_m': [4, 4, 8]},
        r'offsets_m\[2\]: jumps by 4 m within 1 m; allowed at most 1 m per metre',
    ),
    'edge table of odd length': (
        'road.edges.left',
        {'stations_m': [0, 10], 'offsets_m': [4]},
        'has 1 values for 2 stations; allowed one for each',
    ),
    'stations that go back': (
        'speed',
        {'stations_m': [0, 20, 10], 'speeds_mps': [9, 9, 9]},
        r'stations_m\[2\]: is not larger than the station before; allowed only increasing',
    ),
    'empty table': ('speed', {'stations_m': [], 'speeds_mps': []}, 'has 0 values for 0 stations'),
    'edge of its own that crosses the road': (
        'road.edges.left',
        {'points_m': [[0, 4], [40, -4], [90, 4]]},
        'comes within 0.5 m of the centre line or crosses it at',
    ),
    'edge of its own that ends too early': (
        'road.edges.left',
        {'points_m': [[-1, 4], [20, 4]]},
        'm shorter than the road; allowed from its start to its end',
    ),
    'edge of its own with one point': (
        'road.edges.left',
        {'points_m': [[0, 4]]},
        'has 1 points; allowed at least 2',
    ),
    'no segments': ('path.segments', [], 'is empty; allowed at least 1 segment'),
    'segment of no kind': ('path.segments[0]', {'curve': {}}, 'has none of straight, arc'),
    'lane change across the road': (
        'path.segments[0]',
        {'lane_change': {'length_m': 10.0, 'offset_m': 20.0}},
        r'lane_change.offset_m: moves 20 m aside within 10 m; allowed at most',
    ),
    'lane change too sharp for a car': (
        'path.segments[0]',
        {'lane_change': {'length_m': 4.0, 'offset_m': 2.0}},
        r'has a curvature of .* 1/m at station .* m; allowed -0.2 to 0.2 1/m',
    ),
    'path that turns away from the road': (
        'path.segments[1].arc.curvature_1pm',
        -0.02,
        r'path: leaves the road at station \d+.\d m, .* m beyond the right edge; allowed only',
    ),
    'path beside the road': ('path.start.y_m', 5.0, r'at station 0.0 m, .* 1.00 m beyond the left'),
    'path longer than the road': (
        'path.segments[0].straight.length_m',
        60.0,
        r'path: leaves the road .*; allowed only between the edges',
    ),
    'path too long to publish': (
        'path.segments[0].straight.length_m',
        19990.0,
        r'needs 40061 samples; allowed at most 40000',
    ),
    'path that doubles back': (
        'path',
        {'points_m': line_of(WAY_BACK, np.zeros(len(WAY_BACK)))},
        r'points_m\[29\]: the line turns by 180 deg here',
    ),
    'path that jumps to the side': (
        'path',
        {'points_m': JUMP},
        r'points_m\[20\]: the line turns by 56 deg here .* allowed at most 29 deg',
    ),
    'path with a kink': ('path', {'points_m': KINK}, 'has a curvature of .*; allowed -0.2 to 0.2'),
    'path with a gap': (
        'path',
        {'points_m': line_of([*X[:10], *X[30:]], np.zeros(21))},
        r'points_m\[9\]: a gap of 21 m beside a step of 1 m; allowed at most 10 times',
    ),
    'path that repeats a point': (
        'path',
        {'points_m': line_of([*X[:9], *X[8:]], np.zeros(42))},
        r'points_m\[9\]: repeats the point before; allowed at least 0.001 m',
    ),
    'path of triples': ('path', {'points_m': [[0, 0, 0], [1, 0, 0]]}, 'has 3 elements; allowed'),
    'stop beyond the path': ('stop.progress_m', 81.0, 'beyond the end .* allowed up to 80.00 m'),
    'stop behind the start': ('start.progress_m', 70.0, 'not ahead of the start; allowed more'),
    'start beyond the path': (
        'start.progress_m',
        95.0,
        'beyond the end of the path; allowed 0 to 80.00 m',
    ),
    'start pose behind the finish': (
        'start',
        {'x_m': 78.0, 'y_m': 16.0, 'yaw_rad': 0.7, 'speed_mps': 5.0},
        'stop.progress_m: is 60 m, not ahead of the start; allowed more than 80.00 m',
    ),
    'start the wrong way': (
        'start',
        {'x_m': 5.0, 'y_m': 0.0, 'yaw_rad': 3.0, 'speed_mps': 5.0},
        'start: points 172 deg away from the path beside it; allowed up to 90 deg',
    ),
    'start off the road': (
        'start',
        {'x_m': 10.0, 'y_m': 9.0, 'yaw_rad': 0.0, 'speed_mps': 5.0},
        r'start: lies off the road at \(10.0, 9.0\)',
    ),
    'start in an obstacle': (
        'obstacles[0]',
        slow(1.0, 0.5),
        r'obstacles\[0\]: covers the start: .* overlaps it by 0.48 m; allowed a gap larger',
    ),
    'obstacle off the road': (
        'obstacles[1]',
        slow(20.0, 6.0),
        r'obstacles\[1\]: lies off the road by 1.50 m at all times; allowed any place',
    ),
    'obstacle behind the road': ('obstacles[1]', slow(-9.0, 0.0), 'off the road by 8.50 m'),
    'obstacle that never comes': (
        'obstacles[1]',
        slow(20.0, 30.0, vy_mps=-1.0),
        'off the road by 5.50 m',
    ),
    'obstacle beyond the road': (
        'obstacles[1].station_m',
        81.0,
        'lies beyond the road with 81; allowed 0 to 80.00 m',
    ),
    'obstacle that is gone before it comes': (
        'obstacles[1]',
        slow(20.0, 2.0, appears_at_s=5.0, disappears_at_s=5.0),
        r'is not later than it appears \(5 s\); allowed only later',
    ),
    'obstacle after the end of the run': (
        'obstacles[1]',
        slow(20.0, 2.0, appears_at_s=20.0),
        'is 20 s, when the run is over; allowed less than 20 s',
    ),
    'obstacle of no size': ('obstacles[1].radius_m', 0.0, 'allowed 0.01 to 50 m'),
    'obstacle in two frames': ('obstacles[1].x_m', 3.0, 'has x_m and station_m; allowed exactly'),
    'too many obstacles': (
        'obstacles',
        [slow(20.0, 2.0) for _ in range(201)],
        'has 201 obstacles; allowed at most 200',
    ),
    'obstacle of another motion': (
        'obstacles[1].motion',
        'along',
        "is 'along'; did you mean 'along_road'\\?; allowed straight or along_road",
    ),
    'road far away': ('road.centre_line.start.x_m', 9999.0, 'reaches a coordinate of'),
    'patch of no friction': (
        'friction_patches',
        [patch(5, 9, 0, 4, 0.0)],
        r'\[0\].friction: is .*; allowed 0.05 to 1.5',
    ),
    'patch before the road': ('friction_patches', [patch(-1, 9, 0, 4)], 'is .* 0 to 20000 m'),
    'patch beyond the road': (
        'friction_patches',
        [patch(5, 81, 0, 4)],
        r'\[0\].to_m: lies beyond the road with 81; allowed up to 80.00 m',
    ),
    'patch backwards': (
        'friction_patches',
        [patch(9, 5, 0, 4)],
        r'\[0\].to_m: is 5 m, not 0.1 m beyond from_m; allowed 9.1 m or more',
    ),
    'patch with left before right': (
        'friction_patches',
        [patch(5, 9, 4, 0)],
        r'\[0\].to_offset_m: is 0 m, not 0.1 m beyond from_offset_m; allowed 4.1 m or more',
    ),
    'patch beyond the centre of the bend': (
        'friction_patches',
        [patch(30, 60, 0, 49)],
        r'\[0\].to_offset_m: folds back in the bend at station \d+.\d m; allowed less than 0.95',
    ),
    'patch without an end': (
        'friction_patches',
        [{key: value for key, value in patch(5, 9, 0, 4).items() if key != 'to_m'}],
        r'\[0\].to_m: is missing; allowed 0 to 20000 m',
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
    'expected of a word': (
        'expect',
        {'survived': 'maybe'},
        'allowed true, false, or a block of at_least and at_most',
    ),
    'expected of a number': ('expect', {'ticks': 3}, 'allowed true, false, or a block'),
    'no bound': ('expect', {'ticks': {}}, 'is empty; allowed at_least, at_most or both'),
    'unknown bound': ('expect', {'ticks': {'at_last': 3}}, r"unknown key; did you mean 'at_least'"),
    'bound that is no number': ('expect', {'ticks': {'at_least': True}}, 'must be a number'),
    'bound that is not finite': ('expect', {'ticks': {'at_least': float('nan')}}, 'must be finite'),
    'bounds that nothing meets': (
        'expect',
        {'ticks': {'at_least': 3, 'at_most': 2}},
        'at_least 3 is above at_most 2; nothing could be both',
    ),
    'no metric': ('expect', {'No Metric': True}, 'is no name of a metric; allowed a-z'),
}


@pytest.mark.parametrize('mistake', MISTAKES)
def test_mistake_is_named_with_line_key_and_what_is_allowed(make, tree, mistake):
    key, new, message = MISTAKES[mistake]
    put(tree, key, new)
    with pytest.raises(ScenarioError, match=message) as caught:
        make(tree)
    assert LINE.match(str(caught.value)), str(caught.value)
    assert '\n' not in str(caught.value)
    assert 'allowed' in str(caught.value) or 'nothing could' in str(caught.value)


def every_key(tree, prefix=''):
    for name, inside in tree.items():
        yield f'{prefix}{name}'
        if isinstance(inside, dict):
            yield from every_key(inside, f'{prefix}{name}.')


def test_every_key_is_missed_by_its_name(make, tree):
    for key in every_key(tree):
        corrupted = copy.deepcopy(tree)
        block = corrupted
        *path, last = key.split('.')
        for step in path:
            block = block[step]
        del block[last]
        with pytest.raises(ScenarioError) as caught:
            make(corrupted)
        assert last in str(caught.value)


def test_line_of_a_mistake_is_the_line_in_the_file_and_a_key_is_given_once(make, text):
    corrupted = text.replace('friction: 1.0', 'friction: 9.0')
    number = corrupted[: corrupted.index('friction')].count('\n') + 1
    with pytest.raises(ScenarioError, match=rf'^bend.yaml:{number}: friction: '):
        make(corrupted)
    with pytest.raises(ScenarioError, match=r'friction: appears twice'):
        make(text + 'friction: 0.5\n')
    assert make(text).name == 'bend'


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
def test_any_corruption_is_a_scenario_or_a_named_error(make, tree, text, data):
    corrupted = copy.deepcopy(tree)
    for _ in range(data.draw(st.integers(1, 3))):
        container, key = data.draw(st.sampled_from(list(nodes(corrupted))))
        container[key] = data.draw(odd_values)
    scenario_or_error(make, corrupted)
    place = data.draw(st.integers(0, len(text) - 1))
    damage = data.draw(
        st.sampled_from(['', ' ', '\n', ':', '-', '[', '{', '*', '&', '!', '9', 'e'])
    )
    scenario_or_error(make, text[:place] + damage + text[place + data.draw(st.integers(0, 4)) :])


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
