"""What the tables of the study hold of a drive, the same for every controller; who drives.

Distances are those of the paper's circle around the centre of gravity, whatever circles a
controller has.
"""

import json
import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from bags.evaluation.drive import SIDESLIP_FROM, drive_from_columns, drop_nonfinite
from bags.evaluation.metrics.outcome import SLIDING_DEG
from bags.evaluation.metrics.registry import METRICS, EvaluatedDrive
from experiments import drive_row, simulation
from experiments.drive_records import DriveRecords
from experiments.drive_row import Row
from experiments.families.lane_change_task import CIRCLE_M
from experiments.pool import Pool, WorkerError
from experiments.simulation import Setup
from msgs_yaml.types import VehicleState
from scenario_publisher.scenario import Scenario

FAILED: Mapping[str, Any] = {'avoided': False}  # of a drive without a result
LIMIT_S = 120.0  # of wall time for a drive


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
