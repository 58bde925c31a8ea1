"""Parameters, path, road and obstacles to the numbers of every stage. Boundary names end here.

What is here is the MPCC's, and what it shares with the baseline (`frenet_stages`).
"""

from typing import Any, NamedTuple

import numpy as np

from mpcc_controller.model import tree
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.path import distance, reference, road
from mpcc_controller.path.distance import Disc
from mpcc_controller.problem import measure, mpcc_ocp, ocp
from mpcc_controller.problem.measure import Measure
from mpcc_controller.problem.mpcc_ocp import HeadingWeights, Stage, Weights
from mpcc_controller.problem.ocp import Body, Rules, Safety
from msgs_yaml.conversions import ns_to_s
from msgs_yaml.types import Obstacle, Obstacles

MEASURES = {'cartesian': measure.CARTESIAN, 'path': measure.PATH}


class Scene(NamedTuple):
    """What the controller knows about the world; None where it has not been told yet."""

    path: reference.Path | None
    road: road.Road | None
    obstacles: Obstacles | None


class Numbers(NamedTuple):
    """What one solve is given."""

    stages: Any  # the formulation's numbers of a stage, each leaf (N + 1,)
    P: np.ndarray  # (N + 1, np), the same as a matrix
    obstacles: tuple[Obstacle, ...]  # those in the problem, in the order of `stages.obstacles`


def car(params: ControllerParams, vehicle: CarParams) -> Car:
    """Return the numbers of the prediction model in the paper's symbols."""
    body, tyre = vehicle.car, vehicle.tyre
    chosen = params.model.drive_front_share
    return Car(
        m=body.mass_kg,
        Izz=body.yaw_inertia_kgm2,
        l_f=body.cog_to_front_m,
        l_r=body.cog_to_rear_m,
        h=body.cog_height_m,
        drag=body.drag_n_per_mps2,
        rolling=body.rolling_n,
        lambda_d=vehicle.actuators.drive_front_share if chosen is None else chosen,
        C_f=tyre.front_cornering_npr,
        C_r=tyre.rear_cornering_npr,
        mu_f=tyre.front_friction * params.model.friction,
        mu_r=tyre.rear_friction * params.model.friction,
        tyre_switch=params.model.tyre_switch,
        v_slip=params.model.least_slip_speed_mps,
        force_blend=params.model.force_blend_n,
    )


def weights(params: ControllerParams) -> Weights | HeadingWeights:
    """Return 1 / tolerance^2 per error, and P_k for the distances."""
    tolerances = params.tolerances
    found = Weights(
        con=tolerances.contouring_m**-2,
        lag=tolerances.lag_m**-2 if params.formulation.lag else 0.0,
        vel=tolerances.velocity_mps**-2,
        d_delta=tolerances.steer_rate_radps**-2,
        d_Fx=tolerances.force_rate_nps**-2,
        lambda_b=tolerances.brake_split**-2,
        v2o=params.priorities.obstacle,
        v2e=params.priorities.edge,
        slack=tolerances.slack_m**-2,
    )
    if not params.formulation.heading:
        return found
    return HeadingWeights(*found, dpsi=tolerances.heading_rad**-2)


def safety(params: ControllerParams) -> Safety:
    """Return the safety distances."""
    return Safety(params.safety.obstacle_m, params.safety.edge_m)


def body(params: ControllerParams) -> Body:
    """Return the circles of the vehicle."""
    return Body(params.body.circle_radius_m, tuple(params.body.circle_offsets_m))


def rules(params: ControllerParams) -> Rules:
    """Return how distances are measured and how they count."""
    chosen = params.formulation
    return Rules(MEASURES[chosen.distance], ocp.PRIORITIES[chosen.priority], chosen.heading)


def numbers(params: ControllerParams, vehicle: Car, scene: Scene, guess: np.ndarray) -> Numbers:
    """Return the numbers of every stage around the guessed states `guess` (N + 1, nx)."""
    x = State(*guess.T)
    arcs, v_ref = reference.at(scene.path, x.theta)
    window = params.surroundings.edge_window_m
    track = road.beside_path(scene.road, arcs, window)
    way = rules(params).measure
    discs, chosen = slots(params, way, scene, x)
    stages = Stage(
        car=vehicle,
        weights=weights(params),
        D_sft=safety(params),
        body=body(params),
        path=arcs,
        v_ref=v_ref,
        centre=track.centre,
        half_width=track.half_width,
        edges=way.road(scene.road, arcs, x, window),
        obstacles=discs,
    )
    return gathered(stages, chosen, len(guess))


def slots(params: ControllerParams, way: Measure, scene: Scene, x: State):
    """Return the obstacles of the problem as `way` measures them, and which ones they are."""
    t = params.model.step_s * np.arange(len(x.X))
    chosen = most_dangerous(params, scene.obstacles, x, t)
    moved = (Disc(o.X + o.vX * t, o.Y + o.vY * t, o.r_obs) for o in chosen)
    discs = tuple(way.obstacle(scene.path, disc, x) for disc in moved)
    empty = params.surroundings.max_obstacles - len(discs)
    return discs + (way.nowhere(x),) * empty, chosen


def gathered(stages, chosen: tuple[Obstacle, ...], count: int) -> Numbers:
    """Return the numbers of `count` stages, also as a matrix."""
    columns = [np.broadcast_to(leaf, (count,)) for leaf in tree.leaves(stages)]
    return Numbers(stages, np.column_stack(columns), chosen)


def at_instant(scene: Scene, stamp_ns: int) -> Scene:
    """Return the scene with its obstacles where they will be at `stamp_ns`, going on as they do."""
    if scene.obstacles is None:
        return scene
    t = ns_to_s(stamp_ns - scene.obstacles.stamp_ns)
    items = (o._replace(X=o.X + o.vX * t, Y=o.Y + o.vY * t) for o in scene.obstacles.items)
    return scene._replace(obstacles=Obstacles(stamp_ns, tuple(items)))


def most_dangerous(params, obstacles: Obstacles, x: State, t) -> tuple[Obstacle, ...]:
    """Return the obstacles that the guessed motion comes closest to, ordered by their id."""

    def closest(obstacle):
        moved = Disc(obstacle.X + obstacle.vX * t, obstacle.Y + obstacle.vY * t, obstacle.r_obs)
        return min(
            np.min(distance.v2o(distance.circle(x, offset, params.body.circle_radius_m), moved))
            for offset in params.body.circle_offsets_m
        )

    slots = params.surroundings.max_obstacles
    return tuple(sorted(sorted(obstacles.items, key=closest)[:slots], key=lambda o: o.id))


def size(params: ControllerParams) -> tuple[int, int]:
    """Return the numbers of vehicle circles and of obstacles in the problem."""
    return len(params.body.circle_offsets_m), params.surroundings.max_obstacles


def formula(params: ControllerParams) -> ocp.Formula:
    """Return the MPCC for these parameters, in symbols."""
    return mpcc_ocp.formula(*size(params), rules(params))
