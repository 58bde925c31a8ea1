"""The integrator: of fourth order where motion is smooth, and a millisecond is far enough."""

import plant_convergence
import pytest

from vehicle_plant import integrator, parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings


@pytest.mark.parametrize('name', ['step_steer', 'turn_braking', 'sine_with_dwell'])
def test_error_falls_with_the_fourth_power_and_a_millisecond_leaves_little(name):
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    run = MANOEUVRES[name].runs(case)[0]
    coarse, fine = plant_convergence.step_errors(
        run, case, (2 * integrator.STEP_S, integrator.STEP_S)
    )
    for quantity in ('acceleration', 'slip'):
        errors = getattr(coarse, quantity), getattr(fine, quantity)
        assert plant_convergence.convergence_order(*errors) > 3.5
    assert fine.position < 1e-7
    assert fine.yaw_rate < 1e-8
    assert fine.acceleration < 1e-5
    assert fine.slip < 1e-7


def test_standstill_is_of_first_order_and_still_accurate():
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    (run,) = MANOEUVRES['straight_braking'].runs(case)
    (fine,) = plant_convergence.step_errors(run, case, (integrator.STEP_S,))
    assert fine.position < 1e-5
    assert fine.acceleration < 1e-2
