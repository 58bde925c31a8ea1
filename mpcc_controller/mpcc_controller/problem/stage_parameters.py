"""Stage parameters: path, road, obstacles and controller parameters as numbers per stage.

Shared by all formulations. The names of the YAML files end here; SI units and symbols from here on.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.model import stability
from mpcc_controller.model.single_track import BLEND_FROM_MPS, Car, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.reference_path import ReferencePath
from mpcc_controller.path.road_edges import Road
from mpcc_controller.problem import obstacle_motion
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
    obstacles: tuple[PredictedObstacle, ...]  # the discs of which some have a place in the problem
    # (slots, N + 1), which of them is in each of `stages.obstacles` at each stage
    places: np.ndarray


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
        compliance=tyre.compliance_radpn or 0.0,
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


def obstacle_slots(
    params: ControllerParams, frame: DistanceFrame, scene: Scene, x: State, guess: np.ndarray
):
    """Return the discs along the planned states `x` in a frame, which they are, and their places.

    `guess` are those states as an array (N + 1, 9). Where there are more discs than slots and
    obstacles are tracked, the closest ones of each stage count, else those that come closest at any
    stage. Unused slots are filled with an obstacle far away.
    """
    items, most, count = scene.obstacles.items, params.surroundings.max_obstacles, len(guess)
    table = obstacle_motion.stages(items, count, params.model.step_s)
    if len(items) > most and params.tracker.position_m is not None:
        chosen, gaps = items, closest_gaps(guess, items, params)
        places = np.sort(np.argpartition(gaps, most - 1, axis=0)[:most], axis=0)
        table = table[:, places, np.arange(count)]
    else:
        rows = closest_discs(params, items, guess)
        chosen, table = tuple(items[row] for row in rows), table[:, rows]
        places = np.broadcast_to(np.arange(len(rows))[:, None], (len(rows), count))
    slots = tuple(frame.obstacle(scene.path, Disc(*disc), x) for disc in zip(*table))
    return slots + (frame.empty_slot(x),) * (most - len(slots)), chosen, places


def closest_discs(
    params: ControllerParams, items: Sequence[PredictedObstacle], X: np.ndarray
) -> list[int]:
    """Return which discs the states (k, 9) of the stages come closest to, ordered by id."""
    count, rows = params.surroundings.max_obstacles, range(len(items))
    if len(items) > count:
        gaps = np.min(closest_gaps(X, items, params), axis=1)
        rows = np.argsort(gaps, kind='stable')[:count].tolist()
    return sorted(rows, key=lambda row: items[row].id)


@obstacle_motion.once
def closest_gaps(
    X: np.ndarray, items: Sequence[PredictedObstacle], params: ControllerParams
) -> np.ndarray:
    """Return V2O [m] (n, k) of planned states (k, 9) to discs, not to be changed."""
    oX, oY, radius = obstacle_motion.stages(items, len(X), params.model.step_s)
    x = State(*X.T)
    to_X, to_Y, square = oX - x.X, oY - x.Y, np.full(oX.shape, np.inf)
    cos_psi, sin_psi = np.cos(x.psi), np.sin(x.psi)
    for offset in params.body.circle_offsets_m:
        dX, dY = to_X - offset * cos_psi, to_Y - offset * sin_psi
        dX *= dX
        dX += np.square(dY, out=dY)
        np.minimum(square, dX, out=square)
    return np.sqrt(square) - radius - params.body.circle_radius_m


def by_object(parameters: StageParameters, v2o: Sequence[Any], priority: Sequence[Any]):
    """Yield id, least V2O [m] and largest priority (N + 1,) of every obstacle in the problem.

    v2o, priority: of every slot (N + 1,). Where an obstacle has no place V2O is infinite.
    """
    count = len(parameters.places)
    if not count:
        return
    ids = np.array([o.id for o in parameters.obstacles])
    held = ids[parameters.places]
    for key in dict.fromkeys(held.ravel().tolist()):
        D = np.where(held == key, np.array(v2o[:count]), np.inf)
        q = np.where(held == key, np.array(priority[:count]), 0.0)
        yield key, np.min(D, axis=0), np.max(q, axis=0)


def left_out(obstacles: Obstacles, parameters: StageParameters) -> str:
    """Return the ids of obstacles of which not all discs are in the problem, as words, or ''.

    Where the places change from stage to stage those that are in it at no stage.
    """
    chosen, places = parameters.obstacles, parameters.places
    if len(places) == len(obstacles.items):  # every disc has a place
        return ''
    inside = [chosen[k].id for k in np.unique(places)]
    changes = bool(np.any(places != places[:, :1]))
    missing: dict[str, list[str]] = {'wholly': [], 'in part': []}
    for key, count in Counter(o.id for o in obstacles.items).items():
        if key not in inside:
            missing['wholly'].append(str(key))
        elif not changes and count > inside.count(key):
            missing['in part'].append(str(key))
    return ', '.join(f'{", ".join(ids)} {kind}' for kind, ids in missing.items() if ids)


def to_matrix(
    stages,
    obstacles: tuple[PredictedObstacle, ...],
    places: np.ndarray,
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
    return StageParameters(stages, P, obstacles, places)
