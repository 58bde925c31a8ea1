"""The paper's first experiment: the distances that both controllers see on the ideal circle.

The scenario's own path and obstacle go through the controllers' code as they do while driving; the
closed forms are those of the judge, which shares no code with them.
"""

import dataclasses

import numpy as np
import pytest

from bags.figures import frame_distances
from experiments import simulation
from mpcc_controller.model.single_track import State
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.path.distance import CENTRE_ROUNDING
from mpcc_controller.problem import formulation, stage_parameters
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml import conversions as ring_values
from node_runtime import named_vector
from scenario_publisher import scenario
from stage_solver.stage_problem import Plan

RADIUS, STATION, N = 20.0, 62.83, 50  # m of circle_20m.yaml; stages


def on_path(s):
    """Return states on the ideal circle at the stations `s` (k,)."""
    still = 0.0 * s
    X, Y = RADIUS * np.sin(s / RADIUS), RADIUS * (1 - np.cos(s / RADIUS))
    return np.column_stack(
        State(X, Y, s / RADIUS, still + 9.0, still, still + 9.0 / RADIUS, s, still, still)
    )


def distances(controller, states, inside, rules=None):
    """Return D_V2O [m] of the only obstacle at states on the path, as the controller sees it."""
    setup = simulation.prepare('circle_20m', controller)
    scn, params = setup.scn, setup.params
    if rules:
        rules = dataclasses.replace(params.formulation, **rules)
        params = dataclasses.replace(params, formulation=rules)
    reach, bearing = RADIUS - inside, STATION / RADIUS
    one = scenario.obstacles_at(scn, 0.0, 0).items[0]
    spot = reach * np.sin(bearing), RADIUS - reach * np.cos(bearing)
    spot = PredictedObstacle(one.id, *spot, one.r_obs, 0.0, 0.0)
    obstacles = scenario.obstacles_at(scn, 0.0, 0)._replace(items=(spot,))
    path = reference_path.build(ring_values.reference_as_received(scn.reference))
    scene = Scene(path, road_edges.build(scn.edges), obstacles)
    form = formulation.make(params, stage_parameters.car(params, setup.vehicle))
    plan = form.to_local(Plan(states, np.zeros((len(states) - 1, 4))), path)
    numbers = form.stage_parameters(scene, states)
    found = []
    for row, p in zip(plan.X, numbers.P):
        stage = named_vector.build(numbers.stages, p)
        v2o = form.ocp.quantities(form.ocp.state(*row), None, stage).v2o
        reach = one.r_obs + params.body.circle_radius_m
        # the distance to the centre is rounded by a known amount, so that its tip has a slope
        found.append(np.sqrt((float(v2o[0][0]) + reach) ** 2 - CENTRE_ROUNDING) - reach)
    return np.array(found)


@pytest.mark.parametrize('inside', [1.0, -1.0])
@pytest.mark.parametrize(
    ('controller', 'rules', 'frame'),
    [
        pytest.param('mpcc', {}, 'cartesian', id='the MPCC sees the chord of the circle'),
        pytest.param('frenet', {}, 'frenet', id='the baseline sees the path as straight'),
        pytest.param('mpcc', {'distance': 'path'}, 'frenet', id='an MPCC that measures along it'),
    ],
)
def test_each_controller_sees_the_distance_in_its_own_frame(controller, rules, frame, inside):
    gaps = np.linspace(-55.0, 20.0, N + 1)
    seen = distances(controller, on_path(STATION + gaps), inside, rules)
    closed = frame_distances.circle_distances(RADIUS, gaps, inside, 2.1)
    assert seen == pytest.approx(getattr(closed, frame), abs=1e-9)
