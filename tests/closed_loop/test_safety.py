"""What becomes of the car when the solver fails, or no command follows: controller and plant."""

import numpy as np
import pytest
from driven_setups import Loop, prepare

from experiments import simulation
from experiments.configuration import inputs
from mpcc_controller.driving.controller import Controller
from stage_solver.solution import FAILED
from vehicle_plant.run_end import RunEnd
from vehicle_plant.state import messages
from vehicle_plant.stepping import LockstepStepper

R_VEH, EDGES, HALF_WIDTH_M = 1.1, (-2.5, 6.0), 0.91
SILENT_FROM = range(20, 110, 5)  # ticks of the manoeuvre


class Failing:
    """A solver that fails while `dead`."""

    def __init__(self, inner):
        self.inner, self.dead = inner, False

    def solve(self, *numbers):
        solution = self.inner.solve(*numbers)
        return solution._replace(status=FAILED) if self.dead else solution


def least_gap(loop):
    """Return the least distance of the car to an obstacle [m]."""
    return min(
        np.hypot(x.X - o.X, x.Y - o.Y) - o.r_obs - R_VEH
        for x, obstacles in zip(loop.states, loop.obstacles)
        for o in obstacles.items
    )


@pytest.fixture(scope='module')
def setup():
    return prepare('double_lane_change', 'mpcc')


def is_well(track, obstacles):
    """Return whether a car is beside every obstacle and within the edges all the time."""
    gaps = [np.hypot(x.X - o.X, x.Y - o.Y) - o.r_obs - R_VEH for x in track for o in obstacles]
    inside = [EDGES[0] + HALF_WIDTH_M < x.Y < EDGES[1] - HALF_WIDTH_M for x in track]
    return min(gaps) > 0 and all(inside)


def stopped(step, setup, plan):
    """Return the states of the car when no command follows that of a step."""
    car = step.car.fork()
    end = RunEnd(inputs.stop_params(setup.scn), car.now)
    plant_side = LockstepStepper(car, end)
    tracks = [plant_side.tick(step.record.command)]
    if plan is not None:
        plant_side.stop.keep(plan.stamp_ns, lambda: plan)
    while not end.standing:  # beyond the finish line, too
        tracks.append(plant_side.tick_without_controller())
    return [state for track in tracks for state in messages(track.state_columns())[::10]]


def test_a_silent_controller_is_survived_more_often_along_its_plan_than_straight(setup):
    """Straight, 11 of these 18 drives hit an obstacle or leave the road."""
    along, straight = [], []
    for tick, step in enumerate(simulation.steps(setup)):
        if tick in SILENT_FROM:
            for well, plan in ((along, step.controller.stop_plan(step.record)), (straight, None)):
                well.append(is_well(stopped(step, setup, plan), step.obstacles.items))
    assert sum(along) >= 13
    assert sum(straight) <= 8


@pytest.fixture(scope='module')
def fails_at(setup):
    """Return a function that drives with solvers that fail for good at a tick."""
    controller = Controller(setup.params, setup.vehicle)
    failing = controller.parts.solvers.followed = Failing(controller.parts.solvers.followed)

    def run(tick):
        failing.dead = False
        loop = Loop(setup, controller)
        while not loop.outcome and (not loop.states or loop.states[-1].vx > 0.3):
            failing.dead = len(loop.states) >= tick
            loop.tick()
        return loop

    return run


@pytest.mark.parametrize('tick', [35, 50, 95])
def test_a_solver_that_dies_in_the_double_lane_change_ends_in_a_safe_stop(fails_at, tick):
    """In both changes of lane, before and beside the obstacles."""
    loop = fails_at(tick)
    Y = [x.Y for x in loop.states]
    assert loop.states[-1].vx < 0.35
    assert least_gap(loop) > 0.1
    assert min(Y) - R_VEH > EDGES[0]
    assert max(Y) + R_VEH < EDGES[1]
    assert max(np.degrees(abs(np.arctan(x.vy / x.vx))) for x in loop.states if x.vx > 3) < 20
    assert loop.car.gate.rejected + sum(loop.controller.memory.rejections.values()) == 0
    rungs = [why.values['rung'] for why in loop.whys[tick:]]
    assert rungs[:5] == ['shifted'] * 5
    assert set(rungs[5:]) == {'braking'}
    assert len(rungs) < 90  # 4.5 s from 75 km/h, most of it in a bend
