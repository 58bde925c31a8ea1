"""Records of drives with the metrics of the operating point."""

import pytest

from experiments.study.run_spec import RunSpec
from experiments.study.runner import Record

SPEC = RunSpec('double_lane_change', 'mpcc', (), 75.0, 1.0, 1e-6)
# a drive like those at the operating point
METRICS = {
    'completed': True,
    'collided': False,
    'entered_unsafe_area': False,
    'min_v2o_m': 0.53,
    'min_v2o_per_obstacle_m': {'1': 0.53, '2': 0.57},
    'min_v2e_m': 0.8,
    'min_v2e_per_edge_m': {'left': 0.8, 'right': 0.9},
    'min_outline_gap_m': 0.7,
    'min_outline_gap_per_obstacle_m': {'1': 0.7, '2': 0.75},
    'min_outline_v2e_m': 0.78,
    'min_outline_v2e_per_edge_m': {'left': 0.78, 'right': 0.88},
    'overshoots': [],
    'peak_overshoot_m': 0.0,
    'peak_sideslip_deg': 3.5,
    'min_speed_mps': 20.3,
    'brake_onset_at_m': None,
    'brake_onset_hard_at_m': None,
    'planned_brake_onset_at_m': None,
    'planned_brake_onset_hard_at_m': None,
    'braking_s': 0.0,
    'counter_steer_s': 0.04,
    'peak_lat_acc_mps2': 9.0,
    'fallbacks': 0,
    'peak_counter_steer_deg': 2.0,
    'peak_sideslip_at_m': 60.0,
    'peak_lat_acc_share': 0.93,
    'lateral_limit_use_plant': 0.98,
    'peak_brake_share': 0.07,
    'rms_contouring_m': 0.24,
    'solve_cpu_ms': {'mean': 0.3, 'max': 2.0},
}
SOLVER = {'failed': 0, 'iterations_mean': 3.5, 'iterations_max': 11}


@pytest.fixture(scope='session')
def make_record():
    """Return make(...) -> Record; what is given replaces METRICS or SOLVER."""

    def make(**given):
        solver = {name: given.pop(name, value) for name, value in SOLVER.items()}
        return Record(SPEC, {**METRICS, **given}, solver)

    return make


class AlikeRuns:
    """Stands for a Runner: every run comes out alike, without any simulation."""

    jobs = 2

    def __init__(self, make_record):
        self.make_record, self.specs = make_record, []

    def run(self, specs, label, done_before=0, total=None):
        self.specs += specs
        return [self.make_record()._replace(spec=spec) for spec in specs]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


@pytest.fixture(scope='session')
def alike_runs(make_record):
    """Return a function that makes the stand-in of a Runner."""
    return lambda: AlikeRuns(make_record)
