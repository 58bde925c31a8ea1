"""Identify the parameters of the controllers' car from the plant; tyres by circular driving.

    identify --out my_car.yaml [--car bmw_330i.yaml] [--tyre ./my_tyre.tir] [--friction 0.6]
             [--manoeuvre constant_radius] [--figure car.png]
    identify --log FILE... --map MAP --out my_car.yaml    from recorded driving

The file has all that `car_file` of a controller needs: masses and lengths, Fiala tyres, layout,
limits and lags of the actuators, outline. Its values are printed, beside those of the file that it
replaces, and so is the command that drives with them. The same plant gives the same file, byte by
byte. A bare name of a car or tyre is a file of config/; a name with a path separator is a path
relative to the working directory.

Per axle the Fiala brush tyre is fitted by least squares:
Fy = -C z + C^2 / (3 Fm) |z| z - C^3 / (27 Fm^2) z^3 with z = tan(alpha) up to sliding at
|z| = 3 Fm / C, then -Fm sign(z); Fm = sqrt((mu Fz)^2 - Fx^2) is the lateral force that the friction
circle leaves (Pacejka 2012, 3.2; Hindiyeh 2013, 2.2). The plant and the prediction model share no
code, so the formula is implemented here, too.
"""

import argparse
import hashlib
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from msgs_yaml.types import Command
from node_runtime import parameters as yaml_parameters
from node_runtime.parameters import ROAD_FRICTION
from vehicle_plant import car, circular_driving, parameters
from vehicle_plant.circular_driving import AxlePoints, CircleError, CircleParams
from vehicle_plant.initial_state import Start
from vehicle_plant.parameters import PlantParams
from vehicle_plant.simulator import TICK_NS, TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NORMAL_95 = 1.959964
# ramps of set-points that no tyre and no rate limits, straight ahead at a speed that they keep
_SPEED_MPS = 20.0
_STEER_RATE_RADPS, _FORCE_RATE_NPS = 0.02, -2000.0  # the force is that of both axles
_RAMP_TICKS = 24  # 1.2 s, tens of time constants of a servo
_SETTLED_TICKS = 4  # over which a lag is averaged


class FialaFit(NamedTuple):
    """Parameters of one axle, half widths of their 95 % confidence intervals, residual."""

    cornering: float  # N/rad
    friction: float  # -
    cornering_confidence: float  # N/rad
    friction_confidence: float  # -
    residual: float  # N, root mean square


def fiala_force(points: AxlePoints, cornering: float, friction: float) -> np.ndarray:
    """Return the lateral force of a Fiala axle [N] at slip, Fx and Fz of the points, (n,)."""
    z = np.tan(points.alpha)
    lateral_limit = np.sqrt(np.maximum((friction * points.Fz) ** 2 - points.Fx**2, 1.0))
    q = np.minimum(np.abs(z) * cornering / (3 * lateral_limit), 1)
    return -np.sign(z) * lateral_limit * (3 * q - 3 * q**2 + q**3)


def fit_fiala(points: AxlePoints) -> FialaFit:
    """Return the unweighted least-squares fit to n >= 3 points of one axle."""
    # half a second, which the help must not take
    from scipy.optimize import curve_fit

    load = points.Fz.mean()

    def scaled_force(_, stiffness, friction):
        # both parameters of order one: stiffness per load, friction
        return fiala_force(points, stiffness * load, friction) / load

    stiffness_per_load = 20.0  # 1/rad, a usual road tyre; the fit does not depend on it
    guess, bounds = [stiffness_per_load, 1.0], ([1.0, 0.01], [200.0, 3.0])
    wanted, options = points.Fy / load, {'xtol': 1e-14, 'full_output': True}
    (stiffness, friction), covariance, results, *_ = curve_fit(
        scaled_force, points.alpha, wanted, guess, bounds=bounds, **options
    )
    confidence = _NORMAL_95 * np.sqrt(np.diag(covariance))
    return FialaFit(
        cornering=float(stiffness * load),
        friction=float(friction),
        cornering_confidence=float(confidence[0] * load),
        friction_confidence=float(confidence[1]),
        residual=float(np.sqrt(np.mean(results['fvec'] ** 2)) * load),
    )


def servo_lags(plant: PlantParams, friction: float) -> tuple[float, float]:
    """Return how long [s] steering and total force are behind ramps of their set-points.

    A delay is part of the lag; that of the second-order servo is 2 zeta / omega. Raises
    RefusedError.
    """
    lags = []
    for steer_rate, force_rate in ((_STEER_RATE_RADPS, 0.0), (0.0, _FORCE_RATE_NPS)):
        simulator = Simulator(plant, friction, Start(0.0, 0.0, 0.0, _SPEED_MPS))
        tracks = [simulator.now]
        for tick in range(1, _RAMP_TICKS + 1):
            t = tick * TICK_NS / 1e9
            steer, force = steer_rate * t, force_rate * t / 2
            command = Command(simulator.stamp_ns, steer, steer_rate, force, force)
            tracks.append(simulator.follow(command))
        track = join_trajectories(tracks)
        steer, front, rear = (
            track.column(f'servos.{name}.position') for name in ('steer', 'front', 'rear')
        )
        # when the ramp had the present value
        reached_s = steer / steer_rate if steer_rate else (front + rear) / force_rate
        behind = (track.stamp_ns - track.stamp_ns[0]) / 1e9 - reached_s
        lags.append(float(np.mean(behind[-_SETTLED_TICKS * TICK_STEPS :])))
    return tuple(lags)


_TEMPLATE = """\
# Car, tyre and actuators as the controllers know them. Tyres by quasi-steady circular driving:
# {how}, {points} points up to {ay:.3f} m/s^2.
# Do not edit; made by
#   python -m vehicle_plant.identify{options} --out <this file>
# plant parameters: sha256 {digest}
# The intervals (95 %) take residuals for independent. They are systematic: load transfer, camber,
# the shape of the tyre are not those of a Fiala tyre. The true uncertainty is larger.
# front axle: +- {fit_f.cornering_confidence:.0f} N/rad, +- {fit_f.friction_confidence:.5f}, \
residual {fit_f.residual:.0f} N rms, slip up to {slip_f:.1f} deg
# rear axle: +- {fit_r.cornering_confidence:.0f} N/rad, +- {fit_r.friction_confidence:.5f}, \
residual {fit_r.residual:.0f} N rms, slip up to {slip_r:.1f} deg
/**:
  ros__parameters:
    car:
      mass_kg: {body.mass_kg!r}  # kg
      yaw_inertia_kgm2: {body.yaw_inertia_kgm2!r}  # kg m^2
      cog_to_front_m: {body.cog_to_front_m!r}  # m
      cog_to_rear_m: {body.cog_to_rear_m!r}  # m
      cog_height_m: {body.cog_height_m!r}  # m
      drag_n_per_mps2: {drag:.4f}  # N/(m/s)^2, half the air density times the drag area
      rolling_n: {rolling:.2f}  # N, rolling resistance
    tyre:
      front_cornering_npr: {fit_f.cornering:.1f}  # N/rad per axle
      rear_cornering_npr: {fit_r.cornering:.1f}  # N/rad per axle
      front_friction: {fit_f.friction:.5f}  # -
      rear_friction: {fit_r.friction:.5f}  # -
    actuators:  # the controller's limits are cut to these
      drive_front_share: {act.drive_front_share!r}  # -, 0 = rear-wheel drive
      steer_rad: {act.steer_rad!r}  # rad at the road wheel, either way
      steer_rate_radps: {act.steer_rate_radps!r}  # rad/s
      brake_n: {act.brake_n!r}  # N, both axles
      drive_n: {act.drive_n!r}  # N, both axles
      force_rate_nps: {act.force_rate_nps!r}  # N/s, of the slower axle
      steer_lag_s: {lags[0]:.4f}  # s, behind a set-point that moves at a constant rate
      force_lag_s: {lags[1]:.4f}  # s, the same of the total force while braking
    outline:  # seen from above
      front_m: {front:.3f}  # m, CoG to the front end
      rear_m: {rear:.3f}  # m, CoG to the rear end
      width_m: {outline.width_m!r}  # m
"""


_MANOEUVRES = {
    'constant_speed': '{p.speed_mps:g} m/s, steer increasing by {p.steer_rate_radps:g} rad/s',
    'constant_radius': 'radius {p.radius_m:g} m, speed increasing by {p.acceleration_mps2:g} m/s^2',
}


def identify(
    plant: PlantParams, friction: float, manoeuvre: CircleParams, options: str = ''
) -> tuple[str, Callable[[], 'Figure']]:
    """Drive, fit, and return the text of the file, and what draws the figure.

    Raises CircleError and RefusedError for a car that cannot drive the manoeuvres.

    options: those of the command line, recorded in the file.
    """
    trajectory = circular_driving.drive(plant, friction, manoeuvre)
    points = circular_driving.axle_points(trajectory, plant)
    fits = tuple(fit_fiala(axle) for axle in points)
    body, outline = plant.car.body, plant.car.outline
    text = _TEMPLATE.format(
        how=_MANOEUVRES[manoeuvre.manoeuvre].format(p=manoeuvre),
        points=len(trajectory.rows),
        ay=trajectory.column('acceleration.ay').max(),
        options=f'{options} --friction {friction:g}',
        digest=digest(plant),
        fit_f=fits[0],
        fit_r=fits[1],
        slip_f=_degrees(points[0]).max(),
        slip_r=_degrees(points[1]).max(),
        body=body,
        drag=body.air_density_kgpm3 / 2 * body.drag_area_m2,
        rolling=plant.car.wheel.rolling_resistance * body.mass_kg * body.gravity_mps2,
        act=car.actuator_limits(plant.car),
        lags=servo_lags(plant, friction),
        front=body.cog_to_front_m + outline.front_overhang_m,
        rear=body.cog_to_rear_m + outline.rear_overhang_m,
        outline=outline,
    )
    return text, partial(draw, points, fits)


def digest(plant: PlantParams) -> str:
    """Return a hash of every parameter of the plant; and of its model, if not the double track."""
    items = sorted(yaml_parameters.flatten(plant).items())
    if isinstance(plant, car.MultiBodyParams):
        items.append(('model', parameters.MULTI_BODY))
    return hashlib.sha256(repr(items).encode()).hexdigest()


def draw(points: tuple[AxlePoints, AxlePoints], fits: tuple[FialaFit, FialaFit]) -> 'Figure':
    """Return the measured points, the fitted curves and the residuals of both axles."""
    # likewise
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6), layout='constrained')
    rows = figure.subplots(2, 2, sharex='col', height_ratios=(3, 1))
    for curve, residual, name, axle, fit in zip(*rows, ('front', 'rear'), points, fits):
        fitted = fiala_force(axle, fit.cornering, fit.friction)
        curve.plot(_degrees(axle), axle.Fy / 1e3, '.', label='plant')
        curve.plot(_degrees(axle), fitted / 1e3, label='Fiala')
        curve.set_title(
            f'{name} axle: C = {fit.cornering / 1e3:.1f} kN/rad, mu = {fit.friction:.3f}'
        )
        curve.set_ylabel('lateral force [kN]')
        curve.legend()
        curve.grid()
        residual.plot(_degrees(axle), fitted - axle.Fy, '.')
        title = f'Fiala less plant: {fit.residual:.0f} N rms, systematic'
        residual.set_title(title, fontsize='medium')
        residual.set_xlabel('slip angle [deg], to the right')
        residual.set_ylabel('force [N]')
        residual.grid()
    return figure


def _degrees(axle: AxlePoints):
    return -axle.alpha * 180 / np.pi


def _friction(text: str) -> float:
    allowed, value = ROAD_FRICTION, float(text)
    if not allowed.low <= value <= allowed.high:
        raise argparse.ArgumentTypeError(f'is {text}; allowed {allowed.low:g} to {allowed.high:g}')
    return value


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    words = sys.argv[1:] if arguments is None else arguments
    if '--log' in words:
        # recordings and the prediction model are seen by the package experiments alone
        given = [word for word in words if word != '--log']
        return subprocess.call([sys.executable, '-m', 'experiments.cli', 'identify', *given])
    parser = argparse.ArgumentParser(prog='identify', description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True, help='YAML file to write')
    parser.add_argument('--car', help='car file instead of the default car')
    parser.add_argument('--tyre', help='.tir or YAML file instead of the tyre of the car')
    parser.add_argument('--manoeuvre', choices=list(_MANOEUVRES), help='instead of constant_speed')
    parser.add_argument('--friction', type=_friction, default=1.0, help='road friction scale')
    parser.add_argument('--figure', type=Path, help='PNG to write, beside the YAML by default')
    options = parser.parse_args(arguments)
    values = {name: getattr(options, name) for name in ('car', 'tyre', 'manoeuvre')}
    recorded = ''.join(f' --{name} {value}' for name, value in values.items() if value)
    try:
        manoeuvre = yaml_parameters.load(CircleParams, parameters.config_file('identify.yaml'))
        manoeuvre = replace(manoeuvre, manoeuvre=options.manoeuvre or manoeuvre.manoeuvre)
        plant = parameters.load(parameters.car_file(options.car or parameters.DEFAULT_CAR, '--car'))
        if options.tyre:
            plant = replace(plant, tyre=parameters.load_tyre(options.tyre, '--tyre'))
        text, draw_figure = identify(plant, options.friction, manoeuvre, recorded)
    except (CircleError, ValueError) as error:
        parser.exit(1, f'identify: {error}\n')
    try:
        before = yaml_parameters.read_file(options.out).values
    except (yaml_parameters.ParameterError, OSError):
        before = {}
    options.out.write_text(text)
    picture = options.figure or options.out.with_suffix('.png')
    draw_figure().savefig(picture, metadata={'Software': None})
    print(_describe_result(options.out, before))
    print(f'\nHow well the tyres fit: {picture}')
    settings = {'plant.plant_params': options.car, 'plant.tyre_set': options.tyre}
    # a bare name would be a file of the package
    out = options.out if os.sep in str(options.out) else f'.{os.sep}{options.out}'
    settings['controller.car_file'] = out
    given = (f'--set {shlex.quote(f"{name}={v}")}' for name, v in settings.items() if v)
    print(f'Drive with it:\n  experiments run double_lane_change {" ".join(given)}')
    return 0


def _describe_result(path: Path, before: dict) -> str:
    """Return the values of a car file as a table, beside those that it had before, {} for none."""
    file = yaml_parameters.read_file(path)

    def text(value):
        if value is None:
            return '-'
        # an earlier file may hold anything
        return f'{value:.6g}' if isinstance(value, int | float) else str(value)

    rows = [(path.name, 'value', *(('before',) if before else ()), 'unit, meaning')]
    for name, value in file.values.items():
        earlier = (text(before.get(name)),) if before else ()
        rows.append((name, text(value), *earlier, file.comments.get(name, '')))
    widths = [max(map(len, column)) for column in zip(*rows)]
    lines = []
    for name, *numbers, meaning in rows:
        cells = [text.rjust(width) for text, width in zip(numbers, widths[1:])]
        lines.append('  '.join((name.ljust(widths[0]), *cells, meaning)).rstrip())
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
