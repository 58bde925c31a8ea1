"""What the table holds of a drive, compared with the metrics of the whole drive."""

import math

import pytest
from closed_loops import fixed_weights
from rich.console import Console

from bags.errors import BagError
from experiments import drive_row
from experiments.drive_row import Row
from experiments.families.lane_change_task import NAME
from experiments.pool import Pool
from experiments.row_runner import DriveRecords
from experiments.tuned_study import arms

SCALES = {'failure': 10.0, 'missing_m': 0.1, 'speed_error_mps': 3.0, 'sideslip_deg': 5.0}
AVOIDED = {
    'avoided': True,
    'kept_m': -0.2,
    'peak_sideslip_deg': 2.5,
    'rms_speed_error_mps': 1.5,
}
HARD = tuple((f'controller.{name}', value) for name, value in fixed_weights('mpcc').items())
SOFT = (
    *HARD,
    ('controller.tolerances.contouring_m', 3.0),
    ('controller.tolerances.steer_rate_radps', 0.06),
)


def prepared(index, settings=()):
    return drive_row.prepare(Row(f'{NAME}:{index}', 'mpcc', settings, seed=11), any_car=True)


def test_an_avoided_task_has_the_metrics_of_the_whole_drive():
    setup = prepared(1, SOFT)
    values, whole = arms.measure(setup), drive_row.drive(setup)
    assert values['avoided']
    assert whole['completed']
    kept = min(
        whole['min_v2o_m'] - setup.params.safety.obstacle_m,
        whole['min_v2e_m'] - setup.params.safety.edge_m,
    )
    assert values['kept_m'] == pytest.approx(kept)
    assert values['peak_sideslip_deg'] == whole['peak_sideslip_deg']
    assert values['min_speed_mps'] == whole['min_speed_mps']


def test_a_drive_ends_where_it_has_failed():
    """These weights spin in this task: what follows is not simulated."""
    setup = prepared(3, HARD)
    values, whole = arms.measure(setup), drive_row.drive(setup)
    assert not values['avoided']
    assert not whole['completed']
    assert values['min_speed_mps'] > whole['min_speed_mps']


def test_what_a_drive_raises_is_no_failure_of_the_car(tmp_path):
    row = Row(f'{NAME}:1', 'mpcc', (('controller.limits.brake_n', 1.0),), seed=11)
    pool = Pool(1, console=Console(quiet=True))
    with DriveRecords(tmp_path) as records, pool:
        driver = arms.Driver(records, pool)
        with pytest.raises(BagError, match='brake_n: is 1; allowed from'):
            driver.drive([row])


@pytest.mark.parametrize(
    ('changes', 'cost'),
    [
        pytest.param({}, 0.2 / 0.1 + 1.5 / 3.0 + 2.5 / 5.0, id='its aims over their scales'),
        pytest.param({'kept_m': 0.4}, 1.5 / 3.0 + 2.5 / 5.0, id='more than kept is not better'),
        pytest.param({'kept_m': -3.0}, 10.0, id='at most a failure'),
        pytest.param({'avoided': False, 'kept_m': 1.0}, 10.0, id='a failure'),
        pytest.param({'avoided': False, 'kept_m': math.nan}, 10.0, id='a failure without values'),
    ],
)
def test_the_cost_of_a_drive(changes, cost):
    assert arms.cost({**AVOIDED, **changes}, SCALES) == pytest.approx(cost)
    assert arms.cost(arms.FAILED, SCALES) == 10.0
