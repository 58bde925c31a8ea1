"""Active priorities and limits of plans: how demanding is a set of problems?"""

import numpy as np
from problems import Problems

from mpcc_controller.model.single_track import Input, State
from mpcc_controller.problem import mpcc_formulation
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from stage_solver.stage_problem import Plan, StageProblem

NEAR = 1e-3  # a limit nearer than this share of its scale is active
DEMANDING = ('obstacle', 'edge', 'friction')
ACTUATORS = ('delta', 'Fx', 'd_delta', 'd_Fx', 'lambda_b')
KINDS = (*DEMANDING, 'track', 'speed', 'actuator')


def find_active(problem: StageProblem, problems: Problems, circles: int, obstacles: int) -> dict:
    """Return a mask (n,) per kind: active at one stage of the driven plan, or more."""
    insight = PlanEvaluator(mpcc_formulation.symbolic_ocp(circles, obstacles))
    active_kinds = [
        _find_active_kinds(problem, insight, problems, k) for k in range(len(problems.x0))
    ]
    return {kind: np.array([kind in active for active in active_kinds]) for kind in KINDS}


def demanding(active: dict) -> np.ndarray:
    """Return the mask (n,) of the problems with an active obstacle, edge or friction limit."""
    return np.any([active[kind] for kind in DEMANDING], axis=0)


def _find_active_kinds(problem, insight, problems, k):
    plan, P = Plan(problems.driven_X[k], problems.driven_U[k]), problems.P[k]
    terms = insight.evaluate(plan, P).costs
    active = {kind for kind, term in (('obstacle', terms.v2o), ('edge', terms.v2e)) if term.any()}
    bounds = problems.bounds_of(k)
    g = problem.constraints(plan.X[:-1].T, plan.U.T, P[:-1].T).full()
    front, rear, *track = (
        _reached(*row, 1) for row in zip(g, bounds.g_low.T, bounds.g_high.T, strict=True)
    )
    if front or rear:
        active.add('friction')
    if any(track):
        active.add('track')
    if terms.slow.any():
        active.add('speed')
    x_low, x_high = State(*bounds.x_low[1:].T), State(*bounds.x_high[1:].T)
    u_low, u_high = Input(*bounds.u_low.T), Input(*bounds.u_high.T)
    values = State(*plan.X[1:].T)._asdict() | Input(*plan.U.T)._asdict()
    lows, highs = x_low._asdict() | u_low._asdict(), x_high._asdict() | u_high._asdict()
    scale = dict(zip(problem.states, problem.scale_x)) | dict(zip(problem.inputs, problem.scale_u))
    if any(_reached(values[n], lows[n], highs[n], scale[n]) for n in ACTUATORS):
        active.add('actuator')
    return active


def _reached(values, low, high, scale):
    return bool(np.any((values - low < NEAR * scale) | (high - values < NEAR * scale)))
