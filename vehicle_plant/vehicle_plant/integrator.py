"""Integration of the plant on flat vectors: CasADi functions, built once, and many steps in C.

Classical Runge-Kutta method of fourth order, 1 ms. The fastest modes are wheel spin against the
carcass (160 rad/s), wheel hop (75 rad/s) and the damping of a gripping brake (some 400 1/s): all
within its stability limit of 2.8/ms, at every speed including standstill because slip is a state.
Constraints (linings, mechanical stops) are projected after each step; there the order is one.

`Model` says what is integrated. Every function takes one; without it, the double track.
"""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from node_runtime import named_vector
from stage_solver import compile_cache
from vehicle_plant import double_track, road_friction
from vehicle_plant.car import MultiBodyParams, PlantParams
from vehicle_plant.initial_state import Start, rolling_state
from vehicle_plant.state import Outputs, PerWheel, SetPoints, State

STEP_S = 1e-3
# state, then outputs
ROW_SIZE = len(named_vector.names(State)) + len(named_vector.names(Outputs))
# no fused multiply-add and no CPU-specific code: the same bits on every x86-64 machine
FLAGS = ('-O2', '-fno-math-errno', '-ffp-contract=off')

_DRIVER = """
enum {{ NX = {nx}, NU = {nu}, NY = {ny}, NP = {np}, NW = {nw} }};
enum {{ IN_ROW = {in_row}, ROW = IN_ROW + NY }};

static int slope(const double *x, const double *u, const double *p, double *dx, double *y) {{
  const double *arg[{sz_arg}] = {{x, u, p}};
  double *res[{sz_res}] = {{dx, y}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  return derivative(arg, res, iw, w, 0);
}}

static int project(double *x, const double *p) {{
  const double *arg[{sz_arg}] = {{x, p}};
  double out[NX];
  double *res[{sz_res}] = {{out}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  int failed = projection(arg, res, iw, w, 0);
  for (int i = 0; i < NX; ++i) x[i] = out[i];
  return failed;
}}

/* the friction under each wheel, at the end of p */
static int update_friction(const double *x, const double *patches, const double *friction,
                           double *p) {{
  const double *arg[{sz_arg}] = {{x, p, patches, friction}};
  double *res[{sz_res}] = {{p + NP - NW}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  return patches ? local_friction(arg, res, iw, w, 0) : 0;
}}

/* u: steps + 1 rows of NU set-points; patches: all of them or none, 0;
   rows: steps rows of state (if it is in the row) and outputs after each step */
int advance(double *x, const double *u, const double *numbers, const double *patches, double h,
            double *rows, long steps) {{
  double k1[NX], k2[NX], k3[NX], k4[NX], at[NX], mid[NU], y[NY], p[NP];
  for (int i = 0; i < NP; ++i) p[i] = numbers[i];
  int failed = update_friction(x, patches, numbers + NP - 1, p);
  failed |= slope(x, u, p, k1, y);
  for (long n = 0; n < steps; ++n, u += NU, rows += ROW) {{
    for (int i = 0; i < NU; ++i) mid[i] = (u[i] + u[NU + i]) * 0.5;
    for (int i = 0; i < NX; ++i) at[i] = x[i] + h * 0.5 * k1[i];
    failed |= slope(at, mid, p, k2, y);
    for (int i = 0; i < NX; ++i) at[i] = x[i] + h * 0.5 * k2[i];
    failed |= slope(at, mid, p, k3, y);
    for (int i = 0; i < NX; ++i) at[i] = x[i] + h * k3[i];
    failed |= slope(at, u + NU, p, k4, y);
    for (int i = 0; i < NX; ++i) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
    failed |= project(x, p);
    failed |= update_friction(x, patches, numbers + NP - 1, p);
    failed |= slope(x, u + NU, p, k1, rows + IN_ROW);
    for (int i = 0; i < IN_ROW; ++i) rows[i] = x[i];
  }}
  return failed;
}}
"""


@dataclass(frozen=True)
class Model:
    """Equations of motion that are integrated in steps of 1 ms.

    The state is a named tuple that has a `planar` (`state.Planar`). A row of a trajectory is the
    state and the outputs, or the outputs alone when the state is not that of `state.State`.
    """

    name: str  # of the compiled library
    state: type  # named tuple
    derivative: Callable[..., tuple[Any, Any]]  # (x, u, PlantParams, friction) -> (x_dot, outputs)
    project: Callable[[Any, Any], Any]  # (x, Car) -> x within its constraints
    start: Callable[[PlantParams, Start], np.ndarray]  # flat state of a rolling car
    steps_per_ms: Callable[[np.ndarray], int]  # flat state -> steps that it needs
    state_in_row: bool


DOUBLE_TRACK = Model(
    'vehicle_plant',
    State,
    double_track.derivative,
    double_track.project_constraints,
    rolling_state,
    steps_per_ms=lambda x: 1,
    state_in_row=True,
)


def model_of(params: PlantParams) -> Model:
    """Return the model that the parameters are for: the double track, or the multi-body one."""
    if isinstance(params, MultiBodyParams):
        # needs a package that a plant of its own does not
        from vehicle_plant.multi_body.equations import MULTI_BODY

        return MULTI_BODY
    return DOUBLE_TRACK


def parameter_vector(params: PlantParams, friction: float) -> np.ndarray:
    """Return all numbers of the plant, then the road friction scale under each wheel."""
    per_wheel = PerWheel(*(friction,) * len(PerWheel._fields))
    return np.array([*named_vector.leaves(params), *per_wheel], float)


def with_local_friction(
    x: np.ndarray, p: np.ndarray, patches: np.ndarray, model: Model = DOUBLE_TRACK
) -> np.ndarray:
    """Return p with the friction under each wheel at a state x.

    p: that of `parameter_vector`, with the friction of the road beside the patches; patches:
    (k, 13) of `road_friction.patch_array`.
    """
    numbers, friction = p[: -len(PerWheel._fields)], p[-1]
    # column by column for CasADi, row by row for numpy
    columns = road_friction.pad_patches(patches).T
    local = road_friction.friction_function(model.state)(x, numbers, columns, friction)
    return np.concatenate([numbers, np.asarray(local).ravel()])


@cache
def plant_functions(model: Model = DOUBLE_TRACK) -> tuple[ca.Function, ca.Function]:
    """Return derivative(x, u, p) -> (x_dot, outputs) and projection(x, p) -> x on flat vectors."""
    x = ca.SX.sym('x', len(named_vector.names(model.state)))
    u = ca.SX.sym('u', len(named_vector.names(SetPoints)))
    numbers = len(named_vector.names(PlantParams))
    p = ca.SX.sym('p', numbers + len(PerWheel._fields))
    plant = named_vector.build(PlantParams, ca.vertsplit(p[:numbers]))
    friction = PerWheel(*ca.vertsplit(p[numbers:]))
    state = named_vector.build(model.state, ca.vertsplit(x))
    set_points = named_vector.build(SetPoints, ca.vertsplit(u))
    results = model.derivative(state, set_points, plant, friction)
    flat = ca.cse([ca.vertcat(*named_vector.leaves(result)) for result in results])
    projected = model.project(state, plant.car)
    return (
        ca.Function('derivative', [x, u, p], flat, ['x', 'u', 'p'], ['x_dot', 'outputs']),
        ca.Function('projection', [x, p], [ca.vertcat(*named_vector.leaves(projected))]),
    )


def row(x: np.ndarray, u: np.ndarray, p: np.ndarray, model: Model = DOUBLE_TRACK) -> np.ndarray:
    """Return the row of a flat state x under set-points u, p as `with_local_friction`."""
    derivative, _ = plant_functions(model)
    outputs = np.asarray(derivative(x, u, p)[1]).ravel()
    return np.concatenate([x, outputs]) if model.state_in_row else outputs


def _c_source(model) -> str:
    derivative, projection = plant_functions(model)
    functions = (derivative, projection, road_friction.friction_function(model.state))
    generator = ca.CodeGenerator('plant.c', {'with_header': False})
    for f in functions:
        generator.add(f)
    sizes = {
        name: max(getattr(f, name)() for f in functions) + 1
        for name in ('sz_arg', 'sz_res', 'sz_iw', 'sz_w')
    }
    nx, nu, np_ = (derivative.size1_in(i) for i in range(3))
    ny, nw = derivative.size1_out(1), len(PerWheel._fields)
    in_row = nx if model.state_in_row else 0
    sizes |= {'nx': nx, 'nu': nu, 'np': np_, 'ny': ny, 'nw': nw, 'in_row': in_row}
    return generator.dump() + _DRIVER.format(**sizes)


@cache
def library(model: Model = DOUBLE_TRACK) -> Path:
    """Return the compiled plant. Raises CompileError."""
    return compile_cache.compile_library(_c_source(model), model.name, FLAGS)


@cache
def _compiled_advance(model):
    """Return `advance` of the driver."""
    function = ctypes.CDLL(str(library(model))).advance
    pointer = ctypes.c_void_p
    function.argtypes = [*(pointer,) * 4, ctypes.c_double, pointer, ctypes.c_long]
    function.restype = ctypes.c_int
    return function


def advance(
    x: np.ndarray,
    set_points: np.ndarray,
    p: np.ndarray,
    h: float = STEP_S,
    patches: np.ndarray | None = None,
    model: Model = DOUBLE_TRACK,
) -> tuple[np.ndarray, np.ndarray]:
    """Advance a model by n steps of h [s]; return its last state and the rows of the steps.

    x: (n_x,) before; set_points: (n + 1, n_u) at the ends of the steps; p: that of
    `parameter_vector`; patches: (k, 13) of `road_friction.patch_array`. The inputs stay as they
    are. Rows are (n, state + outputs), or (n, outputs), see `Model`.

    A model that needs shorter steps at its present state gets them; rows are those of h.
    """
    parts = model.steps_per_ms(x)
    if parts > 1:
        ends = np.arange(len(set_points))
        fine = np.arange((len(set_points) - 1) * parts + 1) / parts
        set_points = np.column_stack([np.interp(fine, ends, column) for column in set_points.T])
    arrays = [np.array(x, dtype=float)]  # the C code advances it in place
    arrays += [np.ascontiguousarray(array, dtype=float) for array in (set_points, p)]
    padded = None if patches is None or not len(patches) else road_friction.pad_patches(patches)
    pointers = [array.ctypes.data for array in arrays]
    pointers.append(None if padded is None else padded.ctypes.data)
    rows = np.empty((len(set_points) - 1, ROW_SIZE))
    _compiled_advance(model)(*pointers, h / parts, rows.ctypes.data, len(rows))
    return arrays[0], rows[parts - 1 :: parts]
