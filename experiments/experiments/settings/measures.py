"""What the table holds of a drive: clearances of circle and outline, sideslip, braking, grip.

The circles are those of the setting for every controller, whatever circles a controller has.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from bags.evaluation import geometry, metrics
from bags.evaluation.drive import Drive, drop_nonfinite
from bags.evaluation.metrics import outcome
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import SEARCH_M, compute_series
from bags.storage.columns import Columns
from experiments.settings.preregistration import BrakeCondition, LimitCondition
from experiments.settings.setting import Setting
from experiments.study.run_spec import SOLVED, solver_statistics

NS = 1e-9
# metrics of `bags compare` that the table takes as they are
KEPT = (
    *('completed', 'collided', 'collided_by', 'left_road', 'lost'),
    *('min_v2o_m', 'min_v2e_m', 'min_outline_gap_m'),
    *('peak_sideslip_deg', 'peak_sideslip_at_m', 'min_speed_mps'),
    *('brake_onset_at_m', 'brake_onset_hard_at_m', 'braking_s', 'counter_steer_s'),
    *('peak_lat_acc_mps2', 'peak_brake_mps2', 'rms_contouring_m', 'ticks', 'fallbacks'),
)


def measure(
    drive: Drive,
    columns: Mapping[str, Columns],
    setting: Setting,
    brake: BrakeCondition,
    limit: LimitCondition,
) -> dict[str, Any]:
    """Return the measures of a drive by the name of their column; None has no meaning in it."""
    facts = drive.facts._replace(circles=setting.offsets, vehicle_radius=setting.radius)
    drive = drop_nonfinite(drive._replace(facts=facts))
    series = compute_series(drive)
    values = metrics.compute_metrics(drive, series)
    v2o, edges = values['min_v2o_per_obstacle_m'], values['min_v2e_per_edge_m']
    gaps = {number: outcome.smallest_finite(gap) for number, gap in series.outline_gaps.items()}
    held = held_peak(drive.accelerations.stamp_ns, np.abs(drive.accelerations.ay), limit.held_s)
    reports = [why.values for why in columns['/controller/why'].values]
    solver = solver_statistics(reports)
    return {
        **{name: values[name] for name in KEPT},
        'v2o_1_m': v2o['1'],
        'v2o_2_m': v2o['2'],
        'outline_1_m': gaps[1],
        'outline_2_m': gaps[2],
        'v2e_left_m': edges['left'],
        'v2e_right_m': edges['right'],
        'outline_edge_m': outline_edge_gap(EvaluatedDrive(drive, series)),
        'overshoots': len(values['overshoots']),
        'lat_acc_held_mps2': held,
        'limit_share': None if held is None else held / setting.plant.limit,
        'brake_onset_planned_at_m': planned_onset(drive, series, columns, brake),
        'solver_failed_share': solver['failed_share'],
        'iterations_mean': solver['iterations_mean'],
    }


def outline_edge_gap(run: EvaluatedDrive) -> float | None:
    """Return the least gap [m] between the outline and an edge of the road, negative beyond it.

    None where the car was never so near to an edge that its outline was checked.
    """
    _, beyond = outcome.outline_beyond_edge(run)
    return outcome.smallest_finite(-beyond)


def held_peak(stamp_ns: np.ndarray, values: np.ndarray, held_s: float) -> float | None:
    """Return the largest value that is reached or exceeded for `held_s` without interruption.

    Samples (n,) in driving order, equally spaced. None for a shorter drive.
    """
    if len(stamp_ns) < 2:
        return None
    spacing_s = float(np.median(np.diff(stamp_ns))) * NS
    size = round(held_s / spacing_s) + 1
    if len(values) < size:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(values, size)
    return float(windows.min(axis=1).max())


def planned_onset(drive, series, columns, brake: BrakeCondition) -> float | None:
    """Return the station [m] at which the car begins to brake by a converged plan, or None.

    The actuated force of both axles is at or below `brake_n` for `held_s`, the plan in force at
    the beginning converged, and the beginning lies before obstacle 2.
    """
    inputs = drive.inputs
    if not len(inputs.stamp_ns):
        return None
    station = np.interp(inputs.stamp_ns, drive.motion.stamp_ns, series.station)
    starts = held_starts(inputs.stamp_ns, inputs.force <= brake.brake_n, brake.held_s)
    answered = columns['/controller/command'].stamp_ns
    solved = [
        report.values.get('rung') == 'solved' and report.values.get('solver.status') == SOLVED
        for report in columns['/controller/why'].values
    ]
    second = drive.scene.obstacles[1]
    centre = np.array([[second.x[0], second.y[0]]])
    end = float(geometry.project_drive(centre, drive.scene.reference, SEARCH_M).distance[0])
    for start in starts:
        tick = int(np.searchsorted(answered, inputs.stamp_ns[start], side='right')) - 1
        if station[start] < end and tick >= 0 and solved[tick]:
            return float(station[start])
    return None


def held_starts(stamp_ns: np.ndarray, condition: np.ndarray, held_s: float) -> list[int]:
    """Return the first index of every stretch in which a condition (n,) holds for `held_s`."""
    padded = np.concatenate([[False], condition, [False]])
    begins, ends = (
        np.flatnonzero(padded[1:] > padded[:-1]),
        np.flatnonzero(padded[1:] < padded[:-1]),
    )
    return [
        int(begin)
        for begin, end in zip(begins, ends - 1)
        if (stamp_ns[end] - stamp_ns[begin]) * NS >= held_s
    ]
