"""The numbers of a drive that a study prints: their names, units and decimals."""

from typing import Any, NamedTuple


class Quantity(NamedTuple):
    """One number by its dotted name in a Record."""

    name: str
    title: str
    unit: str
    decimals: int

    def told(self, value: Any) -> str:
        """Return a value as text; a dash where it has none."""
        return '–' if value is None else f'{value:.{self.decimals}f}'


QUANTITIES = (
    Quantity('min_v2o_m', 'min V2O', 'm', 2),
    Quantity('min_v2o_per_obstacle_m.1', 'min V2O, obstacle 1', 'm', 2),
    Quantity('min_v2o_per_obstacle_m.2', 'min V2O, obstacle 2', 'm', 2),
    Quantity('min_v2e_m', 'min V2E', 'm', 2),
    Quantity('min_v2e_per_edge_m.left', 'min V2E, left', 'm', 2),
    Quantity('min_v2e_per_edge_m.right', 'min V2E, right', 'm', 2),
    Quantity('min_outline_gap_m', 'min gap of the outline', 'm', 2),
    Quantity('peak_sideslip_deg', 'peak sideslip angle', 'deg', 2),
    Quantity('peak_sideslip_at_m', 'its station', 'm', 0),
    Quantity('min_speed_mps', 'min speed', 'm/s', 2),
    Quantity('brake_onset_at_m', 'brake onset, -500 N', 'm', 1),
    Quantity('brake_onset_hard_at_m', 'brake onset, -1500 N', 'm', 1),
    Quantity('braking_s', 'braking (-500 N) for', 's', 2),
    Quantity('counter_steer_s', 'counter-steering for', 's', 2),
    Quantity('peak_counter_steer_deg', 'peak counter-steer', 'deg', 1),
    Quantity('peak_lat_acc_share', 'peak lateral acceleration / (mu g)', '-', 3),
    Quantity('peak_brake_share', 'peak deceleration / (mu g)', '-', 3),
    Quantity('rms_contouring_m', 'rms contouring error', 'm', 3),
    # processor time: wall time tells how many drives were made at a time
    Quantity('solve_cpu_ms.mean', 'solve time (CPU), mean', 'ms', 2),
    Quantity('solve_cpu_ms.max', 'solve time (CPU), max', 'ms', 2),
    Quantity('solver.iterations_mean', 'iterations, mean', '-', 2),
    Quantity('solver.iterations_max', 'iterations, max', '-', 0),
    Quantity('solver.failed', 'failed solves', '-', 0),
    Quantity('fallbacks', 'fallbacks', '-', 0),
)
BY_NAME = {one.name: one for one in QUANTITIES}
