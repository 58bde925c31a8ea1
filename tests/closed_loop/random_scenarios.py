"""Scenarios drawn at random over the documented range of the schema (docs/scenarios.md).

A draw is decided by two integers, `seed` and `index`, and by nothing else. What the schema's
geometric checks refuse is drawn again, so every scenario here is a valid one.
"""

import copy
import math
from typing import Any, NamedTuple

import numpy as np
import yaml

from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario, ScenarioError, Start

# libyaml is a hundred times faster than Python, but is not everywhere
DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
SEED = 672772597  # of the series that the tests take
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
ATTEMPTS = 200
MAX_SAMPLES = 4900  # of a line; the schema allows 40000, which take longer to drive
LARGEST_TURN = 2.6  # rad of the road from its start, so that it does not cross itself
CAR_RADIUS = 1.1  # m, no obstacle covers the start
SPEEDS, FRICTIONS, RADII = (1.0, 100.0), (0.05, 1.5), (0.01, 50.0)
SHORTEST_S, LONGEST_S = 0.4, 1.0  # of a drive, so that many fit into a test
BEYOND = 0.2  # share of drives that start where the schema refuses: off the road, any heading


class Draw(NamedTuple):
    """One drive that was drawn."""

    seed: int
    index: int
    controller: str  # a name of CONTROLLERS
    text: str  # the scenario file
    start: Start | None  # in place of the scenario's: anywhere, in any direction
    time_s: float  # longest drive


class Guide(NamedTuple):
    """A published line to place things on, n samples."""

    s: np.ndarray  # m
    X: np.ndarray  # m
    Y: np.ndarray  # m
    psi: np.ndarray  # rad


def draw(seed: int, index: int) -> Draw:
    """Return drive number `index` of a series. Raises RuntimeError when no valid one is found."""
    rng = np.random.default_rng([seed, index])
    refused = ''
    for _ in range(ATTEMPTS):
        try:
            text, start, time_s = _attempt(rng, f'draw_{seed}_{index}')
        except ScenarioError as error:
            refused = str(error)
            continue
        return Draw(seed, index, CONTROLLERS[index % len(CONTROLLERS)], text, start, time_s)
    raise RuntimeError(f'seed {seed}, index {index}: {ATTEMPTS} scenarios refused; last: {refused}')


def written(document: dict[str, Any]) -> str:
    """Return a document as YAML without aliases, which a scenario file may not have."""
    return yaml.dump(_plain(document), Dumper=DUMPER, sort_keys=False)


def _plain(value):
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return round(float(value), 6) if isinstance(value, float) else value


def _attempt(rng, name):
    road, widths, length, edge_points = _road(rng)
    line = copy.deepcopy(road['centre_line'])
    document = {
        'schema': 1,
        'name': name,
        'description': 'Drawn at random.',
        'road': road,
        'path': line,
        'speed': {'constant_mps': 10.0},
        'friction': _log(rng, *FRICTIONS),
        'start': {'progress_m': 0.0},
        'stop': {'progress_m': 1.0, 'time_s': _log(rng, 0.5, 600.0)},
        'obstacles': [],
        'sampling': _sampling(rng, length),
    }
    centre_scn = scenario.parse(written(document), name)
    centre = _guide(centre_scn)
    if edge_points:
        road['edges'][edge_points] = _own_edge(rng, getattr(centre_scn.edges, edge_points))
    path = centre
    if rng.random() < 0.6:
        points = _wandering(rng, centre, widths)
        document['path'], path = {'points_m': points.tolist()}, _along(points)
    document['speed'] = _speed(rng, path)
    begin = float(rng.uniform(0.0, 0.7) * path.s[-1])
    document['start'], start = _start(rng, path, begin, widths)
    stop_m = min(begin + _log(rng, 2.0, 2.0 * path.s[-1]), path.s[-1] - 0.1)
    document['stop']['progress_m'] = max(1.0, stop_m)
    time_s = min(float(rng.uniform(SHORTEST_S, LONGEST_S)), document['stop']['time_s'])
    reach = begin, begin + time_s * max(start.speed, 5.0) + 30.0
    document['obstacles'] = _obstacles(rng, centre, widths, start, reach, time_s)
    if rng.random() < 0.5:
        document['friction_patches'] = _patches(rng, centre, widths, reach)
    text = written(document)
    start = scenario.parse(text, name).start
    beyond = _anywhere(rng, start, path, widths) if rng.random() < BEYOND else None
    return text, beyond, time_s


def _guide(scn: Scenario) -> Guide:
    X, Y, psi = scn.reference.X, scn.reference.Y, scn.reference.psi
    return Guide(_stations(X, Y), X, Y, psi)


def _along(points):
    X, Y = points.T
    psi = np.unwrap(np.arctan2(np.gradient(Y), np.gradient(X)))
    return Guide(_stations(X, Y), X, Y, psi)


def _stations(X, Y):
    return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(X), np.diff(Y)))])


def _log(rng, low, high):
    """Return a number between bounds, every order of magnitude as likely as another."""
    return float(np.clip(math.exp(rng.uniform(math.log(low), math.log(high))), low, high))


def _sampling(rng, length):
    least = max(0.1, length / MAX_SAMPLES)
    return {key: float(rng.uniform(least, 5.0)) for key in ('path_m', 'edges_m')}


def _road(rng):
    """Return the block `road`, the offsets of its edges, its length, and the edge to be points."""
    kind = rng.choice(['straight', 'segments', 'segments', 'points', 'laps'])
    length = _log(rng, 40.0, 5000.0)
    start = {
        'x_m': float(rng.uniform(-3000.0, 3000.0)),
        'y_m': float(rng.uniform(-3000.0, 3000.0)),
        'yaw_rad': float(rng.uniform(-6.3, 6.3)),
    }
    if kind == 'straight':
        line, tightest = {'start': start, 'segments': [{'straight': {'length_m': length}}]}, 0.0
    elif kind == 'laps':
        radius = float(rng.uniform(20.0, 120.0))
        length, tightest = radius * float(rng.uniform(1.0, 14.0)), 1.0 / radius
        arc = {'length_m': length, 'curvature_1pm': float(rng.choice([-1, 1])) / radius}
        line = {'start': start, 'segments': [{'arc': arc}]}
    elif kind == 'segments':
        segments, length, tightest = _segments(rng, length)
        line = {'start': start, 'segments': segments}
    else:
        points, length, tightest = _points(rng, start, min(length, 2000.0))
        line = {'points_m': points}
    sides, widths, edge_points = {}, {}, None
    for side, sign in (('left', 1.0), ('right', -1.0)):
        sides[side], widths[side] = _edge(rng, sign, tightest, length, kind == 'laps')
    if kind != 'laps' and rng.random() < 0.2:
        edge_points = str(rng.choice(['left', 'right']))
    return {'centre_line': line, 'edges': sides}, widths, length, edge_points


def _segments(rng, length):
    pieces, psi, done, tightest = [], 0.0, 0.0, 0.0
    while done < length:
        piece = min(_log(rng, 5.0, 600.0), max(length - done, 0.5))
        kind = rng.choice(['straight', 'arc', 'clothoid', 'lane_change'])
        if kind == 'straight':
            block = {'length_m': piece}
        elif kind == 'lane_change':
            offset = float(rng.uniform(-0.15, 0.15)) * piece
            offset = float(np.clip(offset, -20.0, 20.0))
            tightest = max(tightest, 6.5 * abs(offset) / piece**2)
            block = {'length_m': piece, 'offset_m': offset}
        else:
            # turn back towards the first heading as soon as the limit would be passed
            sign = float(rng.choice([-1, 1]))
            curvature = sign / _log(rng, 20.0, 2000.0)
            if abs(psi + curvature * piece) > LARGEST_TURN:
                curvature *= -math.copysign(1.0, curvature * (psi or 1.0))
            piece = min(piece, (LARGEST_TURN + abs(psi)) / abs(curvature))
            ends = (curvature, curvature)
            if kind == 'clothoid':
                ends = [(0.0, curvature), (curvature, 0.0)][rng.integers(2)]
            psi += (ends[0] + ends[1]) / 2 * piece
            tightest = max(tightest, abs(curvature))
            block = {'length_m': piece, 'curvature_1pm': curvature}
            if kind == 'clothoid':
                block = {
                    'length_m': piece,
                    'start_curvature_1pm': ends[0],
                    'end_curvature_1pm': ends[1],
                }
        pieces.append({str(kind): block})
        done += piece
    return pieces, done, tightest


def _points(rng, start, length):
    tightest = 1.0 / _log(rng, 20.0, 1000.0)
    step = float(rng.uniform(2.0, min(15.0, 0.3 / tightest)))
    count = max(4, int(length / step))
    wave = rng.uniform(2.0, 30.0) / tightest / 5.0
    phase = rng.uniform(0.0, 2.0 * np.pi)
    s = step * np.arange(count)
    # the heading swings: its rate is the curvature
    swing = min(LARGEST_TURN / 2, tightest * wave)
    psi = start['yaw_rad'] + swing * (np.sin(s / wave + phase) - np.sin(phase))
    X = start['x_m'] + np.concatenate([[0.0], np.cumsum(step * np.cos(psi[:-1]))])
    Y = start['y_m'] + np.concatenate([[0.0], np.cumsum(step * np.sin(psi[:-1]))])
    return np.column_stack([X, Y]).tolist(), step * (count - 1), 1.1 * swing / wave


def _edge(rng, sign, tightest, length, constant):
    """Return the block of an edge and the least of its offsets [m], without sign."""
    most = min(100.0, 0.9 / tightest if tightest else 100.0)
    usual = rng.random() < 0.8
    widest = float(rng.uniform(1.3, 8.0)) if usual else _log(rng, 0.5, 100.0)
    widest = max(0.5, min(widest, most))
    if constant or rng.random() < 0.5:
        return {'offset_m': sign * widest}, widest
    count = int(rng.integers(2, 7))
    stations = np.sort(rng.uniform(0.0, min(length, 9999.0), count))
    stations = stations[np.concatenate([[True], np.diff(stations) > 0.5])]
    offsets = [widest]
    for gap in np.diff(stations):
        wanted = widest * float(rng.uniform(0.3, 1.0))
        change = float(np.clip(wanted - offsets[-1], -0.9 * gap, 0.9 * gap))
        offsets.append(max(0.5, offsets[-1] + change))
    block = {'stations_m': stations.tolist(), 'offsets_m': [sign * one for one in offsets]}
    return block, min(offsets)


def _own_edge(rng, edge):
    keep = np.arange(0, len(edge), int(rng.integers(1, 6)))
    if keep[-1] != len(edge) - 1:
        keep = np.append(keep, len(edge) - 1)
    return {'points_m': edge[keep].tolist()}


def _wandering(rng, centre, widths):
    """Return points (n, 2) of a path beside the centre line, between the edges."""
    step = float(rng.uniform(3.0, 10.0))
    s = np.arange(0.0, centre.s[-1], step)
    if len(s) < 3:
        s = np.linspace(0.0, centre.s[-1], 3)
    side = 0.8 * np.interp(
        rng.uniform(-1.0, 1.0), [-1, 0, 1], [-widths['right'], 0, widths['left']]
    )
    wave = float(rng.uniform(30.0, 200.0))
    offset = side * (1.0 - np.cos(2.0 * np.pi * s / wave)) / 2.0
    X, Y, psi = (np.interp(s, centre.s, column) for column in centre[1:])
    return np.column_stack([X - offset * np.sin(psi), Y + offset * np.cos(psi)])


def _speed(rng, path):
    if rng.random() < 0.5:
        return {'constant_mps': _drawn_speed(rng)}
    count = int(rng.integers(1, 6))
    stations = np.unique(np.round(rng.uniform(0.0, path.s[-1], count), 3))
    return {
        'stations_m': stations.tolist(),
        'speeds_mps': [_drawn_speed(rng) for _ in stations],
    }


def _drawn_speed(rng):
    """Return a speed [m/s] of the whole range, most of them above the controllers' least one."""
    return float(rng.uniform(7.0, 60.0)) if rng.random() < 0.7 else _log(rng, *SPEEDS)


def _start(rng, path, begin, widths):
    """Return the block `start`, and about where it is."""
    X, Y, psi = (float(np.interp(begin, path.s, column)) for column in path[1:])
    speed = _drawn_speed(rng)
    if rng.random() < 0.5:
        return {'progress_m': begin, 'speed_mps': speed}, Start(X, Y, psi, speed)
    beside = float(rng.uniform(-widths['right'], widths['left']))
    across = np.pi / 2 - 0.1 if rng.random() < 0.5 else 0.3
    X, Y = X - beside * math.sin(psi), Y + beside * math.cos(psi)
    yaw = math.remainder(psi + float(rng.uniform(-across, across)), math.tau)
    block = {'x_m': X, 'y_m': Y, 'yaw_rad': yaw, 'speed_mps': speed}
    return block, Start(X, Y, yaw, speed)


def _anywhere(rng, start, path, widths):
    """Return a start beside the road or on it, in any direction: not of the schema, of --set."""
    k = int(np.argmin(np.hypot(path.X - start.X, path.Y - start.Y)))
    reach = float(rng.uniform(1.0, 3.0))
    beside = float(rng.uniform(-widths['right'] - 5.0, widths['left'] + 5.0)) * reach
    return Start(
        float(path.X[k] - beside * math.sin(path.psi[k])),
        float(path.Y[k] + beside * math.cos(path.psi[k])),
        float(rng.uniform(-np.pi, np.pi)),
        start.speed,
    )


def _obstacles(rng, centre, widths, start, reach, time_s):
    count = int(
        rng.choice([0, rng.integers(1, 6), rng.integers(6, 40), 200], p=[0.2, 0.5, 0.25, 0.05])
    )
    made = []
    for _ in range(50 * count):
        if len(made) == count:
            break
        one = _obstacle(rng, centre, widths, start, reach, time_s)
        if one is not None:
            made.append(one)
    return made


def _obstacle(rng, centre, widths, start, reach, time_s):
    near = rng.random() < 0.85
    low, high = reach if near else (0.0, centre.s[-1])
    station = float(np.clip(rng.uniform(low - 10.0, high), 0.0, centre.s[-1] - 0.01))
    offset = float(rng.uniform(-widths['right'], widths['left']))
    radius = float(rng.uniform(0.1, 2.0)) if rng.random() < 0.9 else _log(rng, *RADII)
    X, Y, psi = (float(np.interp(station, centre.s, column)) for column in centre[1:])
    X, Y = X - offset * math.sin(psi), Y + offset * math.cos(psi)
    times = {}
    if rng.random() < 0.4:
        times['appears_at_s'] = float(rng.uniform(0.05, 0.9 * time_s))
    elif math.hypot(X - start.X, Y - start.Y) < radius + CAR_RADIUS + 0.5:
        return None
    if rng.random() < 0.3:
        begin = times.get('appears_at_s', 0.0)
        times['disappears_at_s'] = min(600.0, begin + float(rng.uniform(0.01, 3.0)))
    fast = float(rng.choice([0.0, 3.0, 15.0, 50.0]))
    along, across = (float(rng.uniform(-fast, fast)) for _ in range(2))
    if rng.random() < 0.5:
        place = {'station_m': station, 'offset_m': offset}
        motion = {'along_mps': along, 'across_mps': across}
    else:
        place, motion = {'x_m': X, 'y_m': Y}, {'vx_mps': along, 'vy_mps': across}
    return place | {'radius_m': radius} | (motion if fast else {}) | times


def _patches(rng, centre, widths, reach):
    made = []
    for _ in range(int(rng.integers(1, 4))):
        begin = float(rng.uniform(reach[0] - 5.0, reach[1]))
        begin = float(np.clip(begin, 0.0, max(0.0, centre.s[-1] - 1.0)))
        end = min(begin + float(rng.uniform(0.5, 20.0)), centre.s[-1] - 0.01)
        right = float(rng.uniform(-widths['right'], widths['left'] - 0.2))
        made.append(
            {
                'from_m': begin,
                'to_m': end,
                'from_offset_m': right,
                'to_offset_m': float(rng.uniform(right + 0.15, widths['left'])),
                'friction': _log(rng, *FRICTIONS),
            }
        )
    return made
