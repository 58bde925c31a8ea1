"""Tasks of the study of tuned controllers: the paper's double lane change, drawn at random.

Everything about the task that the paper does not print is drawn: course, plant, safety distances,
latency, and how wrong the controller's friction is; weights are not, they are what is tuned. The
speed follows from the demand S, the least peak lateral acceleration that keeps the safety distances
over what the plant holds in a steady turn.

Coarse path: a straight, a change to the left, a plateau, the change back, a straight. An obstacle
stands beside the end of each change, on the inside of the bend that ends it, so that the first is
passed on its left and the second on its right. Road edges are straight. Frame: the car starts at
the origin along x; metres.

The demand is that of any car, by a linear program: a point mass drives along a straight road. Its
lateral position y(x) has one curvature y'' per STEP_M of road (small heading angles); at a constant
speed v the lateral acceleration is v^2 y''. The constraints are the safety distances to obstacles
and edges, on the sides on which the coarse path passes the obstacles; the program minimises the
largest |y''|. So it is a property of the task: no controller and no tyre model is involved.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from experiments.families import plant_variant, scenario_document
from experiments.families.plant_variant import Variant
from scenario_publisher import lines

NAME = 'lane_change_task'
CIRCLE_M = 1.1  # the paper's circle around the centre of gravity
DEMAND = (0.2, 0.9)  # S
STRATA = 7  # equal parts of it
SPEEDS = (14.0, 45.0)  # m/s: a drive ends as too slow at 7
UNIFORM = {
    'change_1_m': (14.0, 35.0),  # straight ahead
    'change_2_m': (14.0, 35.0),
    'offset_m': (2.5, 4.0),  # of both changes, centre to centre
    'plateau_m': (10.0, 35.0),  # between them
    'obstacle_1_share': (0.7, 1.0),  # of the change, where the obstacle stands
    'obstacle_2_share': (0.7, 1.0),
    'clearance_1_m': (-0.3, 0.1),  # between the circles, of a car on the coarse path
    'clearance_2_m': (-0.3, 0.5),
    'radius_1_m': (0.5, 1.5),  # of the obstacle
    'radius_2_m': (0.5, 1.5),
    'safety_obstacle_m': (0.3, 1.5),  # D_sft,O
    'safety_edge_m': (0.3, 1.5),  # D_sft,E
    'spare_left_m': (0.0, 1.0),  # beyond D_sft,E, of a car on the coarse path
    'spare_right_m': (0.0, 1.0),
    'friction_error': (-0.1, 0.1),  # of the friction that the controller believes
}
CARS = ('bmw_545i.yaml', 'bmw_330i.yaml', 'vw_gti.yaml')
REAR_CORNERING = (0.722, 0.833, 0.944, 1.056)  # over the car's own
ROLL_SHARES = (0.5, 0.55, 0.6, 0.65)  # of the front axle in the roll stiffness
# from a command to the servos, and how much of it the controller adds to the lags of its car
LATENCIES = ((0, 0), (25, 0), (50, 0), (50, 50))
MOST_COURSES = 1000  # drawn until one demands S at an allowed speed

ENTRY_S, ENTRY_M, LEAST_ENTRY_M = 2.5, 10.0, 45.0  # straight before the first change
PREVIEW_M = 45.0  # of it, in which the point mass of the linear program may steer
AFTER_S, LEAST_AFTER_M = 1.5, 40.0  # to the finish
TIME_FACTOR = 3.0  # of the time limit over the time at the desired speed
STEP_M = 0.5
# keys of a document beside those of a scenario: parameters of the nodes, and what was drawn
SETTINGS, VALUES = 'settings', 'values'


class Area(NamedTuple):
    """An area that the centre of gravity must not enter, and the side on which it passes."""

    x: float  # m, centre
    y: float  # m
    radius: float  # m, obstacle + vehicle circle + safety distance
    on_left: bool  # whether the car passes to the left of the obstacle, y above it


class Layout(NamedTuple):
    """A double lane change without a speed."""

    segments: tuple[dict[str, Any], ...]  # of the coarse path, up to the end of the second change
    obstacles: tuple[tuple[float, float, float], ...]  # m, x, y and radius
    left: float  # m, y of the left edge
    right: float  # m, y of the right edge
    end: float  # m, x of the end of the second change


def lane_change_task(random: Random) -> dict[str, Any]:
    """Return a task: a scenario document with SETTINGS and VALUES.

    There are no hard ones. Raises RuntimeError where no course demands S at an allowed speed.
    """
    share = random.random()
    S = DEMAND[0] + share * (DEMAND[1] - DEMAND[0])
    latency, known = random.choice(LATENCIES)
    car = (random.choice(CARS), random.choice(REAR_CORNERING), random.choice(ROLL_SHARES))
    plant = plant_variant.build(Variant(*car, known / 1000.0))
    for _ in range(MOST_COURSES):
        values = {name: random.uniform(*ends) for name, ends in UNIFORM.items()}
        curvature = required_curvature(values)
        speed = math.sqrt(S * plant.limit / curvature) if 0.0 < curvature < math.inf else math.inf
        if SPEEDS[0] <= speed <= SPEEDS[1]:
            break
    else:
        raise RuntimeError(f'{NAME}: none of {MOST_COURSES} courses demands S = {S:.3f}')
    parts = document(lay_out(values, entry=max(LEAST_ENTRY_M, ENTRY_S * speed + ENTRY_M)), speed)
    parts['description'] = f'Double lane change that demands S = {S:.3f}, at {speed:.1f} m/s.'
    parts[VALUES] = {
        'S': S,
        'stratum': int(share * STRATA),
        'speed_mps': speed,
        'latency_ms': latency,
        'compensated': known > 0,
        'car': Path(car[0]).stem,
        'rear_cornering': car[1],
        'roll_share': car[2],
        **values,
    }
    parts[SETTINGS] = {
        'plant': {**plant.settings, 'command_delay_ms': latency},
        'controller': {
            'car_file': plant.car_file,
            'model.friction': 1.0 + values['friction_error'],
            'model.servo_lag': known > 0,
            'safety.obstacle_m': values['safety_obstacle_m'],
            'safety.edge_m': values['safety_edge_m'],
        },
    }
    return parts


def lay_out(values: Mapping[str, float], entry: float) -> Layout:
    """Return the double lane change of drawn values behind a straight of a length [m].

    A car whose centre of gravity follows the coarse path passes the obstacles with
    `clearance_*_m` between the circles. Raises ValueError for a change that is too short for its
    offset.
    """
    first, second, offset = values['change_1_m'], values['change_2_m'], values['offset_m']
    plateau = values['plateau_m']
    begin_2 = entry + first + plateau
    curves = (
        lines.arc(entry, 0.0),
        lines.lane_change(first, offset),
        lines.arc(plateau, 0.0),
        lines.lane_change(second, -offset),
    )
    path = lines.line_from_curves(curves, 0.0, 0.0, 0.0, STEP_M / 2)
    places = (
        (entry + values['obstacle_1_share'] * first, -1.0, '1'),
        (begin_2 + values['obstacle_2_share'] * second, 1.0, '2'),
    )
    obstacles = []
    for x, side, number in places:
        radius = values[f'radius_{number}_m']
        y, psi = (float(np.interp(x, path.X, column)) for column in (path.Y, path.psi))
        away = side * (CIRCLE_M + values[f'clearance_{number}_m'] + radius)
        obstacles.append((x - away * math.sin(psi), y + away * math.cos(psi), radius))
    room = CIRCLE_M + values['safety_edge_m']
    return Layout(
        segments=(
            scenario_document.straight(entry),
            scenario_document.lane_change(first, offset),
            scenario_document.straight(plateau),
            scenario_document.lane_change(second, -offset),
        ),
        obstacles=tuple(obstacles),
        left=offset + room + values['spare_left_m'],
        right=-room - values['spare_right_m'],
        end=begin_2 + second,
    )


def document(layout: Layout, speed: float) -> dict[str, Any]:
    """Return the scenario of a layout at a constant speed [m/s]."""
    finish = layout.end + max(AFTER_S * speed, LEAST_AFTER_M)
    behind = finish - layout.end + scenario_document.PREVIEW_S * speed
    road = layout.end + behind + 2 * scenario_document.BEFORE
    return scenario_document.rounded(
        {
            'schema': scenario_document.SCHEMA,
            'name': NAME,
            'road': {
                'centre_line': {
                    'start': scenario_document.pose(-scenario_document.BEFORE),
                    'segments': [scenario_document.straight(road)],
                },
                'edges': {'left': {'offset_m': layout.left}, 'right': {'offset_m': layout.right}},
            },
            'path': {
                'start': scenario_document.pose(0.0),
                'segments': [*layout.segments, scenario_document.straight(behind)],
            },
            'speed': {'constant_mps': speed},
            'friction': 1.0,
            'start': {'progress_m': 0.0},
            # the path is longer than its x: the finish is a station of the path
            'stop': {'progress_m': finish, 'time_s': TIME_FACTOR * finish / speed},
            'obstacles': [
                {'x_m': x, 'y_m': y, 'radius_m': radius} for x, y, radius in layout.obstacles
            ],
        }
    )


def required_curvature(values: Mapping[str, float]) -> float:
    """Return the least peak curvature [1/m] that keeps the safety distances of drawn values.

    The lateral acceleration of a point mass grows with the square of its speed, so this number
    alone gives the acceleration that the task demands at any speed. It may steer from a fixed
    distance before the first change on, not from the start of the car, which depends on the speed.
    Infinite when nothing keeps the distances, or a change is too short for its offset.
    """
    try:
        layout = lay_out(values, PREVIEW_M)
    except ValueError:
        return math.inf
    x = np.arange(0.0, layout.end + LEAST_AFTER_M + STEP_M / 2, STEP_M)
    room = CIRCLE_M + values['safety_edge_m']
    areas = tuple(
        Area(x_m, y_m, radius + CIRCLE_M + values['safety_obstacle_m'], on_left)
        for (x_m, y_m, radius), on_left in zip(layout.obstacles, (True, False))
    )
    low, high = np.full(len(x), layout.right + room), np.full(len(x), layout.left - room)
    return least_curvature(x, low, high, areas)


def least_curvature(
    x: np.ndarray, low: np.ndarray, high: np.ndarray, areas: Sequence[Area]
) -> float:
    """Return the least peak curvature [1/m] that keeps a point mass within a corridor.

    x      (n,) m, ascending, driving direction of a straight road
    low    (n,) m, least y that the right edge allows to the centre of gravity
    high   (n,) m, largest y that the left edge allows
    areas  that it must not enter

    The car enters at y = 0 without heading angle. Returns inf when no curvature, however large,
    keeps it within the corridor.
    """
    low, high = low.copy(), high.copy()
    for area in areas:
        beside = np.abs(x - area.x) < area.radius
        half = np.sqrt(area.radius**2 - (x[beside] - area.x) ** 2)
        if area.on_left:
            low[beside] = np.maximum(low[beside], area.y + half)
        else:
            high[beside] = np.minimum(high[beside], area.y - half)
    if low[0] > 0.0 or high[0] < 0.0 or np.any(low > high):
        return float('inf')
    # unknowns: y and y' at every x, y'' in every interval, the peak; sparse, so that thousands of
    # tasks can be solved
    count = len(x) - 1
    step = np.diff(x)
    here, there = sparse.eye(count, count + 1), sparse.eye(count, count + 1, 1)
    moved, turned = (sparse.diags(step**power / power) for power in (2, 1))
    motion = sparse.bmat(
        [
            [there - here, -sparse.diags(step) @ here, -moved, None],
            [None, there - here, -turned, sparse.csr_matrix((count, 1))],
        ]
    )
    states = sparse.csr_matrix((count, 2 * len(x)))
    peak_column = sparse.csr_matrix(np.ones((count, 1)))
    identity = sparse.identity(count)
    within = sparse.bmat([[states, identity, -peak_column], [states, -identity, -peak_column]])
    bounds = [(0.0, 0.0), *zip(low[1:], high[1:]), (0.0, 0.0), *[(None, None)] * (2 * count)]
    solution = linprog(
        c=np.append(np.zeros(2 * len(x) + count), 1.0),
        A_ub=within,
        b_ub=np.zeros(2 * count),
        A_eq=motion,
        b_eq=np.zeros(2 * count),
        bounds=[*bounds, (0.0, None)],
    )
    return float(solution.fun) if solution.success else float('inf')
