"""From the columns of a bag and the facts noted with it to a Drive that can be judged."""

import json
from collections.abc import Mapping

import numpy as np

from bags.errors import BagError
from bags.storage import read
from bags.storage.columns import Columns
from bags.storage.sift import sift
from bags.verdict import answers, drive, reported
from bags.verdict.geometry import Outline
from msgs_yaml.stamp import NS_PER_S

NEEDED = (
    '/scenario/reference',
    '/scenario/road_edges',
    '/scenario/obstacles',
    '/vehicle/odometry',
    '/vehicle/actuators',
    '/vehicle/imu',
)
LOCKSTEP = 'lockstep'
# a controller that never answered leaves neither behind
ANSWERS = ('/controller/command', '/controller/why')
DRIVEN = ('solved', 'stopped_early')  # rungs of the ladder that follow a fresh plan


def of_bag(bag: read.Bag) -> drive.Drive:
    """Return the drive in a bag, of its valid messages; BagError names what it lacks."""
    bag = sift(bag)
    answered = [topic for topic in ANSWERS if topic in bag.recordings]
    answered = [topic for topic in answered if bag.recordings[topic].payloads]
    return of(read.columns(bag, (*NEEDED, *answered)), read.run_info(bag), str(bag.path))


def of(columns: Mapping[str, Columns], run_info: Mapping[str, str], name: str) -> drive.Drive:
    """Return the drive in the columns of a run; `name` is what errors call it."""
    odometry, imu = columns['/vehicle/odometry'], columns['/vehicle/imu']
    actuators = columns['/vehicle/actuators']
    if run_info.get('mode') == LOCKSTEP:
        _check_one_ring(columns, name)
    return drive.Drive(
        drive.Motion(
            odometry.stamp_ns,
            odometry.x_m,
            odometry.y_m,
            odometry.yaw_rad,
            odometry.vx_mps,
            odometry.vy_mps,
        ),
        drive.Accelerations(imu.stamp_ns, imu.ax_mps2, imu.ay_mps2),
        drive.Inputs(
            actuators.stamp_ns, actuators.steer_rad, actuators.front_x_n + actuators.rear_x_n
        ),
        _ticks(columns),
        _scene(columns),
        facts(run_info, name),
    )


def _check_one_ring(columns, name):
    """Refuse two answers to one state: in lockstep nobody gives them but a second controller."""
    for topic in {'/vehicle/odometry', ANSWERS[0]} & columns.keys():
        stamps, counts = np.unique(columns[topic].stamp_ns, return_counts=True)
        if np.any(counts > 1):
            stamp_s = stamps[np.argmax(counts)] / NS_PER_S
            raise BagError(
                f'{name}: {topic} has unlike messages of one stamp ({stamp_s:.3f} s): '
                'two rings shared a ROS domain, and neither of them can be judged'
            )


def _ticks(columns):
    command, why = (columns.get(topic) for topic in ANSWERS)
    reports = [value.values for value in why.values] if why else []
    answered = np.empty(0, dtype=np.int64)
    if command:
        answered = command.stamp_ns[answers.are(command.stamp_ns, why.values if why else ())]
    return drive.Ticks(
        answered,
        *(reported.numbers(reports, f'time.{name}') for name in ('solve_ms', 'solve_cpu_ms')),
        np.array([report.get('rung') not in DRIVEN for report in reports], dtype=bool),
        _last_reason(reports),
    )


def _last_reason(reports):
    last = reports[-1] if reports else {}
    return '' if last.get('rung') in DRIVEN else str(last.get('reason', ''))


def _scene(columns):
    reference = columns['/scenario/reference'].values[-1]
    edges = columns['/scenario/road_edges'].values[-1]
    messages = columns['/scenario/obstacles']
    names = sorted({one.id for message in messages.values for one in message.items})
    return drive.Scene(
        _line('/scenario/reference', np.column_stack([reference.X, reference.Y])),
        _line('/scenario/road_edges', edges.left),
        _line('/scenario/road_edges', edges.right),
        messages.stamp_ns,
        tuple(_obstacle(name, messages.values) for name in names),
    )


def _line(topic, points):
    """Return a polyline without points that repeat the one before."""
    moves = np.any(np.diff(points, axis=0, prepend=np.nan) != 0.0, axis=1)
    if np.count_nonzero(moves) < 2:
        raise BagError(f'{topic}: all points of the line are the same')
    return points[moves]


def _obstacle(name, messages):
    rows = np.full((len(messages), 4), np.nan)
    radius = 0.0
    for row, message in zip(rows, messages):
        for one in message.items:
            if one.id == name:
                row[:] = one.X, one.Y, one.vX, one.vY
                radius = one.r_obs
    return drive.Obstacle(name, *rows.T, radius)


def facts(run_info: Mapping[str, str], name: str) -> drive.Facts:
    """Return the parameters the judge needs; BagError names the first that is missing."""
    try:
        parameters = json.loads(run_info['parameters'])
        controller, plant = parameters['controller'], parameters['plant']
        tyres = (controller['tyre.front_friction'], controller['tyre.rear_friction'])
        return drive.Facts(
            scenario=run_info['scenario'],
            controller=run_info['controller'],
            outline=Outline(
                front=plant['car.body.cog_to_front_m'] + plant['car.outline.front_overhang_m'],
                rear=plant['car.body.cog_to_rear_m'] + plant['car.outline.rear_overhang_m'],
                width=plant['car.outline.width_m'],
            ),
            circles=tuple(controller['body.circle_offsets_m']),
            vehicle_radius=controller['body.circle_radius_m'],
            safe_obstacle=controller['safety.obstacle_m'],
            safe_edge=controller['safety.edge_m'],
            friction=plant['friction'] * sum(tyres) / len(tyres),
            tick_ns=round(controller['model.step_s'] * NS_PER_S),
            stop=(plant['stop.x_m'], plant['stop.y_m']),
            armed_after=plant['stop.armed_after_m'],
            least_speed=controller.get('limits.least_speed_mps'),
        )
    except KeyError as missing:
        raise BagError(
            f'{name}: the run does not say {missing}; was it recorded by hand?'
        ) from None
