"""Parameters, path, road and obstacles to the numbers of every stage. Boundary names end here."""

from typing import NamedTuple

import numpy as np

from mpcc_controller import distance, mpcc_ocp, reference, road, tree
from mpcc_controller.distance import Disc
from mpcc_controller.mpcc_ocp import Body, Safety, Stage, Weights
from mpcc_controller.parameters import CarParams, ControllerParams
from mpcc_controller.single_track import Car, State
from msgs_yaml.stamp import seconds
from msgs_yaml.types import Obstacle, Obstacles

EMPTY_SLOT = 1e4  # m beside the plan: an obstacle there has no priority, wherever the plan goes


class Scene(NamedTuple):
    """What the controller knows about the world; None where it has not been told yet."""

    path: reference.Path | None
    road: road.Road | None
    obstacles: Obstacles | None


class Numbers(NamedTuple):
    """What one solve is given."""

    stages: Stage  # each leaf (N + 1,)
    P: np.ndarray  # (N + 1, np), the same as a matrix
    obstacles: tuple[Obstacle, ...]  # those in the problem, in the order of `stages.obstacles`


def car(params: ControllerParams, vehicle: CarParams) -> Car:
    """Return the numbers of the prediction model in the paper's symbols."""
    body, tyre = vehicle.car, vehicle.tyre
    return Car(
        m=body.mass_kg,
        Izz=body.yaw_inertia_kgm2,
        l_f=body.cog_to_front_m,
        l_r=body.cog_to_rear_m,
        h=body.cog_height_m,
        drag=body.drag_n_per_mps2,
        rolling=body.rolling_n,
        lambda_d=params.model.drive_front_share,
        C_f=tyre.front_cornering_npr,
        C_r=tyre.rear_cornering_npr,
        mu_f=tyre.front_friction * params.model.friction,
        mu_r=tyre.rear_friction * params.model.friction,
        tyre_switch=params.model.tyre_switch,
        v_slip=params.model.least_slip_speed_mps,
        force_blend=params.model.force_blend_n,
    )


def weights(params: ControllerParams) -> Weights:
    """Return 1 / tolerance^2 per error, and P_k for the distances."""
    tolerances = params.tolerances
    return Weights(
        con=tolerances.contouring_m**-2,
        lag=tolerances.lag_m**-2,
        vel=tolerances.velocity_mps**-2,
        d_delta=tolerances.steer_rate_radps**-2,
        d_Fx=tolerances.force_rate_nps**-2,
        lambda_b=tolerances.brake_split**-2,
        v2o=params.priorities.obstacle,
        v2e=params.priorities.edge,
        slack=tolerances.slack_m**-2,
    )


def numbers(params: ControllerParams, vehicle: Car, scene: Scene, guess: np.ndarray) -> Numbers:
    """Return the numbers of every stage around the guessed states `guess` (N + 1, nx)."""
    x = State(*guess.T)
    arcs, v_ref = reference.at(scene.path, x.theta)
    window = params.surroundings.edge_window_m
    track = road.beside_path(scene.road, arcs, window)
    t = params.model.step_s * np.arange(len(guess))
    chosen = most_dangerous(params, scene.obstacles, x, t)
    slots = params.surroundings.max_obstacles
    discs = [Disc(o.X + o.vX * t, o.Y + o.vY * t, o.r_obs) for o in chosen]
    beyond = Disc(x.X, x.Y + EMPTY_SLOT, 0.0)
    stages = Stage(
        car=vehicle,
        weights=weights(params),
        D_sft=Safety(params.safety.obstacle_m, params.safety.edge_m),
        body=Body(params.body.circle_radius_m, tuple(params.body.circle_offsets_m)),
        path=arcs,
        v_ref=v_ref,
        centre=track.centre,
        half_width=track.half_width,
        edges=road.near_plan(scene.road, x.X, x.Y, window),
        obstacles=tuple(discs) + (beyond,) * (slots - len(discs)),
    )
    columns = [np.broadcast_to(leaf, t.shape) for leaf in tree.leaves(stages)]
    return Numbers(stages, np.column_stack(columns), chosen)


def at_instant(scene: Scene, stamp_ns: int) -> Scene:
    """Return the scene with its obstacles where they will be at `stamp_ns`, going on as they do."""
    if scene.obstacles is None:
        return scene
    t = seconds(stamp_ns - scene.obstacles.stamp_ns)
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


def shape(params: ControllerParams) -> Stage:
    """Return the template of the stage numbers for these parameters."""
    return mpcc_ocp.template(len(params.body.circle_offsets_m), params.surroundings.max_obstacles)
