"""The controllers that drive a setting, as parameters over files of mpcc_controller/config.

All have the setting's car file, believed friction, safety distances, vehicle circles and priorities
P_k; what they do not share is what they are compared for:

mpcc             the paper's MPCC
mpcc_no_ca       the same without collision avoidance
frenet_matched   the baseline with the MPCC's tolerances
frenet_lineage   the baseline with tolerances, circles and brake split of its lineage's open code
frenet_tuned     the baseline with parameters that were searched for
factorial:*      the MPCC with every combination of the five FACTORS, a digit each: 0 as the MPCC
                 has it, 1 as the baseline has it
"""

from collections.abc import Mapping
from itertools import product
from typing import Any, NamedTuple

from experiments.settings import setting as settings
from experiments.settings.plan import Plan
from experiments.settings.setting import Setting
from mpcc_controller.parameters import FREE

MPCC, NO_CA = 'mpcc', 'mpcc_no_ca'
MATCHED, LINEAGE, TUNED = 'frenet_matched', 'frenet_lineage', 'frenet_tuned'
BASELINES = (MATCHED, LINEAGE, TUNED)
FACTORIAL = 'factorial:'
FACTORS = ('frame', 'lag', 'shape', 'size', 'heading')
COMBINATIONS = tuple(FACTORIAL + ''.join(bits) for bits in product('01', repeat=len(FACTORS)))
NO_PARAMETERS: Mapping[str, Any] = {}
NO_COST = 1e3  # a tolerance that a share cannot come near


class Arm(NamedTuple):
    """One controller in one setting."""

    controller: str  # file in config/
    settings: Mapping[str, Any]  # parameters by dotted name


def build(
    plan: Plan,
    setting: Setting,
    name: str,
    tuned: Mapping[str, Any] = NO_PARAMETERS,
) -> Arm:
    """Return the controller of a name in a setting; `tuned` are the parameters of TUNED."""
    values = setting.values
    common = {
        'car_file': setting.plant.car_file,
        'model.friction': 1.0 + values['friction_error'],
        'safety.obstacle_m': values['safety_obstacle_m'],
        'safety.edge_m': values['safety_edge_m'],
        'priorities.obstacle': values['priority_obstacle'],
        'priorities.edge': values['priority_edge_ratio'] * values['priority_obstacle'],
        'tolerances.contouring_m': values['contouring_tolerance_m'],
        'tolerances.lag_m': values['lag_tolerance_m'],
        'tolerances.velocity_mps': values['velocity_tolerance_mps'],
        'tolerances.steer_rate_radps': values['steer_rate_tolerance_radps'],
        'tolerances.force_rate_nps': values['force_rate_tolerance_nps'],
        'tolerances.heading_rad': values['heading_tolerance_rad'],
        **_circles(setting.radius, setting.offsets),
        **_split(values['brake_split'], plan),
        'surroundings.arcs': values['arcs'],
    }
    theta = {'model.theta': values['theta']}  # the baseline begins where the car is on the path
    if name == MPCC:
        return Arm('mpcc', common | theta)
    if name == NO_CA:
        none = {'priorities.obstacle': 0.0, 'priorities.edge': 0.0}
        return Arm('mpcc_no_ca', common | theta | none)
    if name.startswith(FACTORIAL):
        return Arm('mpcc', common | theta | _factors(name, common, plan))
    common['formulation.heading'] = values['heading']
    if name == LINEAGE:
        common |= _lineage(plan, setting) | {'formulation.heading': True}
    if name == TUNED:
        common |= tuned
    return Arm('frenet', common)


def _circles(radius, offsets):
    return {'body.circle_radius_m': radius, 'body.circle_offsets_m': list(offsets)}


def _split(kind, plan):
    """Return the bounds of the front share of braking, equal where it is fixed.

    A fixed share has no cost. Unlike `formulation.brake_split` this compiles no further problem.
    """
    if kind == FREE:
        return {}
    share = plan.arms.fixed_brake_front_share
    bounds = {f'limits.brake_front_share_{end}': share for end in ('min', 'max')}
    return bounds | {'tolerances.brake_split': NO_COST}


def _factors(name, common, plan):
    """Return the parameters of a combination of the factorial."""
    path, no_lag, step, small, heading = (bit == '1' for bit in name.removeprefix(FACTORIAL))
    size = plan.arms.smaller_priority if small else 1.0
    priorities = ('priorities.obstacle', 'priorities.edge')
    return {
        'formulation.distance': 'path' if path else 'cartesian',
        'formulation.lag': not no_lag,
        'formulation.priority': 'step' if step else 'gaussian',
        'formulation.heading': heading,
        **{priority: size * common[priority] for priority in priorities},
    }


def _lineage(plan, setting):
    published = plan.arms.lineage
    circles = settings.vehicle_circles(published.circles, setting.plant, plan.circles)
    return {
        'tolerances.contouring_m': published.contouring_m,
        'tolerances.velocity_mps': published.velocity_mps,
        'tolerances.heading_rad': published.heading_rad,
        'tolerances.steer_rate_radps': published.steer_rate_radps,
        'tolerances.force_rate_nps': published.force_rate_nps,
        **_circles(*circles),
        **_split(published.brake_split, plan),
    }
