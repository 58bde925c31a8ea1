"""Many 1 ms steps in one call: compiled C where there is a compiler, else interpreted."""

import ctypes
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from stage_solver import compile_cache
from vehicle_plant import graph, road

# no fused multiply-add and no CPU-specific code: the same bits on every x86-64 machine
FLAGS = ('-O2', '-fno-math-errno', '-ffp-contract=off')

_DRIVER = """
enum {{ NX = {nx}, NU = {nu}, NY = {ny}, NP = {np}, NW = {nw}, ROW = NX + NY }};

static int slope(const double *x, const double *u, const double *p, double *dx, double *y) {{
  const double *arg[{sz_arg}] = {{x, u, p}};
  double *res[{sz_res}] = {{dx, y}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  return derivative(arg, res, iw, w, 0);
}}

static int settle(double *x, const double *p) {{
  const double *arg[{sz_arg}] = {{x, p}};
  double out[NX];
  double *res[{sz_res}] = {{out}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  int failed = settled(arg, res, iw, w, 0);
  for (int i = 0; i < NX; ++i) x[i] = out[i];
  return failed;
}}

/* the friction under each wheel, at the end of p */
static int grip(const double *x, const double *patches, const double *friction, double *p) {{
  const double *arg[{sz_arg}] = {{x, p, patches, friction}};
  double *res[{sz_res}] = {{p + NP - NW}};
  casadi_int iw[{sz_iw}];
  double w[{sz_w}];
  return patches ? grips(arg, res, iw, w, 0) : 0;
}}

/* u: steps + 1 rows of NU set-points; patches: all of them or none, 0;
   rows: steps rows of state and readings after each step */
int advance(double *x, const double *u, const double *numbers, const double *patches, double h,
            double *rows, long steps) {{
  double k1[NX], k2[NX], k3[NX], k4[NX], at[NX], mid[NU], y[NY], p[NP];
  for (int i = 0; i < NP; ++i) p[i] = numbers[i];
  int failed = grip(x, patches, numbers + NP - 1, p);
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
    failed |= settle(x, p);
    failed |= grip(x, patches, numbers + NP - 1, p);
    failed |= slope(x, u + NU, p, k1, rows + NX);
    for (int i = 0; i < NX; ++i) rows[i] = x[i];
  }}
  return failed;
}}
"""


def _source() -> str:
    derivative, settled = graph.functions()
    functions = (derivative, settled, road.function())
    generator = ca.CodeGenerator('plant.c', {'with_header': False})
    for f in functions:
        generator.add(f)
    sizes = {
        name: max(getattr(f, name)() for f in functions) + 1
        for name in ('sz_arg', 'sz_res', 'sz_iw', 'sz_w')
    }
    nx, nu, np_ = (derivative.size1_in(i) for i in range(3))
    ny, nw = derivative.size1_out(1), road.function().size1_out(0)
    return generator.dump() + _DRIVER.format(nx=nx, nu=nu, np=np_, ny=ny, nw=nw, **sizes)


@cache
def library() -> Path | None:
    """Return the compiled plant, or None without a C compiler."""
    return compile_cache.compile_library(_source(), 'vehicle_plant', FLAGS)


@cache
def compiled_advance():
    """Return the C function of the driver, or None without a C compiler, with one warning."""
    path = library()
    if path is None:
        compile_cache.warn_no_compiler('the plant runs interpreted, about 20 times slower')
        return None
    function = ctypes.CDLL(str(path)).advance
    pointer = ctypes.c_void_p
    function.argtypes = [*(pointer,) * 4, ctypes.c_double, pointer, ctypes.c_long]
    function.restype = ctypes.c_int
    return function


def advance(
    x: np.ndarray,
    set_points: np.ndarray,
    p: np.ndarray,
    h: float = graph.STEP_S,
    patches: np.ndarray | None = None,
) -> np.ndarray:
    """Advance by n steps of h [s]; return the rows (n, state + readings) after each step.

    x: (n_x,) before; set_points: (n + 1, n_u) at the ends of the steps; p: that of
    `graph.parameter_vector`; patches: (k, 13) of `road.patches`. The inputs stay as they are.
    """
    function = compiled_advance()
    if function is None:
        return interpreted(x, set_points, p, h, patches)
    steps = len(set_points) - 1
    rows = np.empty((steps, graph.row_size()))
    x = np.array(x, dtype=float)
    set_points = np.ascontiguousarray(set_points, dtype=float)
    p = np.ascontiguousarray(p, dtype=float)
    some = None if patches is None or not len(patches) else road.padded(patches)
    function(
        x.ctypes.data,
        set_points.ctypes.data,
        p.ctypes.data,
        None if some is None else some.ctypes.data,
        h,
        rows.ctypes.data,
        steps,
    )
    return rows


def interpreted(
    x: np.ndarray,
    set_points: np.ndarray,
    p: np.ndarray,
    h: float = graph.STEP_S,
    patches: np.ndarray | None = None,
) -> np.ndarray:
    """Do the same as `advance` without compiled code."""
    step, derivative = graph.step(), graph.functions()[0]
    patchy = patches is not None and len(patches) > 0
    under = graph.gripping(x, p, patches) if patchy else p
    rows = np.empty((len(set_points) - 1, graph.row_size()))
    for row, begin, end in zip(rows, set_points, set_points[1:]):
        after, readings = step(x, begin, end, h, under)
        x = np.asarray(after).ravel()
        if patchy:
            under = graph.gripping(x, p, patches)
            _, readings = derivative(x, end, under)
        row[: x.size], row[x.size :] = x, np.asarray(readings).ravel()
    return rows
