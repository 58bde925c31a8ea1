"""Scenarios drawn at random: those of the package and of the families, driven otherwise.

A draw is decided by two integers, `seed` and `index`, and by nothing else. Speeds, friction, start
and obstacles are drawn over the range of the schema (docs/scenarios.md). What its geometric checks
refuse is drawn again, so every scenario here is a valid one.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import yaml

from experiments.families import draw as families
from scenario_publisher import scenario
from scenario_publisher.scenario import ScenarioError, Start

# libyaml is a hundred times faster than Python, but is not everywhere
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
SEED = 672772597  # of the series that the tests take
CONTROLLERS = ('mpcc', 'mpcc_road', 'mpcc_no_ca', 'frenet')
ATTEMPTS = 200
SPEEDS, FRICTIONS, RADII = (1.0, 100.0), (0.05, 1.5), (0.01, 50.0)
SHORTEST_S, LONGEST_S = 0.4, 1.0  # of a drive, so that many fit into a test
BEYOND = 0.4  # share of drives that start where the schema refuses: off the road, any heading


class Draw(NamedTuple):
    """One drive that was drawn."""

    controller: str  # a name of CONTROLLERS
    text: str  # the scenario file
    start: Start | None  # in place of the scenario's: anywhere, in any direction
    time_s: float  # longest drive


def draw(seed: int, index: int) -> Draw:
    """Return drive number `index` of a series. Raises RuntimeError when no valid one is found."""
    rng = np.random.default_rng([seed, index])
    for _ in range(ATTEMPTS):
        time_s = float(rng.uniform(SHORTEST_S, LONGEST_S))
        text = written(_driven_otherwise(rng, _road(rng), time_s) | {'name': f'draw_{index}'})
        try:
            scn = scenario.parse(text, f'draw_{index}')
        except ScenarioError:
            continue
        start = _anywhere(rng, scn) if rng.random() < BEYOND else None
        return Draw(CONTROLLERS[index % len(CONTROLLERS)], text, start, time_s)
    raise RuntimeError(f'seed {seed}, index {index}: {ATTEMPTS} scenarios are refused')


@cache
def document_of(name: str) -> dict[str, Any]:
    """Return the document of a scenario of the package."""
    return yaml.load(scenario.load(name).text, Loader=LOADER)


def written(document: dict[str, Any]) -> str:
    """Return a document as YAML without aliases, which a scenario file may not have."""
    dumper = type('Plain', (DUMPER,), {'ignore_aliases': lambda *_: True})
    return yaml.dump(document, Dumper=dumper, sort_keys=False)


def _road(rng):
    """Return the document of a scenario of the package, or of a draw of a family."""
    if rng.random() < 0.5:
        name = str(rng.choice(scenario.available()))
        document = document_of(name)
    else:
        family = str(rng.choice([*families.FAMILIES]))
        index = int(rng.integers(1000))
        drawn = families.draw(family, 1, index, families.NOMINAL)
        document = yaml.load(drawn.text, Loader=LOADER)
    return {key: value for key, value in document.items() if key != 'expect'}


def _driven_otherwise(rng, document, time_s):
    finish = document['stop']['progress_m']
    begin = float(rng.uniform(0.0, 0.7)) * finish
    speed = _speed(rng)
    reach = begin, min(begin + time_s * max(speed, 5.0) + 30.0, finish)
    desired = {'constant_mps': _speed(rng)}
    if rng.random() < 0.5:
        stations = np.unique(np.round(rng.uniform(0.0, finish, 3), 3)).tolist()
        desired = {'stations_m': stations, 'speeds_mps': [_speed(rng) for _ in stations]}
    count = int(rng.choice([0, rng.integers(1, 6), 40, 200], p=[0.3, 0.5, 0.15, 0.05]))
    obstacles = [_obstacle(rng, reach, time_s) for _ in range(count)]
    if rng.random() < 0.5:
        obstacles += document['obstacles']
    return document | {
        'speed': desired,
        'friction': _log(rng, *FRICTIONS),
        'start': {'progress_m': begin, 'speed_mps': speed},
        'stop': {'progress_m': max(finish, begin + 1.0), 'time_s': _log(rng, 0.5, 600.0)},
        'obstacles': obstacles,
    }


def _log(rng, low, high):
    """Return a number between bounds, every order of magnitude as likely as another."""
    return float(np.clip(math.exp(rng.uniform(math.log(low), math.log(high))), low, high))


def _speed(rng):
    """Return a speed [m/s] of the whole range, most of them above the controllers' least one."""
    return float(rng.uniform(7.0, 60.0)) if rng.random() < 0.7 else _log(rng, *SPEEDS)


def _obstacle(rng, reach, time_s):
    begin = float(rng.uniform(0.05, 0.9 * time_s))
    fast = float(rng.choice([0.0, 3.0, 15.0, 50.0]))
    along, across = (float(rng.uniform(-fast, fast)) for _ in range(2))
    radius = float(rng.uniform(0.1, 2.0)) if rng.random() < 0.9 else _log(rng, *RADII)
    return {
        'station_m': float(rng.uniform(*reach)),
        'offset_m': float(rng.uniform(-6.0, 6.0)),
        'radius_m': radius,
        **({'along_mps': along, 'across_mps': across} if fast else {}),
        # one that is there from the start may cover the car, and the schema refuses that
        **({'appears_at_s': begin} if rng.random() < 0.7 else {}),
        **(
            {'disappears_at_s': begin + float(rng.uniform(0.01, 3.0))} if rng.random() < 0.3 else {}
        ),
    }


def _anywhere(rng, scn):
    """Return a start beside the road or on it, in any direction: not of the schema, of --set."""
    k = int(np.argmin(np.hypot(scn.reference.X - scn.start.X, scn.reference.Y - scn.start.Y)))
    far = float(rng.choice([8.0, 30.0]))  # near an edge, or well beyond it
    beside, psi = float(rng.uniform(-far, far)), float(scn.reference.psi[k])
    return Start(
        float(scn.reference.X[k] - beside * math.sin(psi)),
        float(scn.reference.Y[k] + beside * math.cos(psi)),
        float(rng.uniform(-np.pi, np.pi)),
        scn.start.speed,
    )
