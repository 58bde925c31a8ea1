"""The plant as CasADi functions of flat vectors: built once, parameters enter as numbers.

Integrator: the classical Runge-Kutta method of fourth order, 1 ms. The fastest modes are wheel spin
against the carcass (160 rad/s), wheel hop (75 rad/s) and the damping of a gripping brake (some
400 1/s): all within its stability limit of 2.8/ms, at every speed including standstill because slip
is a state. What sticks or stops is settled after each step, there the order is one.
"""

from functools import cache

import casadi as ca
import numpy as np

from vehicle_plant import double_track, named, road
from vehicle_plant.parameters import PlantParams
from vehicle_plant.state import Readings, SetPoints, State, Wheels

STEP_S = 1e-3


def parameter_vector(params: PlantParams, friction: float) -> np.ndarray:
    """Return all numbers of the plant, then the road friction scale under each wheel."""
    return np.array([*named.leaves(params), *Wheels(*(friction,) * len(Wheels._fields))], float)


def gripping(x: np.ndarray, p: np.ndarray, patches: np.ndarray) -> np.ndarray:
    """Return p with the friction under each wheel at a state.

    p: that of `parameter_vector`, its friction that of the road beside the patches; patches:
    (k, 13) of `road.patches`.
    """
    numbers, friction = p[: -len(Wheels._fields)], p[-1]
    # column by column for CasADi, row by row for numpy
    grips = road.function()(x, numbers, road.padded(patches).T, friction)
    return np.concatenate([numbers, np.asarray(grips).ravel()])


@cache
def functions() -> tuple[ca.Function, ca.Function]:
    """Return derivative(x, u, p) -> (x_dot, readings) and settled(x, p) -> x on flat vectors."""
    x = ca.SX.sym('x', len(named.names(State)))
    u = ca.SX.sym('u', len(named.names(SetPoints)))
    numbers = len(named.names(PlantParams))
    p = ca.SX.sym('p', numbers + len(Wheels._fields))
    plant = named.build(PlantParams, ca.vertsplit(p[:numbers]))
    friction = Wheels(*ca.vertsplit(p[numbers:]))
    state = named.build(State, ca.vertsplit(x))
    set_points = named.build(SetPoints, ca.vertsplit(u))
    x_dot, readings = double_track.derivative(state, set_points, plant, friction)
    outputs = ca.cse([ca.vertcat(*named.leaves(x_dot)), ca.vertcat(*named.leaves(readings))])
    settled = ca.vertcat(*named.leaves(double_track.settled(state, plant.car)))
    return (
        ca.Function('derivative', [x, u, p], outputs, ['x', 'u', 'p'], ['x_dot', 'readings']),
        ca.Function('settled', [x, p], [settled]),
    )


@cache
def step() -> ca.Function:
    """Return step(x, u_begin, u_end, h, p) -> (x, readings) after one Runge-Kutta step of h [s]."""
    derivative, settled = functions()
    x, begin, end, p = (
        ca.MX.sym(name, size)
        for name, size in zip(
            'xabp', (derivative.size1_in(0), *(derivative.size1_in(1),) * 2, derivative.size1_in(2))
        )
    )
    h = ca.MX.sym('h')
    middle = (begin + end) * 0.5
    k1, _ = derivative(x, begin, p)
    k2, _ = derivative(x + h * 0.5 * k1, middle, p)
    k3, _ = derivative(x + h * 0.5 * k2, middle, p)
    k4, _ = derivative(x + h * k3, end, p)
    after = settled(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), p)
    _, readings = derivative(after, end, p)
    return ca.Function('step', [x, begin, end, h, p], [after, readings])


def row_size() -> int:
    """Return the length of a row of the record: state, then readings."""
    return len(named.names(State)) + len(named.names(Readings))
