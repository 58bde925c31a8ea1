"""What the controllers know of the car, from the plant; tyres by quasi-steady circular driving.

    identify --out car.yaml [--car bmw_330i.yaml] [--tyre ./my_tyre.tir] [--friction 0.6]
             [--manoeuvre constant_radius] [--figure car.png]

The file has all that `car_file` of a controller needs: masses and lengths, Fiala tyres, layout and
limits of the actuators. The same plant gives the same file, byte by byte. A bare name of a car or
tyre is a file of config/; a name with a path separator is a path, relative to where you are.
"""

import argparse
import hashlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from node_runtime import parameters as yaml_parameters
from node_runtime.parameters import ROAD_FRICTION
from vehicle_plant import capability, circle, fiala_fit, parameters
from vehicle_plant.circle import AxlePoints, Circle, CircleError
from vehicle_plant.fiala_fit import Fit
from vehicle_plant.parameters import PlantParams

_FILE = """\
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
"""


_WORDS = {
    'constant_speed': '{p.speed_mps:g} m/s, steer increasing by {p.steer_rate_radps:g} rad/s',
    'constant_radius': 'radius {p.radius_m:g} m, speed increasing by {p.acceleration_mps2:g} m/s^2',
}


def identify(
    plant: PlantParams, friction: float, manoeuvre: Circle, options: str = ''
) -> tuple[str, Figure]:
    """Drive, fit, and return the file's text and the figure. Raises CircleError.

    options: those of the command line, to be noted.
    """
    track = circle.drive(plant, friction, manoeuvre)
    points = circle.axles(track, plant)
    fits = tuple(fiala_fit.fit(axle) for axle in points)
    body = plant.car.body
    text = _FILE.format(
        how=_WORDS[manoeuvre.manoeuvre].format(p=manoeuvre),
        points=len(track.rows),
        ay=track.column('acceleration.ay').max(),
        options=f'{options} --friction {friction:g}',
        digest=digest(plant),
        fit_f=fits[0],
        fit_r=fits[1],
        slip_f=_degrees(points[0]).max(),
        slip_r=_degrees(points[1]).max(),
        body=body,
        drag=body.air_density_kgpm3 / 2 * body.drag_area_m2,
        rolling=plant.car.wheel.rolling_resistance * body.mass_kg * body.gravity_mps2,
        act=capability.of(plant.car),
    )
    return text, draw(points, fits)


def digest(plant: PlantParams) -> str:
    """Return a hash of every parameter of the plant."""
    items = sorted(yaml_parameters.flatten(plant).items())
    return hashlib.sha256(repr(items).encode()).hexdigest()


def draw(points: tuple[AxlePoints, AxlePoints], fits: tuple[Fit, Fit]) -> Figure:
    """Return the measured points, the fitted curve and what is between them, of both axles."""
    figure = Figure(figsize=(10, 6), layout='constrained')
    rows = figure.subplots(2, 2, sharex='col', height_ratios=(3, 1))
    for curve, rest, name, axle, fit in zip(*rows, ('front', 'rear'), points, fits):
        fitted = fiala_fit.force(axle, fit.cornering, fit.friction)
        curve.plot(_degrees(axle), axle.Fy / 1e3, '.', label='plant')
        curve.plot(_degrees(axle), fitted / 1e3, label='Fiala')
        curve.set_title(
            f'{name} axle: C = {fit.cornering / 1e3:.1f} kN/rad, mu = {fit.friction:.3f}'
        )
        curve.set_ylabel('lateral force [kN]')
        curve.legend()
        curve.grid()
        rest.plot(_degrees(axle), fitted - axle.Fy, '.')
        rest.set_title(f'Fiala less plant: {fit.residual:.0f} N rms, systematic', fontsize='medium')
        rest.set_xlabel('slip angle [deg], to the right')
        rest.set_ylabel('force [N]')
        rest.grid()
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
    parser = argparse.ArgumentParser(prog='identify', description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True, help='YAML file to write')
    parser.add_argument('--car', help='car file instead of the default car')
    parser.add_argument('--tyre', help='.tir or YAML file instead of the tyre of the car')
    parser.add_argument('--manoeuvre', choices=list(_WORDS), help='instead of constant_speed')
    parser.add_argument('--friction', type=_friction, default=1.0, help='road friction scale')
    parser.add_argument('--figure', type=Path, help='PNG to write, beside the YAML by default')
    options = parser.parse_args(arguments)
    chosen = {name: getattr(options, name) for name in ('car', 'tyre', 'manoeuvre')}
    noted = ''.join(f' --{name} {value}' for name, value in chosen.items() if value)
    try:
        manoeuvre = yaml_parameters.load(Circle, parameters.config('identify.yaml'))
        manoeuvre = replace(manoeuvre, manoeuvre=options.manoeuvre or manoeuvre.manoeuvre)
        plant = parameters.load(parameters.car_file(options.car or parameters.DEFAULT_CAR, '--car'))
        if options.tyre:
            plant = replace(plant, tyre=parameters.tyre(options.tyre, '--tyre'))
        text, figure = identify(plant, options.friction, manoeuvre, noted)
    except (CircleError, ValueError) as error:
        parser.exit(1, f'identify: {error}\n')
    options.out.write_text(text)
    figure.savefig(options.figure or options.out.with_suffix('.png'), metadata={'Software': None})
    return 0


if __name__ == '__main__':
    sys.exit(main())
