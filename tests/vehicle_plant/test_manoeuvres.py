"""Manoeuvres: what they drive, what they say about the car, what they leave behind."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid

from vehicle_plant import manoeuvre, parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import (
    linear_single_track,
    procedure,
    settings,
    sine_with_dwell,
    steady_circle,
    straight_braking,
)
from vehicle_plant.simulator import RefusedError
from vehicle_plant.state import SetPoints


@pytest.fixture(scope='module')
def results():
    """Numbers and figure of every manoeuvre on dry road."""
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    return {name: manoeuvre.perform(name, case) for name in MANOEUVRES}


def value(results, name, number):
    return results[name][0][number].value


def test_a_run_that_the_gate_refuses_says_so():
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    run = procedure.Run('', 20.0, 1.0, lambda t, vx: SetPoints(1.0, 0.0, 0.0))
    with pytest.raises(RefusedError, match='refuses the command: steer is 1 rad'):
        procedure.drive(run, case)


@pytest.mark.parametrize('name', MANOEUVRES)
def test_every_number_is_finite_and_every_axis_has_its_unit(results, name):
    numbers, figure = results[name]
    assert all(np.isfinite(number.value) for number in numbers.values())
    shared = {}
    for axes in figure.axes:
        assert axes.get_ylabel().endswith(']')
        column = axes.get_subplotspec().colspan.start
        shared.setdefault(column, []).append(axes.get_xlabel())
    for labels in shared.values():
        assert any(label.endswith(']') for label in labels)


def test_car_understeers_and_slides_at_nine_tenths_of_g(results):
    assert value(results, 'steady_circle', 'understeer_gradient') > 0
    assert value(results, 'steady_circle', 'greatest_ay') == pytest.approx(0.89 * 9.81, rel=0.05)
    # 3 to 4.5 degrees of roll at 1 g
    assert 0.052 < value(results, 'steady_circle', 'roll_gradient') * 9.81 < 0.079


def test_steer_for_an_acceleration_is_nearly_that_of_the_single_track():
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    car = linear_single_track.linear_car(case.plant, 1.0)
    # and more: roll, load transfer, bent tyres, and the lag of the car behind the ramp
    assert 1.0 < steady_circle.steer_at(case, 25.0, 2.0) / car.steer(2.0, 25.0) < 1.15
    with pytest.raises(ValueError, match=r'wanted 20\.00'):
        steady_circle.steer_at(case, 25.0, 20.0)


def test_yaw_rate_answers_a_step_before_lateral_acceleration(results):
    for time in ('rise_time', 'response_time', 'peak_time'):
        yaw_rate, ay = (value(results, 'step_steer', f'{n}_{time}') for n in ('yaw_rate', 'ay'))
        assert 0.05 < yaw_rate < ay < 1.0
    assert 0 < value(results, 'step_steer', 'yaw_rate_overshoot') < 0.3
    # the gain of the step is that of the slow sine, less what 4 m/s^2 bends the tyres
    slow = value(results, 'sine_sweep', 'gain_0.1_hz')
    assert 0.9 * slow < value(results, 'step_steer', 'yaw_rate_gain') < slow


def test_braking_distance_is_that_of_the_closed_form(results):
    assert abs(value(results, 'straight_braking', 'distance_error')) < 2e-3
    assert value(results, 'straight_braking', 'mean_full_deceleration') == pytest.approx(
        6, rel=0.02
    )
    assert value(results, 'straight_braking', 'creep') < 1e-3


@pytest.mark.parametrize('k', [0.4, 0.0])
def test_closed_form_of_braking_solves_its_equation(k):
    form = straight_braking.ClosedForm(M=1900.0, F=9000.0, k=k)
    v = np.linspace(0, 30.0, 20001)
    per_speed = form.M / (form.F + k * v**2)  # s per m/s
    assert trapezoid(per_speed, v) == pytest.approx(float(form.duration(30.0)), rel=1e-8)
    assert trapezoid(v * per_speed, v) == pytest.approx(float(form.distance(30.0)), rel=1e-8)


def test_braking_in_a_turn_turns_the_car_in_the_more_the_harder(results):
    ratios = [value(results, 'turn_braking', f'yaw_rate_ratio_at_{a}') for a in (2, 3, 4, 5)]
    assert ratios == sorted(ratios)
    assert ratios[0] > 1
    assert value(results, 'turn_braking', 'initial_radius') == pytest.approx(100, rel=0.03)


def test_dwell_rests_at_the_second_peak_and_ends_straight():
    f_hz, dwell = 0.7, 0.5
    t = np.arange(-0.1, 2.2, 1e-3)
    steer = np.array([sine_with_dwell.waveform(x, f_hz, dwell) for x in t])
    peak = 0.75 / f_hz
    assert steer[(t >= peak) & (t <= peak + dwell)] == pytest.approx(-1.0, abs=1e-12)
    assert steer.max() == pytest.approx(1.0, abs=1e-4)
    assert not steer[(t < 0) | (t >= 1 / f_hz + dwell)].any()
    assert np.abs(np.diff(steer)).max() < 2 * np.pi * f_hz * 1.1e-3


def test_car_is_agile_enough_and_stable_up_to_five_times_the_unit(results):
    assert value(results, 'sine_with_dwell', 'passed_up_to') >= 5.0
    displaced = [
        value(results, 'sine_with_dwell', f'displacement_at_{a:g}')
        for a in settings.load().sine_with_dwell.amplitudes
    ]
    assert displaced == sorted(displaced)


@pytest.mark.parametrize(
    ('name', 'limited'),
    {
        'steady_circle': 'greatest_ay',
        'step_steer': 'ay_steady',
        'sine_sweep': 'greatest_ay',
        'straight_braking': 'mean_full_deceleration',
        'turn_braking': 'mean_deceleration_at_6',
        'sine_with_dwell': 'displacement_at_4',
    }.items(),
)
def test_ice_can_be_driven_on(results, name, limited):
    case = procedure.Case(parameters.load(), 0.2, settings.load())
    runs = MANOEUVRES[name].runs(case)
    tracks = [procedure.drive(run, case) for run in runs]
    numbers = MANOEUVRES[name].numbers(case, runs, tracks)
    assert numbers.keys() == results[name][0].keys()
    assert all(np.isfinite(number.value) for number in numbers.values())
    # what friction limits falls with it, a little less: lightly loaded tyres grip better
    assert 0.19 < numbers[limited].value / value(results, name, limited) < 0.24
    # and no moment of a drive has more of it than the tyres hold, at the lightest load
    tyre, scaling = case.plant.tyre, case.plant.car.scaling
    most = 1.05 * case.friction * abs(tyre.lateral.PDY1) * scaling.front.LMUY * 9.81
    for track in tracks:
        assert max(np.hypot(imu.ax, imu.ay) for imu in track.imu()) < most


def test_every_manoeuvre_is_driven_on_ice():
    (marked,) = test_ice_can_be_driven_on.pytestmark
    assert [name for name, _ in marked.args[1]] == list(MANOEUVRES)


def test_phasor_finds_amplitude_and_phase_beside_a_drift():
    t = np.arange(0, 3, 1e-3)
    y = 0.3 * np.cos(2 * np.pi * t + 0.7) + 5 - 2 * t
    assert procedure.phasor(t, y, 1.0) == pytest.approx(0.3 * np.exp(0.7j), rel=1e-9)


def test_reaching_is_interpolated_and_never_is_nan():
    t = np.array([0.0, 1.0, 2.0])
    assert procedure.first_crossing_time(t, np.array([0.0, 0.0, 4.0]), 1.0) == pytest.approx(1.25)
    assert procedure.first_crossing_time(t, np.array([2.0, 0.0, 4.0]), 1.0) == 0.0
    assert np.isnan(procedure.first_crossing_time(t, np.zeros(3), 1.0))


def test_command_lists_prints_and_writes(tmp_path, capsys):
    assert manoeuvre.main(['--list']) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(MANOEUVRES)
    out = tmp_path / 'new'
    assert manoeuvre.main(['step_steer', '--friction', '0.7', '--out', str(out)]) == 0
    printed = capsys.readouterr().out
    written = json.loads((out / 'step_steer.json').read_text())
    assert written['friction'] == 0.7
    assert set(written['numbers']) == {line.split()[0] for line in printed.splitlines()}
    assert written['numbers']['yaw_rate_gain']['unit'] == '1/s'
    assert (out / 'step_steer.png').read_bytes().startswith(b'\x89PNG')


def test_manual_names_every_manoeuvre():
    manual = (Path(__file__).parents[2] / 'docs' / 'plant.md').read_text()
    assert all(f'| `{name}` |' in manual for name in MANOEUVRES)


@pytest.mark.parametrize(
    ('arguments', 'line'),
    [
        ([], 'which manoeuvre'),
        (['pirouette'], 'invalid choice'),
        (['step_steer', '--friction', '0'], 'friction is 0.0'),
        (['step_steer', '--friction', 'nan'], 'friction is nan'),
        (['step_steer', '--car', 'none/such.yaml'], 'such.yaml'),
        (['step_steer', '--car', 'nobody.yaml'], 'nobody.yaml'),
    ],
)
def test_command_refuses_what_it_cannot_drive(arguments, line, capsys):
    with pytest.raises(SystemExit) as ended:
        manoeuvre.main(arguments)
    assert ended.value.code != 0
    assert line in capsys.readouterr().err


def test_command_finds_a_car_by_name_and_by_path(tmp_path, capsys):
    inside = parameters.config_file('vw_gti.yaml')
    outside = tmp_path / 'my_car.yaml'
    outside.write_bytes(inside.read_bytes())
    printed = []
    for car in ('vw_gti.yaml', str(outside), 'bmw_545i.yaml'):
        assert manoeuvre.main(['step_steer', '--car', car]) == 0
        printed.append(capsys.readouterr().out)
    by_name, by_path, other = printed
    assert by_name == by_path != other


@pytest.mark.parametrize('name', ['step_steer', 'steady_circle'])
def test_a_car_without_an_engine_is_named_as_such(name, tmp_path, capsys):
    driven = parameters.config_file('vw_gti.yaml').read_text()
    pushed = tmp_path / 'pushed.yaml'
    pushed.write_text(re.sub(r'drive_n: [0-9.e+]+', 'drive_n: 0.0', driven))
    with pytest.raises(SystemExit) as ended:
        manoeuvre.main([name, '--car', str(pushed)])
    assert ended.value.code == 1
    assert 'force.front.drive_n and force.rear.drive_n are 0' in capsys.readouterr().err
