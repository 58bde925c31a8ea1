"""Many 1 ms steps in one call: compiled C where there is a compiler, else interpreted."""

import ctypes
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from msgs_yaml import compiled
from vehicle_plant import graph

# no fused multiply-add and no CPU-specific code: the same bits on every x86-64 machine
FLAGS = ('-O2', '-fno-math-errno', '-ffp-contract=off')

_DRIVER = """
enum {{ NX = {nx}, NU = {nu}, NY = {ny}, ROW = NX + NY }};

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

/* u: steps + 1 rows of NU set-points; rows: steps rows of state and readings after each step */
int advance(double *x, const double *u, const double *p, double h, double *rows, long steps) {{
  double k1[NX], k2[NX], k3[NX], k4[NX], at[NX], mid[NU], y[NY];
  int failed = slope(x, u, p, k1, y);
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
    failed |= slope(x, u + NU, p, k1, rows + NX);
    for (int i = 0; i < NX; ++i) rows[i] = x[i];
  }}
  return failed;
}}
"""


def _source() -> str:
    derivative, settled = graph.functions()
    generator = ca.CodeGenerator('plant.c', {'with_header': False})
    generator.add(derivative)
    generator.add(settled)
    sizes = {
        name: max(getattr(f, name)() for f in (derivative, settled)) + 1
        for name in ('sz_arg', 'sz_res', 'sz_iw', 'sz_w')
    }
    nx, nu, ny = derivative.size1_in(0), derivative.size1_in(1), derivative.size1_out(1)
    return generator.dump() + _DRIVER.format(nx=nx, nu=nu, ny=ny, **sizes)


@cache
def library() -> Path | None:
    """Return the compiled plant, or None without a C compiler."""
    return compiled.shared_library(_source(), 'vehicle_plant', FLAGS)


@cache
def compiled_advance():
    """Return the C function of the driver, or None without a C compiler, with one warning."""
    path = library()
    if path is None:
        compiled.warn_once('the plant runs interpreted, about 20 times slower')
        return None
    function = ctypes.CDLL(str(path)).advance
    pointer = ctypes.c_void_p
    function.argtypes = [pointer, pointer, pointer, ctypes.c_double, pointer, ctypes.c_long]
    function.restype = ctypes.c_int
    return function


def advance(x: np.ndarray, set_points: np.ndarray, p: np.ndarray, h: float = graph.STEP_S):
    """Advance by n steps of h [s]; return the rows (n, state + readings) after each step.

    x: (n_x,) before; set_points: (n + 1, n_u) at the ends of the steps; p: that of
    `graph.parameter_vector`. The inputs stay as they are.
    """
    function = compiled_advance()
    if function is None:
        return interpreted(x, set_points, p, h)
    steps = len(set_points) - 1
    rows = np.empty((steps, graph.row_size()))
    x = np.array(x, dtype=float)
    set_points = np.ascontiguousarray(set_points, dtype=float)
    p = np.ascontiguousarray(p, dtype=float)
    function(x.ctypes.data, set_points.ctypes.data, p.ctypes.data, h, rows.ctypes.data, steps)
    return rows


def interpreted(x: np.ndarray, set_points: np.ndarray, p: np.ndarray, h: float = graph.STEP_S):
    """Do the same as `advance` without compiled code."""
    step = graph.step()
    rows = np.empty((len(set_points) - 1, graph.row_size()))
    for row, begin, end in zip(rows, set_points, set_points[1:]):
        after, readings = step(x, begin, end, h, p)
        x = np.asarray(after).ravel()
        row[: x.size], row[x.size :] = x, np.asarray(readings).ravel()
    return rows
