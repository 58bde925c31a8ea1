"""Stage parameters: path, road, obstacles and controller parameters as numbers per stage.

Shared by all formulations. The names of the YAML files end here; SI units and symbols from here on.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.model import stability
from mpcc_controller.model.single_track import BLEND_FROM_MPS, Car, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import distance
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.path.road_edges import Road
from mpcc_controller.problem.distance_frame import DistanceFrame
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.ocp import SafetyDistance
from msgs_yaml.types import Obstacles
from node_runtime import named_vector
from node_runtime.parameters import ParameterError

# the first fields of the parameters of a stage: equal at all stages
CONSTANTS = ('car', 'weights', 'D_sft', 'body', 'envelope', 'least_speed')


class Scene(NamedTuple):
    """The surroundings of the car; None where an input was never set."""

    path: ReferencePath | None
    road: Road | None
    obstacles: Obstacles | None
    # where obstacles will be, from who knows: hypotheses by id
    predictions: Mapping[int, Sequence[Any]] = MappingProxyType({})


class StageParameters(NamedTuple):
    """The parameters of all stages of one problem."""

    stages: Any  # the parameters of a stage as the formulation names them, each leaf (N + 1,)
    P: np.ndarray  # (N + 1, np), the same as a matrix
    # those in the problem, in the order of `stages.obstacles`
    obstacles: tuple[PredictedObstacle, ...]


def car(params: ControllerParams, vehicle: CarParams) -> Car:
    """Return the parameters of the prediction model in the paper's symbols.

    With `model.servo_lag` they have the lags of the actuators, with `model.low_speed` it drives at
    every speed. Raises ParameterError for a car file without the lags.
    """
    body, tyre = vehicle.car, vehicle.tyre
    lambda_d = params.model.drive_front_share
    car = Car(
        m=body.mass_kg,
        Izz=body.yaw_inertia_kgm2,
        l_f=body.cog_to_front_m,
        l_r=body.cog_to_rear_m,
        h=body.cog_height_m,
        drag=body.drag_n_per_mps2,
        rolling=body.rolling_n,
        lambda_d=vehicle.actuators.drive_front_share if lambda_d is None else lambda_d,
        C_f=tyre.front_cornering_npr,
        C_r=tyre.rear_cornering_npr,
        mu_f=tyre.front_friction * params.model.friction,
        mu_r=tyre.rear_friction * params.model.friction,
        tyre_switch=params.model.tyre_switch,
        v_slip=params.model.least_slip_speed_mps,
        force_blend=params.model.force_blend_n,
    )
    if params.model.servo_lag:
        lags = {
            'steer_lag': vehicle.actuators.steer_lag_s,
            'force_lag': vehicle.actuators.force_lag_s,
        }
        for name, value in lags.items():
            if value is None:
                raise ParameterError(
                    f'model.servo_lag: is true, but car_file {params.car_file} does not have '
                    f'actuators.{name}_s; allowed with a file of `identify` that has it'
                )
        car = car._replace(**lags)
    if not params.model.low_speed:
        return car
    dt = params.model.step_s
    kinematic = stability.least_kinematic_speed(car._replace(kinematic_below=BLEND_FROM_MPS), dt)
    if not np.isfinite(kinematic):
        raise ParameterError(
            f'model.step_s: is {dt:g}, with which the prediction is unstable at every speed of the '
            'car of car_file; allowed shorter steps'
        )
    return car._replace(kinematic_below=kinematic)


def constant_numbers(stages) -> np.ndarray:
    """Return the numbers of the constant parameters, the first fields of `stages`."""
    numbers = named_vector.leaves(stages[: len(CONSTANTS)])
    return np.array([value if np.ndim(value) == 0 else value[0] for value in numbers], float)


def obstacle_slots(params: ControllerParams, frame: DistanceFrame, scene: Scene, x: State):
    """Return the obstacles along the planned states `x` in a frame, and which ones they are.

    Unused slots are filled with an obstacle far away.
    """
    t = params.model.step_s * np.arange(len(x.X))
    chosen = closest_obstacles(params, scene.obstacles, x, t)
    discs = (Disc(*o.position(t), grown_radius(params, o, t)) for o in chosen)
    slots = tuple(frame.obstacle(scene.path, disc, x) for disc in discs)
    empty = params.surroundings.max_obstacles - len(slots)
    return slots + (frame.empty_slot(x),) * empty, chosen


def grown_radius(params: ControllerParams, obstacle: PredictedObstacle, t: np.ndarray):
    """Return the radius [m] that an obstacle has in the problem at the times `t` [s] from now.

    That of an obstacle that moves grows by `safety.growth_mps`: the longer the prediction, the
    less is known of where it is. The cost sees a distance that shrinks, as if D_sft grew.
    """
    growth = params.safety.growth_mps
    moves = obstacle.vX != 0 or obstacle.vY != 0
    return obstacle.r_obs + growth * t if growth and moves else obstacle.r_obs


def to_matrix(
    stages,
    obstacles: tuple[PredictedObstacle, ...],
    count: int,
    constants: np.ndarray | None = None,
) -> StageParameters:
    """Return the parameters of `count` stages, also as a matrix.

    constants: `constant_numbers(stages)` where they are known; to collect them takes time.
    """
    if constants is None:
        constants = constant_numbers(stages)
    varying = named_vector.leaves(stages[len(CONSTANTS) :])
    P = np.empty((count, len(constants) + len(varying)))
    P[:, : len(constants)] = constants
    if np.ndim(stages.D_sft.e):  # of every stage, not constant
        P[:, len(stages.car) + len(stages.weights) + SafetyDistance._fields.index('e')] = (
            stages.D_sft.e
        )
    for column, leaf in enumerate(varying, len(constants)):
        P[:, column] = leaf
    return StageParameters(stages, P, obstacles)


def closest_obstacles(params, obstacles: Obstacles, x: State, t) -> tuple[PredictedObstacle, ...]:
    """Return the obstacles that the states `x` at the times `t` come closest to, ordered by id."""

    def smallest_distance(obstacle):
        disc = Disc(*obstacle.position(t), obstacle.r_obs)
        return min(
            np.min(distance.v2o(distance.circle(x, offset, params.body.circle_radius_m), disc))
            for offset in params.body.circle_offsets_m
        )

    count, closest = params.surroundings.max_obstacles, obstacles.items
    if len(closest) > count:
        closest = sorted(closest, key=smallest_distance)[:count]
    return tuple(sorted(closest, key=lambda o: o.id))
