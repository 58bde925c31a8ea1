"""How far is the car from where the model says it will be? Its table in docs/road_controller.md.

    python bench/prediction_error.py [--out FILE.md]

Drives of the plant are predicted again: from the recorded state of every tick, the model integrates
the recorded set-points over a second, with the step of the controller. The errors are those of the
model alone, for no plan and no solver takes part. Windows count whose lateral acceleration exceeds
two thirds of g somewhere, and that start above the least speed.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from closed_loops import fixed_weights
from tables import markdown

from experiments import simulation
from experiments.simulation import Setup
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import stage_parameters

SCENARIO, CONTROLLER = 'double_lane_change', 'mpcc'
SPEEDS_MPS = (18.0, 20.8, 23.0)
AHEAD_S = (0.05, 0.1, 0.2, 0.5, 1.0)
LIMIT_MPS2 = 9.81 * 2 / 3
LARGEST_SIDESLIP_RAD = 0.5  # beyond it a car is lost, and what it does is no question of a model
BRAKING_N = 1.0  # a smaller force has no split
COLUMNS = ('position [m]', 'heading [deg]', 'vx [m/s]', 'vy [m/s]', 'yaw rate [deg/s]')
DECIMALS = (3, 2, 3, 3, 2)
MODELS = {'without lag': {'servo_lag': None}, 'with lag': {'servo_lag': True}}


class Windows(NamedTuple):
    """Recorded windows of n ticks each, k of them; SI units, angles in the map."""

    states: np.ndarray  # (k, n + 1, 9)
    inputs: np.ndarray  # (k, n, 4)


def windows(setup: Setup, ticks: int) -> Windows:
    """Drive, and return the windows of `ticks` ticks at the limit."""
    columns = simulation.run(setup, explain=False)
    motion, command = columns['/vehicle/odometry'], columns['/controller/command']
    dt = setup.params.model.step_s
    rows = np.searchsorted(motion.stamp_ns, command.stamp_ns)
    # a command says where the set-points are one tick later; before the first one they are zero
    delta = np.append(0.0, command.steer_rad)
    force = np.append(0.0, command.front_x_n + command.rear_x_n)
    brakes = force[1:] < -BRAKING_N
    split = np.divide(command.front_x_n, force[1:], out=np.full(len(brakes), 0.5), where=brakes)
    zero = np.zeros(len(rows))
    states = State(
        *(motion.x_m[rows], motion.y_m[rows], np.unwrap(motion.yaw_rad)[rows]),
        *(motion.vx_mps[rows], motion.vy_mps[rows], motion.yaw_rate_radps[rows]),
        theta=zero,
        delta=delta[:-1],
        Fx=force[:-1],
    )
    inputs = Input(np.diff(delta) / dt, np.diff(force) / dt, split, zero)
    X, U = np.column_stack(states), np.column_stack(inputs)
    starts = np.arange(len(rows) - ticks)
    within = starts[:, None] + np.arange(ticks + 1)
    ay = np.abs(states.r * states.vx)[within].max(axis=1)
    sideslip = np.abs(np.arctan2(states.vy, states.vx))[within].max(axis=1)
    fast = states.vx[starts] > setup.params.limits.least_speed_mps
    chosen = within[(ay > LIMIT_MPS2) & (sideslip < LARGEST_SIDESLIP_RAD) & fast]
    return Windows(X[chosen], U[chosen[:, :-1]])


def errors(given: Windows, setup: Setup, params: ControllerParams) -> np.ndarray:
    """Return root mean squares over the windows (n, 5) of the model with the parameters `params`.

    A row per tick ahead, with the errors of COLUMNS.
    """
    car = stage_parameters.car(params, setup.vehicle)
    x, count = given.states[:, 0].T, len(given.states)
    step = single_track.step(params.model.step_s, single_track.structure(car)).map(count)
    cars = ca.repmat(ca.DM(list(car)), 1, count)
    rows = []
    for k in range(given.inputs.shape[1]):
        x = step(x, given.inputs[:, k].T, cars).full()
        wrong = State(*(x - given.states[:, k + 1].T))
        turned = np.degrees((wrong.psi, wrong.r))
        parts = np.hypot(wrong.X, wrong.Y), turned[0], wrong.vx, wrong.vy, turned[1]
        rows.append([np.sqrt(np.mean(part**2)) for part in parts])
    return np.array(rows)


def table() -> str:
    """Drive, predict, and return the table."""
    settings = {'controller': fixed_weights(CONTROLLER)}
    setups = [simulation.prepare(SCENARIO, CONTROLLER, settings, v) for v in SPEEDS_MPS]
    dt = setups[0].params.model.step_s
    ticks = round(AHEAD_S[-1] / dt)
    recorded = [windows(setup, ticks) for setup in setups]
    joined = Windows(*(np.concatenate(parts) for parts in zip(*recorded)))
    rows = []
    for name, changes in MODELS.items():
        params = setups[0].params
        params = replace(params, model=replace(params.model, **changes))
        found = errors(joined, setups[0], params)
        for ahead in AHEAD_S:
            values = zip(found[round(ahead / dt) - 1], DECIMALS)
            rows.append((f'{name}, {ahead:g} s', *(f'{value:.{n}f}' for value, n in values)))
    title = f'prediction error, root mean square of {len(joined.states)} windows at the limit'
    return markdown(title, ('model', *COLUMNS), rows)


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, help='Markdown file to write')
    options = parser.parse_args()
    found = table()
    print(found)
    if options.out:
        options.out.write_text(f'# Errors of the prediction\n\n{found}\n')


if __name__ == '__main__':
    main()
