"""What the table holds of a drive: clearances of circle and outline, sideslip, braking, grip.

The circles are those of the setting for every controller, whatever circles a controller has.
"""

from collections.abc import Mapping
from typing import Any

from bags.evaluation import metrics
from bags.evaluation.drive import Drive, drop_nonfinite
from bags.evaluation.metrics.driving import planned_brake_onset
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import compute_series
from bags.storage.columns import Columns
from experiments.drive_row import solver_statistics
from experiments.settings.plan import Plan
from experiments.settings.setting import Setting

# metrics of `bags compare` that the table takes as they are
KEPT = (
    *('completed', 'collided', 'collided_by', 'left_road', 'lost'),
    *('min_v2o_m', 'min_v2e_m', 'min_outline_gap_m'),
    *('peak_sideslip_deg', 'peak_sideslip_at_m', 'min_speed_mps'),
    *('brake_onset_at_m', 'brake_onset_hard_at_m', 'braking_s', 'counter_steer_s'),
    *('peak_lat_acc_mps2', 'peak_brake_mps2', 'rms_contouring_m', 'ticks', 'fallbacks'),
)


def measure(
    drive: Drive, columns: Mapping[str, Columns], setting: Setting, brake: Plan
) -> dict[str, Any]:
    """Return the measures of a drive by the name of their column; None has no meaning in it."""
    facts = drive.facts._replace(
        circles=setting.offsets,
        vehicle_radius=setting.radius,
        lateral_limit=setting.plant.limit,
    )
    drive = drop_nonfinite(drive._replace(facts=facts))
    series = compute_series(drive)
    values = metrics.compute_metrics(drive, series)
    v2o, edges = values['min_v2o_per_obstacle_m'], values['min_v2e_per_edge_m']
    outline = values['min_outline_gap_per_obstacle_m']
    reports = [why.values for why in columns['/controller/why'].values]
    solver = solver_statistics(reports)
    return {
        **{name: values[name] for name in KEPT},
        'v2o_1_m': v2o['1'],
        'v2o_2_m': v2o['2'],
        'outline_1_m': outline['1'],
        'outline_2_m': outline['2'],
        'v2e_left_m': edges['left'],
        'v2e_right_m': edges['right'],
        'outline_edge_m': values['min_outline_v2e_m'],
        'overshoots': len(values['overshoots']),
        'lat_acc_held_mps2': values['held_lat_acc_mps2'],
        'limit_share': values['lateral_limit_use_plant'],
        'brake_onset_planned_at_m': planned_brake_onset(
            EvaluatedDrive(drive, series), brake.brake_n
        ),
        'solver_failed_share': solver['failed_share'],
        'iterations_mean': solver['iterations_mean'],
    }
