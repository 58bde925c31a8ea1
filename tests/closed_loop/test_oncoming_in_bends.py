"""Cars that come in their own lane of a bend: no contact, and the own lane is kept."""

import math

import numpy as np
import pytest
import yaml

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation
from experiments.families import scenario_document
from experiments.families.scenario_document import CAR_DISCS, CAR_RADIUS, LANE
from mpcc_controller.path import reference_path
from scenario_publisher import scenario

ACROSS = 3.0  # m/s^2, lateral acceleration of both cars
RADII = (40, 60, 80, 120, 200, 300)  # m
HALF_WIDTH = 0.925  # m, of the car


def oncoming_in_bend(radius, side):
    """Return the scenario of a bend to the left (side 1) or right (-1) with a car that comes.

    The path is the middle of the right lane of two; they meet in the middle of the arc.
    """
    speed = math.sqrt(ACROSS * radius)
    lead_in, clothoid, arc = 2.5 * speed, 1.5 * speed, max(30.0, 3.0 * speed)
    meet = lead_in + clothoid + arc / 2
    bends = ((0.0, 1.0), (1.0, 1.0), (1.0, 0.0))
    pieces = [scenario_document.straight(lead_in)]
    for (begin, end), length in zip(bends, (clothoid, arc, clothoid)):
        ends = {'start_curvature_1pm': side * begin / radius}
        ends['end_curvature_1pm'] = side * end / radius
        pieces.append({'clothoid': {'length_m': length, **ends}})
    length = meet + max(25.0, 3.0 * speed)
    pieces.append(scenario_document.straight(max(length - meet - arc / 2 - clothoid, 1.0)))
    length = sum(next(iter(piece.values()))['length_m'] for piece in pieces)
    # both drive towards each other: it begins as far beyond the meeting point as the car before it
    discs = [
        {
            'station_m': min(2.0 * meet, length + speed) + ahead,
            'offset_m': LANE,
            'radius_m': CAR_RADIUS,
            'along_mps': -speed,
            'motion': 'along_road',
        }
        for ahead in CAR_DISCS
    ]
    parts = scenario_document.document(
        description='A car comes in its own lane of a bend.',
        length=length,
        speed=speed,
        segments=pieces,
        obstacles=discs,
        left=1.5 * LANE,
        right=-0.5 * LANE,
    )
    return scenario.parse(yaml.safe_dump(parts), 'oncoming_in_bend')


@pytest.mark.parametrize('side', [1, -1], ids=['left', 'right'])
@pytest.mark.parametrize('radius', RADII)
def test_a_car_that_comes_in_its_lane_of_a_bend_is_met_in_the_own_lane(radius, side):
    scn = oncoming_in_bend(radius, side)
    setup = simulation.prepare_scenario(scn, 'mpcc_road')
    drive = drive_from_columns(simulation.run(setup, explain=False), simulation.run_info(setup), '')
    found = metrics.compute_metrics(drive)
    assert found['survived'], found['lost_by']
    assert found['min_outline_gap_m'] > 0.5
    path, motion = reference_path.build(scn.reference), drive.motion
    aside = [np.hypot(*(np.array([x, y]) - foot(path, x, y))) for x, y in zip(motion.x, motion.y)]
    assert np.max(aside) < LANE / 2 - HALF_WIDTH


def foot(path, x, y):
    """Return the point of the path closest to a position."""
    arcs, _ = reference_path.arcs_at(path, reference_path.project(path, x, y, None, 0.0))
    return np.array([arcs.X, arcs.Y])
