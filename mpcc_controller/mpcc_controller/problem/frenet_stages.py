"""Parameters, path, road and obstacles to the numbers of the baseline's stages. SI units."""

import numpy as np

from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import path_frame, reference
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.path_frame import Place
from mpcc_controller.path.reference import Path
from mpcc_controller.problem import frenet_ocp, measure, ocp, stages
from mpcc_controller.problem.frenet_ocp import PathStage, PathState, PathWeights
from mpcc_controller.problem.stages import Numbers, Scene
from stage_solver.stage_problem import Plan

LEAST_STEP = 1e-3  # m of path in a step, below it the curvature is that of the point


def weights(params: ControllerParams) -> PathWeights:
    """Return 1 / tolerance^2 per error, and P_k for the distances: the MPCC's where it has them."""
    same = stages.weights(params)._asdict()
    shared = {name: same[name] for name in PathWeights._fields if name in same}
    return PathWeights(**{'e': same['con'], 'dpsi': 0.0} | shared)


def numbers(params: ControllerParams, vehicle: Car, scene: Scene, guess: np.ndarray) -> Numbers:
    """Return the numbers of every stage around the guessed states in the map (N + 1, 9)."""
    x = State(*guess.T)
    s = path_frame.refined(scene.path, x.X, x.Y, x.theta).s
    x = x._replace(theta=s)
    arcs, v_ref = reference.at(scene.path, s)
    window = params.surroundings.edge_window_m
    discs, chosen = stages.slots(params, measure.PATH, scene, x)
    found = PathStage(
        car=vehicle,
        weights=weights(params),
        D_sft=stages.safety(params),
        body=stages.body(params),
        kappa=curvatures(arcs),
        v_ref=v_ref,
        edges=measure.PATH.road(scene.road, arcs, x, window),
        obstacles=discs,
    )
    return stages.gathered(found, chosen, len(guess))


def curvatures(arcs: Arc) -> np.ndarray:
    """Return the mean curvature of the path [1/m] over every step between points of it (k,).

    The heading of the frame then turns by as much as the path does along the guess, however the
    curvature changes within a step. The last point keeps its own.
    """
    turned, driven = np.diff(arcs.psi), np.diff(arcs.theta)
    moves = np.abs(driven) > LEAST_STEP
    mean = np.divide(turned, driven, out=np.array(arcs.kappa[:-1]), where=moves)
    return np.append(mean, arcs.kappa[-1])


def entered(plan: Plan, path: Path) -> Plan:
    """Return a plan in the map (N + 1, 9) in path coordinates (N + 1, 8); multipliers are kept."""
    x = State(*plan.X.T)
    place = path_frame.refined(path, x.X, x.Y, x.theta)
    dpsi = x.psi - path_frame.poses(path, place).psi
    turns = np.round(dpsi / (2 * np.pi))
    states = PathState(*place, dpsi - 2 * np.pi * turns, x.vx, x.vy, x.r, x.delta, x.Fx)
    return plan._replace(X=np.column_stack(states))


def left(plan: Plan, path: Path) -> Plan:
    """Return a plan in path coordinates as one in the map, theta its distance along the path."""
    x = PathState(*plan.X.T)
    pose = path_frame.poses(path, Place(x.s, x.e))
    states = State(pose.X, pose.Y, pose.psi + x.dpsi, x.vx, x.vy, x.r, x.s, x.delta, x.Fx)
    return plan._replace(X=np.column_stack(states))


def formula(params: ControllerParams) -> ocp.Formula:
    """Return the baseline for these parameters, in symbols."""
    return frenet_ocp.formula(*stages.size(params), stages.rules(params))
