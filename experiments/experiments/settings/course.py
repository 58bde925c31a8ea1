"""The double lane change of a setting: its scenario, and the least curvature that it demands.

Coarse path: a straight, a change to the left, a plateau, the change back, a straight. An obstacle
stands beside the end of each change, on the inside of the bend that ends it, so that the first is
passed on its left and the second on its right. Road edges are straight. Frame: the car starts at
the origin along x; metres.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import yaml

from experiments.settings import demand
from experiments.settings.demand import Circle, Task
from experiments.settings.plan import Plan
from scenario_publisher import lines
from scenario_publisher.families import scenario_document

TASK_STEP_M = 0.5
PATH_STEP_M = 0.25
NAME = 'setting'


class Disc(NamedTuple):
    """An obstacle."""

    x: float  # m, centre
    y: float  # m
    radius: float  # m


class Layout(NamedTuple):
    """A double lane change without a speed."""

    segments: tuple[dict[str, Any], ...]  # of the coarse path, up to the end of the second change
    obstacles: tuple[Disc, Disc]
    left: float  # m, y of the left edge
    right: float  # m, y of the right edge
    end: float  # m, x of the end of the second change
    second_at: float  # m, station of obstacle 2 on the coarse path

    def __repr__(self) -> str:
        return f'Layout({self.obstacles}, edges {self.right:g} to {self.left:g} m)'


def entry_of(course: Plan, speed: float) -> float:
    """Return the length [m] of the straight before the first change at a speed [m/s]."""
    return max(course.least_entry_m, course.entry_s * speed + course.entry_extra_m)


def lay_out(values: Mapping[str, Any], circle_radius: float, entry: float) -> Layout:
    """Return the double lane change of drawn values for a vehicle circle of a radius [m].

    `entry` is the length [m] of the straight before the first change.

    A car whose centre of gravity follows the coarse path passes the obstacles with
    `clearance_*_m` between the circles, and the edges with `room_*_m`. Raises ValueError for a
    change that is too short for its offset.
    """
    first, second = values['change_1_m'], values['change_2_m']
    offset = values['offset_m']
    begin_2 = entry + first + values['plateau_m']
    end = begin_2 + second
    segments = (
        scenario_document.straight(entry),
        scenario_document.lane_change(first, offset),
        scenario_document.straight(values['plateau_m']),
        scenario_document.lane_change(second, -offset),
    )
    left = offset + circle_radius + values['room_left_m']
    right = -circle_radius - values['room_right_m']
    curves = (
        lines.arc(entry, 0.0),
        lines.lane_change(first, offset),
        lines.arc(values['plateau_m'], 0.0),
        lines.lane_change(second, -offset),
    )
    path = lines.line_from_curves(curves, 0.0, 0.0, 0.0, PATH_STEP_M)
    places = (
        (entry + values['obstacle_1_share'] * first, -1.0, '1'),
        (begin_2 + values['obstacle_2_share'] * second, 1.0, '2'),
    )
    obstacles = tuple(
        _beside(
            path,
            x,
            side,
            values[f'radius_{number}_m'],
            circle_radius + values[f'clearance_{number}_m'],
        )
        for x, side, number in places
    )
    second_at = float(np.interp(places[1][0], path.X, path.s))
    return Layout(segments, obstacles, left, right, end, second_at)


def _beside(path, x, side, radius, gap):
    """Return the disc whose rim is `gap` to a side (left 1, right -1) of the path at x."""
    y, psi = (float(np.interp(x, path.X, values)) for values in (path.Y, path.psi))
    away = side * (gap + radius)
    return Disc(x - away * np.sin(psi), y + away * np.cos(psi), radius)


def document(layout: Layout, speed: float, course: Plan) -> dict[str, Any]:
    """Return the scenario of a layout at a constant speed [m/s] as the contents of a file."""
    finish = layout.end + max(course.after_s * speed, course.least_after_m)
    behind = finish - layout.end + course.horizon_s * speed
    road = layout.end + behind + 2 * scenario_document.BEFORE
    return scenario_document.rounded(
        {
            'schema': scenario_document.SCHEMA,
            'name': NAME,
            'description': 'Double lane change of the study over many settings.',
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
            'stop': {'progress_m': finish, 'time_s': course.time_factor * finish / speed},
            'obstacles': [
                {'x_m': float(disc.x), 'y_m': float(disc.y), 'radius_m': disc.radius}
                for disc in layout.obstacles
            ],
        }
    )


def scenario_text(layout: Layout, speed: float, course: Plan) -> str:
    """Return the scenario of a layout at a constant speed [m/s] as the text of a file."""
    return yaml.safe_dump(document(layout, speed, course), sort_keys=False)


def required_curvature(values: Mapping[str, Any], circle_radius: float, course: Plan) -> float:
    """Return the least peak curvature [1/m] that keeps the safety distances of the drawn values.

    The lateral acceleration of a point mass grows with the square of its speed, so this number
    alone gives the acceleration that the task demands at any speed. It may steer from a fixed
    distance before the first change on, not from the start of the car, which depends on the speed.
    Infinite when nothing keeps the distances. Raises ValueError as `lay_out`.
    """
    layout = lay_out(values, circle_radius, course.preview_m)
    x = np.arange(0.0, layout.end + course.least_after_m + TASK_STEP_M / 2, TASK_STEP_M)
    room = circle_radius + values['safety_edge_m']
    circles = tuple(
        Circle(disc.x, disc.y, disc.radius + circle_radius + values['safety_obstacle_m'], on_left)
        for disc, on_left in zip(layout.obstacles, (True, False))
    )
    low, high = np.full(len(x), layout.right + room), np.full(len(x), layout.left - room)
    return demand.least_peak(Task(x, low, high, circles), 1.0)
