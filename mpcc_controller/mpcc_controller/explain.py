"""Everything one tick has to say about itself, as the values of /controller/why."""

import numpy as np

from mpcc_controller import single_track
from mpcc_controller.insight import View
from mpcc_controller.ladder import BRAKING, Decision
from mpcc_controller.mpcc_ocp import Weights
from mpcc_controller.single_track import Car, Input, State
from mpcc_controller.solver import SOLVED, Solution
from mpcc_controller.stages import Numbers
from msgs_yaml.types import Command, Why

OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs


def tick(stamp_ns: int, decision: Decision, gate: str, values: dict) -> Why:
    """Return the `Why` of a tick; `gate` is the reason for which the gate intervened, or ''."""
    level = {SOLVED: OK, BRAKING: ERROR}.get(decision.rung, WARN)
    told = f'{decision.rung}: {decision.reason}'
    if gate:
        level, told = ERROR, f'{told}; gate: {gate}'
    named = {'rung': decision.rung, 'reason': decision.reason, 'gate': gate or 'passed'}
    return Why(stamp_ns, level, told, named | values)


def measured(x: State) -> dict:
    """Return where the car is on its path and what its actuators were last told."""
    return {
        'theta': float(x.theta),
        'vx': float(x.vx),
        'set_point.delta': float(x.delta),
        'set_point.Fx': float(x.Fx),
    }


def commanded(command: Command, car: Car, rejections: int) -> dict:
    """Return the brake split that leaves (0 while not braking), and the ideal one."""
    force = command.Fxf + command.Fxr
    return {
        'split.front': command.Fxf / force if force < 0 else 0.0,
        'split.ideal': float(single_track.ideal_split(force, car)),
        'gate.rejections': rejections,
    }


def solved(solution: Solution, prepare_s: float, warm: bool) -> dict:
    """Return how the solver fared."""
    return {
        'solver.warm': warm,
        'solver.status': solution.status,
        'solver.message': solution.message,
        'solver.iterations': solution.iterations,
        'solver.primal_residual': solution.primal_residual,
        'solver.dual_residual': solution.dual_residual,
        'solver.cost': solution.cost,
        'time.prepare_ms': 1e3 * prepare_s,
        'time.solve_ms': 1e3 * solution.solve_s,
    }


def planned(view: View, numbers: Numbers, U: np.ndarray) -> dict:
    """Return the plan's cost by term, its distances and priorities, its use of the friction."""
    terms = {name: float(np.sum(term)) for name, term in view.terms._asdict().items()}
    weights = {name: float(getattr(numbers.stages.weights, name)) for name in Weights._fields}
    slack = U[:, Input._fields.index('slack')]
    said = {'cost.total': sum(terms.values())}
    said |= {f'cost.{name}': term for name, term in terms.items()}
    said |= {f'weight.{name}': weight for name, weight in weights.items()}
    for obstacle, D, q in zip(numbers.obstacles, view.v2o, view.priority_o):
        said |= _distance(f'v2o.{obstacle.id}', f'q_v2o.{obstacle.id}', D, q, weights['v2o'])
    for side, D, q in zip(('left', 'right'), view.v2e, view.priority_e):
        said |= _distance(f'v2e.{side}', f'q_v2e.{side}', D, q, weights['v2e'])
    return said | {
        'friction.front': float(view.friction.f[0]),
        'friction.rear': float(view.friction.r[0]),
        'friction.front_max': float(np.max(view.friction.f)),
        'friction.rear_max': float(np.max(view.friction.r)),
        'error.con': float(view.con[0]),
        'error.lag': float(view.lag[0]),
        'error.lag_max': float(np.max(np.abs(view.lag))),
        'slack.max': float(np.max(np.abs(slack))),
        'v_ref': float(numbers.stages.v_ref[0]),
    }


def _distance(name, weight_name, D, q, P_k):
    """Return the distance now, the least one of the plan, and the largest weight on the way."""
    return {
        name: float(D[0]),
        f'{name}.least': float(np.min(D)),
        weight_name: float(P_k * np.max(q)),
    }
