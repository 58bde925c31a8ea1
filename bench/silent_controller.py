"""What becomes of a car whose controller falls silent in a manoeuvre: the table of docs/safety.md.

    .venv/bin/python bench/silent_controller.py

`mpcc_road` drives nominal draws. From four random instants of each, out of those in which the car
corners or an obstacle is dangerous, no command comes any more: once the plant has only the last
command, and brakes straight, once it has the stop plan, too. Prints in how many cases the car comes
to its end on the road and without contact.
"""

import argparse
from collections.abc import Iterator
from random import Random

import pandas as pd

from bags.evaluation.drive import drive_from_columns
from bags.evaluation.metrics.outcome import OUTLINE, beyond_edge_m, collided_by
from bags.evaluation.metrics.registry import EvaluatedDrive
from experiments import drive_row, simulation
from experiments.configuration import inputs
from experiments.drive_row import Row
from experiments.simulation import Setup, Step
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import StopPlan, Why
from scenario_publisher import scenario
from vehicle_plant.run_end import RunEnd
from vehicle_plant.state import join_trajectories
from vehicle_plant.stepping import LockstepStepper

CONTROLLER = 'mpcc_road'
FAMILIES = ('bend_inside', 'bend_outside', 'bend_oncoming', 'pop_up', 'double_lane_change')
SEED, DRAWS = 2, 4  # of each family
INSTANTS = 4  # per draw
CORNERS_MPS2, DRIVES_MPS = 2.0, 5.0
MOST_TICKS = 250  # until a car without a controller stands
STRAIGHT, PLAN, ONLY_STRAIGHT = 'straight', 'along the stop plan', 'only straight'


def main() -> None:
    """Drive, and print the table."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    rows = pd.DataFrame(
        case for family in FAMILIES for draw in range(DRAWS) for case in silences(family, draw)
    )
    rows[ONLY_STRAIGHT] = rows[STRAIGHT] & ~rows[PLAN]
    counts = rows.groupby('family', sort=False)[[STRAIGHT, PLAN, ONLY_STRAIGHT]].sum()
    counts.insert(0, 'cases', rows['family'].value_counts())
    counts.loc['all'] = counts.sum()
    print(counts.to_string())


def silences(family: str, draw: int) -> Iterator[dict[str, object]]:
    """Yield a line per instant of a draw from which the controller is silent."""
    row = Row(f'{family}:{draw}', CONTROLLER, seed=SEED, knows_limit=False)
    setup = drive_row.prepare(row, any_car=True)
    cases = []
    for step in simulation.steps(setup):
        state, attempt = step.car.state, step.record.attempt
        is_dangerous = attempt is not None and attempt.around is not None
        if state.vx > DRIVES_MPS and (is_dangerous or abs(state.vx * state.r) > CORNERS_MPS2):
            # what the next step changes is kept as it is now
            plan = step.controller.stop_plan(step.record)
            why = step.controller.reporter.why(step.record, False)
            cases.append((step._replace(car=step.car.fork()), plan, why))
    random = Random(f'{family}:{draw} {SEED}')
    for step, plan, why in random.sample(cases, min(INSTANTS, len(cases))):
        yield {
            'family': family,
            STRAIGHT: is_safe(setup, step, None, why),
            PLAN: is_safe(setup, step, plan, why),
        }


def is_safe(setup: Setup, step: Step, plan: StopPlan | None, why: Why) -> bool:
    """Return whether the car stays on the road without contact; its last command is of the step."""
    scn, car = setup.scn, step.car.fork()
    end = RunEnd(inputs.stop_params(scn), car.now)
    plant_side = LockstepStepper(car, end)
    tracks, obstacles = [car.now, plant_side.tick(step.record.command)], [step.obstacles]
    if plan is not None:
        plant_side.stop.keep(plan.stamp_ns, lambda: plan)
    while not end.standing and len(tracks) < MOST_TICKS:  # beyond the finish line, too
        tracks.append(plant_side.tick_without_controller())
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        obstacles.append(scenario.obstacles_at(scn, t, car.stamp_ns, (car.state.X, car.state.Y)))
    values = {
        '/scenario/reference': [conversions.reference_as_received(scn.reference)],
        '/scenario/road_edges': [scn.edges],
        '/scenario/obstacles': obstacles,
        '/controller/why': [why],
    }
    columns = simulation.build_columns(join_trajectories(tracks), [step.record.command], values)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    run = EvaluatedDrive(drive)
    return run.value(beyond_edge_m) is None and run.value(collided_by) != OUTLINE


if __name__ == '__main__':
    main()
