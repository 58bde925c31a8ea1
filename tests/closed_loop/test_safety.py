"""What becomes of the car when the solver fails, or answers late: controller and plant together."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest

from experiments.configuration import inputs
from mpcc_controller.driving import braking
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs
from msgs_yaml import conversions as as_received
from msgs_yaml.conversions import NS_PER_S
from scenario_publisher import scenario
from stage_solver.solution import FAILED
from vehicle_plant.initial_state import Start
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import TICK_STEPS, Simulator

DOUBLE = 'double_lane_change'
R_VEH, EDGES = 1.1, (-2.5, 6.0)


class Failing:
    """A solver that fails from a tick on."""

    def __init__(self, inner):
        self.inner, self.dead = inner, False

    def solve(self, *numbers):
        solution = self.inner.solve(*numbers)
        return solution._replace(status=FAILED) if self.dead else solution


class Slow:
    """A solver that takes its time on a clock of its own."""

    def __init__(self, inner, seconds):
        self.inner, self.seconds, self.now = inner, seconds, 0.0

    def __call__(self):
        return self.now

    def solve(self, *numbers):
        self.now += self.seconds
        return self.inner.solve(*numbers)


class Run(NamedTuple):
    """What a drive is judged by."""

    states: np.ndarray  # (n, 6) X Y psi vx vy r, per tick
    gap: np.ndarray  # (n,) m, to the nearest obstacle
    whys: list
    commands: list
    refused: int

    @property
    def sideslip_deg(self):
        moving = self.states[:, 3] > 3
        return np.degrees(np.abs(np.arctan(self.states[:, 4] / self.states[:, 3])))[moving]


@pytest.fixture(scope='module')
def parts(simulated):
    scn, params, vehicle = simulated.parts(DOUBLE, 'mpcc')
    return scn, params, vehicle, simulated.plant


def drive(controller, scn, plant, late_ms=0, on_tick=lambda k: None):
    """Drive until the end or standstill; commands take hold `late_ms` after their state."""
    car = Simulator(plant, scn.friction, Start(*scn.start))
    end, outcome = RunEnd(inputs.stop_params(scn), car.now), None
    controller.reset(car.actuators)
    assert not controller.set_reference(as_received.reference_as_received(scn.reference))
    assert not controller.set_edges(scn.edges)
    rows, gaps, whys, commands = [], [], [], []
    while not outcome and (not rows or rows[-1][3] > 0.3):
        on_tick(len(rows))
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        obstacles = scenario.obstacles_at(scn, t, car.stamp_ns)
        controller.set_obstacles(obstacles)
        x = car.state
        record = controller.step(TickInputs(as_received.odometry_as_received(x)))
        command, (_, why) = record.command, controller.report(record)
        rows.append(x[1:])
        gaps.append(min(np.hypot(x.X - o.X, x.Y - o.Y) - o.r_obs - R_VEH for o in obstacles.items))
        whys.append(why)
        commands.append(command)
        car.advance(None, late_ms)
        outcome = end.check(car.advance(command, TICK_STEPS - late_ms))
    refused = car.gate.rejected + sum(controller.memory.rejections.values())
    return Run(np.array(rows), np.array(gaps), whys, commands, refused)


@pytest.fixture(scope='module')
def fails_at(parts):
    """Return a function that drives with solvers that fail for good at a tick."""
    scn, params, vehicle, plant = parts
    controller = Controller(params, vehicle)
    failing = controller.parts.solvers.first = Failing(controller.parts.solvers.first)

    def run(tick):
        return drive(controller, scn, plant, on_tick=lambda k: setattr(failing, 'dead', k >= tick))

    return run


@pytest.mark.parametrize('tick', [30, 35, 50, 95, 105])
def test_a_solver_that_dies_in_the_double_lane_change_ends_in_a_safe_stop(fails_at, tick):
    """In both changes of lane, before and beside the obstacles."""
    run = fails_at(tick)
    Y = run.states[:, 1]
    assert run.states[-1, 3] < 0.35
    assert run.gap.min() > 0.1
    assert Y.min() - R_VEH > EDGES[0]
    assert Y.max() + R_VEH < EDGES[1]
    assert run.sideslip_deg.max() < 20
    assert run.refused == 0
    rungs = [why.values['rung'] for why in run.whys[tick:]]
    assert rungs[:5] == ['shifted'] * 5
    assert set(rungs[5:]) == {'braking'}
    assert len(rungs) < 90  # 4.5 s from 75 km/h, most of it in a bend


@pytest.mark.parametrize(('tick', 'hits'), [(35, 'obstacle'), (50, 'edge')])
def test_braking_straight_instead_would_have_hit_something(fails_at, monkeypatch, tick, hits):
    straight = braking.LookaheadPoint(braking.NONE, None)
    monkeypatch.setattr(braking, 'lookahead_point', lambda *_: straight)
    run = fails_at(tick)
    if hits == 'obstacle':
        assert run.gap.min() < 0
    else:
        assert run.states[:, 1].max() > EDGES[1]


@pytest.mark.parametrize('late_ms', [10, 20])
def test_delay_compensation_improves_a_late_controller(parts, late_ms):
    scn, params, vehicle, plant = parts
    solver = dataclasses.replace(params.solver, time_limit_s=10.0, patience_s=10.0)
    runs = {}
    for aware, longest_s in ((True, params.delay.longest_s), (False, 0.0)):
        delay = dataclasses.replace(params.delay, longest_s=longest_s)
        changed = dataclasses.replace(params, solver=solver, delay=delay)
        controller = Controller(changed, vehicle, limit_time=True)
        slow = Slow(controller.parts.solvers.first, late_ms / 1e3 - params.delay.transport_s)
        controller.parts.solvers.first = controller.parts.clock = slow
        runs[aware] = drive(controller, scn, plant, late_ms)
        leads = [why.values['time.lead_ms'] for why in runs[aware].whys[1:]]
        assert leads == pytest.approx([late_ms if aware else 0] * len(leads))

    def effort(run):
        return np.sqrt(np.mean(np.square([command.d_delta for command in run.commands])))

    def error(run):
        return np.sqrt(np.mean(np.square([why.values['error.con'] for why in run.whys])))

    assert error(runs[True]) < 0.96 * error(runs[False])
    assert effort(runs[True]) < 0.96 * effort(runs[False])
    assert runs[True].sideslip_deg.max() < runs[False].sideslip_deg.max()
    assert runs[True].gap.min() > 0.4
