"""Every mistake in a scenario is one line that names file, line, key and what is allowed."""

import copy
import re

import numpy as np
import pytest
import yaml

from scenario_publisher.scenario import ScenarioError

LINE = re.compile(r'bend\.yaml:\d+: [a-z_.\[\]0-9]+: .*; allowed ', re.DOTALL)


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
    'road far away': ('road.centre_line.start.x_m', 9999.0, 'reaches a coordinate of'),
}


@pytest.mark.parametrize('mistake', MISTAKES)
def test_mistake_is_named_with_line_key_and_what_is_allowed(make, tree, mistake):
    key, new, message = MISTAKES[mistake]
    put(tree, key, new)
    with pytest.raises(ScenarioError, match=message) as caught:
        make(tree)
    assert LINE.match(str(caught.value)), str(caught.value)
    assert '\n' not in str(caught.value)


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


def test_line_of_a_mistake_is_the_line_in_the_file(make, text):
    corrupted = text.replace('friction: 1.0', 'friction: 9.0')
    number = corrupted[: corrupted.index('friction')].count('\n') + 1
    with pytest.raises(ScenarioError, match=rf'^bend.yaml:{number}: friction: '):
        make(corrupted)


def test_key_given_twice_is_refused(make, text):
    with pytest.raises(ScenarioError, match=r'friction: appears twice'):
        make(text + 'friction: 0.5\n')


def test_fixture_is_valid_to_begin_with(make, tree, text):
    assert yaml.safe_load(text) == tree
    assert make(text).name == 'bend'
