"""The double track against the multi-body model of CommonRoad: tables of docs/second_plant.md.

`python bench/second_plant.py [--figure docs/second_plant.png]` prints two tables in Markdown. Both
plants are the same car: vehicle_plant/config/bmw_320i.yaml and commonroad_320i.yaml. With
`--without jumps` (or compliance, camber, joint) the multi-body model lacks that part, and only the
first table is printed.
"""

import argparse
import dataclasses
import time
from itertools import product
from pathlib import Path

import numpy as np
from closed_loops import fixed_weights
from matplotlib.figure import Figure
from tables import markdown

from bags.evaluation import metrics
from experiments import simulation
from vehicle_plant import manoeuvres, parameters
from vehicle_plant.manoeuvres import Case, Driven
from vehicle_plant.multi_body import equations

PLANTS = {'double track': 'bmw_320i.yaml', 'multi-body': 'commonroad_320i.yaml'}
CAR_FILE = 'car_commonroad_320i.yaml'
KPH = 3.6  # km/h per m/s
# by manoeuvre its numbers, what to call them, decimals
NUMBERS = {
    'steady_circle': (
        ('understeer_gradient', 'understeer gradient [rad/(m/s²)]', 5),
        ('greatest_ay', 'greatest lateral acceleration [m/s²]', 2),
        ('roll_gradient', 'roll gradient [rad/(m/s²)]', 4),
    ),
    'step_steer': (
        ('yaw_rate_gain', 'yaw rate over steer [1/s]', 2),
        ('yaw_rate_response_time', 'step: yaw-rate response [s]', 3),
        ('ay_response_time', 'step: lateral-acceleration response [s]', 3),
    ),
    'sine_sweep': (
        ('gain_1_hz', 'sine of 1 Hz: gain [1/s]', 2),
        ('phase_1_hz', 'sine of 1 Hz: phase [rad]', 3),
    ),
    'straight_braking': (('full_braking_distance', 'braking distance, full brakes [m]', 2),),
    'turn_braking': (
        ('yaw_rate_ratio_at_2', 'yaw-rate ratio, 2 m/s² in a turn', 2),
        ('yaw_rate_ratio_at_4', 'the same, 4 m/s²', 2),
    ),
    'sine_with_dwell': (
        ('displacement_at_3', 'sine with dwell, 3: displacement [m]', 2),
        ('passed_up_to', 'sine with dwell: passed up to', 1),
    ),
}
SLIDING_DEG = 4.6  # of steer on the circle: beyond, the cars spin
SPEEDS_KPH = (60.0, 75.0, 90.0)
CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')


# parameters of the model without a part of it; `tire` holds those of its tyre
WITHOUT = {
    'jumps': {'tire': {'p_hy1': 0.0, 'p_vy1': 0.0}},  # side force by the sign of the camber
    'compliance': {'K_lt': 0.0},  # lateral, of tyre and wheel
    'camber': {'D_f': 0.0, 'D_r': 0.0},  # by spring travel: the wheels lean with the body
    'joint': {'K_ras': 4 * 175186.659},  # compliance between body and axle: a quarter of it
}


def perform() -> dict[str, dict[str, Driven]]:
    """Return the manoeuvres by name and plant."""
    settings = manoeuvres.load_settings()
    plants = {name: parameters.load(parameters.config_file(car)) for name, car in PLANTS.items()}
    cases = {name: Case(plant, 1.0, settings) for name, plant in plants.items()}
    return {
        name: {plant: manoeuvres.perform(name, case) for plant, case in cases.items()}
        for name in NUMBERS
    }


def manoeuvre_table(driven: dict[str, dict[str, Driven]]) -> str:
    """Return the numbers of both plants."""
    rows = []
    for name, numbers in NUMBERS.items():
        for key, label, decimals in numbers:
            values = (driven[name][plant].numbers[key].value for plant in PLANTS)
            rows.append((label, *(f'{value:.{decimals}f}' for value in values)))
    return markdown('Manoeuvres', ('number', *PLANTS), rows)


def closed_loop_table() -> str:
    """Return what the controllers come to in the double lane change on both plants."""
    rows = []
    for speed, controller, (plant, car) in product(SPEEDS_KPH, CONTROLLERS, PLANTS.items()):
        own = fixed_weights(controller) | {'car_file': CAR_FILE}
        values = {'plant': {'plant_params': car}, 'controller': own}
        setup = simulation.prepare('double_lane_change', controller, values, speed / KPH)
        begin = time.process_time()
        drive = simulation.drive(setup)
        cpu_s = time.process_time() - begin
        found = metrics.compute_metrics(drive)
        peaks = found['peak_sideslip_deg'], found['peak_lat_acc_mps2']
        gaps = found['min_v2o_m'], max(-found['min_v2e_m'], 0.0)
        texts = [*(f'{peak:.1f}' for peak in peaks), *(f'{x:.2f}' for x in (*gaps, cpu_s))]
        rows.append((f'{speed:g}, `{controller}`', plant, *texts))
    columns = ('speed, controller', 'plant', 'sideslip [deg]', 'lateral [m/s²]', 'obstacles [m]')
    return markdown('Closed loops', (*columns, 'off the road [m]', 'CPU [s]'), rows)


def draw(driven: dict[str, dict[str, Driven]]) -> Figure:
    """Return both plants in four manoeuvres."""
    figure = Figure(figsize=(11, 7), layout='constrained')
    (circle, step), (braking, dwell) = figure.subplots(2, 2)
    for plant in PLANTS:
        (track,) = driven['steady_circle'][plant].tracks
        steer = np.degrees(track.column('servos.steer.position'))
        circle.plot(steer, track.column('acceleration.ay'), label=plant)
        (track,) = driven['step_steer'][plant].tracks
        t = manoeuvres.times(track) - 1.0
        (line,) = step.plot(t, np.degrees(track.column('planar.r')), label=f'{plant}: yaw rate')
        colour, ay = line.get_color(), 2 * track.column('acceleration.ay')
        step.plot(t, ay, '--', color=colour, label='2 x lateral acceleration')
        track = driven['turn_braking'][plant].tracks[-3]
        braking.plot(manoeuvres.times(track), np.degrees(track.column('planar.r')), label=plant)
        runs = driven['sine_with_dwell'][plant]
        for amplitude, style in ((3, '-'), (6, '--')):
            track = runs.tracks[amplitude]
            label, r = f'{plant}: {runs.runs[amplitude].label}', track.column('planar.r')
            dwell.plot(manoeuvres.times(track), np.degrees(r), style, color=colour, label=label)
    step.set_xlim(-0.2, 2.0)
    circle.set_xlim(0.0, SLIDING_DEG)
    circle.set_ylim(0.0, None)
    circle.set(ylabel='lateral acceleration [m/s²]', xlabel='steer [deg]')
    step.set(ylabel='yaw rate [deg/s]', xlabel='time since the step [s]')
    braking.set(ylabel='yaw rate [deg/s]', xlabel='brakes of 4 m/s² in a turn: time [s]')
    dwell.set(ylabel='yaw rate [deg/s]', xlabel='sine with dwell: time [s]')
    for axes in figure.axes:
        axes.grid()
        axes.legend()
    return figure


def leave_out(part: str) -> None:
    """Take a part out of the multi-body model, in this process and before it is driven."""
    changes = dict(WITHOUT[part])
    vehicle = equations.vehicle()
    tire = dataclasses.replace(vehicle.tire, **changes.pop('tire', {}))
    changed = dataclasses.replace(vehicle, tire=tire, **changes)
    equations.vehicle = lambda: changed


def main() -> None:
    """Print the tables; draw the figure if asked."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--figure', type=Path, help='PNG to write')
    parser.add_argument('--without', choices=WITHOUT, help='part that the multi-body model lacks')
    options = parser.parse_args()
    if options.without:
        leave_out(options.without)
    driven = perform()
    print(manoeuvre_table(driven))
    if options.figure:
        draw(driven).savefig(options.figure, dpi=90, metadata={'Software': None})
    if not options.without:
        print(closed_loop_table())


if __name__ == '__main__':
    main()
