"""The arms of the study: their drives as rows, and what the tables hold of a drive; who drives.

An arm is a controller file, settings, and weights of a search. All have the car file, the believed
friction and the safety distances of their task. Distances are those of the paper's circle around
the centre of gravity, whatever circles a controller has.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from random import Random
from typing import Any

import numpy as np

from bags.evaluation.drive import SIDESLIP_FROM, drive_from_columns, drop_nonfinite
from bags.evaluation.metrics.outcome import SLIDING_DEG
from bags.evaluation.metrics.registry import METRICS, EvaluatedDrive
from experiments import drive_row, simulation
from experiments.drive_row import Offset, Row
from experiments.families import draw
from experiments.families.lane_change_task import CIRCLE_M, NAME
from experiments.pool import Pool, WorkerError
from experiments.row_runner import DriveRecords
from experiments.simulation import Setup
from experiments.tuned_study.search import Weights
from msgs_yaml.types import VehicleState
from scenario_publisher.scenario import Scenario

COMPARED = ('mpcc', 'frenet')  # the verdicts are about their difference
FACTORIAL = 'factorial:'
HEADING = 'tolerances.heading_rad'
# those of both controller files when the plan was fixed: of arms that name no searched weights
BY_HAND: Weights = {
    'tolerances.contouring_m': 0.5,
    'tolerances.lag_m': 0.5,
    HEADING: 0.175,
    'tolerances.velocity_mps': 3.0,
    'tolerances.steer_rate_radps': 0.349,
    'tolerances.force_rate_nps': 20_000.0,
    'priorities.obstacle': 1000.0,
    'priorities.edge': 300.0,
}
FAILED: Mapping[str, Any] = {'avoided': False}  # of a drive without a result
LIMIT_S = 120.0  # of wall time for a drive


def tuned_parameters(plan: Mapping[str, Any], arm: str) -> list[str]:
    """Return the parameters that are searched for an arm."""
    without = plan['tuned'][arm].get('without', ())
    return [name for name in plan['search']['ranges'] if name not in without]


def settings(plan: Mapping[str, Any], arm: str, tuned: Mapping[str, Weights]) -> dict[str, Any]:
    """Return the parameters of an arm beside those of its task, from the `tuned` weights by arm."""
    if arm.startswith(FACTORIAL):
        chosen = {HEADING: tuned['frenet'][HEADING], **tuned['mpcc']}
        for digit, changed in zip(arm.removeprefix(FACTORIAL), plan['factors'].values()):
            chosen |= changed if digit == '1' else {}
        return chosen
    if arm in plan['tuned']:
        return {**tuned[arm], **plan['tuned'][arm].get('settings', {})}
    described = plan['derived'][arm]
    weights = tuned[described['weights']] if 'weights' in described else BY_HAND
    return {**weights, **described.get('settings', {})}


def row(
    plan: Mapping[str, Any],
    arm: str,
    chosen: Mapping[str, Any],
    seed: int,
    index: int,
    start: int = 0,
    labels: Iterable[tuple[str, Any]] = (),
) -> Row:
    """Return the drive of an arm with chosen parameters in a task.

    Each start has an offset of the speed of its own, which is the same for every arm.
    """
    most = plan['starts']['speed_kph']
    speed_kph = Random(f'{seed} {index} {start}').uniform(-most, most)
    if arm.startswith(FACTORIAL):
        controller = 'mpcc'
    else:
        controller = {**plan['tuned'], **plan['derived']}[arm]['controller']
    pairs = tuple((f'controller.{name}', value) for name, value in chosen.items())
    return Row(
        f'{NAME}:{index}',
        controller,
        pairs,
        seed,
        offset=Offset(speed_kph=speed_kph),
        knows_limit=False,
        labels=(('arm', arm), ('task', index), ('start', start), *labels),
    )


def combinations(plan: Mapping[str, Any]) -> Sequence[str]:
    """Return the arms of the factorial."""
    return [FACTORIAL + ''.join(bits) for bits in product('01', repeat=len(plan['factors']))]


def task_values(seed: int, index: int) -> Mapping[str, Any]:
    """Return what was drawn of a task."""
    return draw.draw(NAME, seed, index).values


def measure(setup: Setup) -> dict[str, Any]:
    """Simulate once; return the outcome by column, values for JSON.

    A drive ends where it has failed: what the car does afterwards is in no table.
    """
    columns = simulation.run(setup, explain=False, give_up=partial(has_failed, setup.scn))
    driven = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    facts = driven.facts._replace(circles=(0.0,), vehicle_radius=CIRCLE_M)
    driven = drop_nonfinite(driven._replace(facts=facts))
    run = EvaluatedDrive(driven)

    def value(name):
        return run.value(METRICS[name].function)

    obstacle_m, edge_m = value('min_v2o_m'), value('min_v2e_m')
    path = setup.scn.reference
    desired = math.hypot(path.X[1] - path.X[0], path.Y[1] - path.Y[0]) / (path.t[1] - path.t[0])
    return {
        'avoided': value('completed') and not value('lost') and min(obstacle_m, edge_m) > 0.0,
        'kept_m': min(obstacle_m - facts.safe_obstacle, edge_m - facts.safe_edge),
        'peak_sideslip_deg': value('peak_sideslip_deg'),
        'min_speed_mps': value('min_speed_mps'),
        'brake_onset_m': value('planned_brake_onset_at_m'),
        'rms_speed_error_mps': float(np.sqrt(np.mean((driven.motion.vx - desired) ** 2))),
    }


def has_failed(scn: Scenario, state: VehicleState) -> bool:
    """Return whether the circle touches an obstacle or an edge, or the car slides as one `lost`."""
    sideslip = math.degrees(math.atan2(state.vy, state.vx))
    return (
        (abs(sideslip) > SLIDING_DEG and math.hypot(state.vx, state.vy) > SIDESLIP_FROM)
        or not scn.edges.right[0, 1]
        < state.Y - CIRCLE_M
        < state.Y + CIRCLE_M
        < scn.edges.left[0, 1]
        or any(
            math.hypot(state.X - disc.X, state.Y - disc.Y) < disc.r_obs + CIRCLE_M
            for obstacle in scn.obstacles.items
            for disc in obstacle.discs()
        )
    )


def cost(outcome: Mapping[str, Any], scales: Mapping[str, float]) -> float:
    """Return the cost of a drive in a search, at most that of a failure."""
    if not outcome['avoided']:
        return scales['failure']
    total = (
        max(0.0, -outcome['kept_m']) / scales['missing_m']
        + outcome['rms_speed_error_mps'] / scales['speed_error_mps']
        + outcome['peak_sideslip_deg'] / scales['sideslip_deg']
    )
    return float(min(scales['failure'], total))


class Driver:
    """Drives rows that have no record, and keeps a line of the table for each."""

    def __init__(self, records: DriveRecords, pool: Pool):
        self.records, self.pool = records, pool
        self.lines: list[dict[str, Any]] = []

    def drive(self, rows: Sequence[Row], **labels: Any) -> list[Mapping[str, Any]]:
        """Return the outcome of each row.

        That of a drive that takes too long or ends its process is a failure. Raises whatever else a
        drive raises, as BagError for a file that was changed meanwhile.
        """
        keys = [drive_row.key(row) for row in rows]
        tasks = {key: (row, key, measure) for key, row in zip(keys, rows)}
        errors: dict[str, str] = {}
        how = LIMIT_S, WorkerError, len(self.lines)
        self.records.finish(self.pool, drive_row.drive_unchanged, tasks, errors, *how)
        results = []
        for row, key in zip(rows, keys):
            values = json.loads(self.records.get(key, json.dumps(FAILED)))
            self.lines.append(
                {**labels, **dict(row.labels), **values, 'error': errors.get(key, '')}
            )
            results.append(values)
        return results
