"""Solve a recorded problem of the MPCC by fatrop; print name, status and iterations.

python solve_again.py PROBLEM.npz DISTANCE, where DISTANCE is formulation.distance: how the
distances of the problem are measured.
"""

import sys

import numpy as np

from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import share
from node_runtime import node_parameters
from stage_solver.stage_problem import Bounds, Plan

GIVEN = {
    'formulation.distance': sys.argv[2],
    'solver.name': 'fatrop',
    'solver.fallback': 'none',
}
file = share.path('mpcc_controller', 'config', 'mpcc.yaml')
params, _ = node_parameters.resolve(ControllerParams, file, GIVEN)
solver = Controller(params, car_file.load(params)).planner.solvers.first
with np.load(sys.argv[1]) as data:
    bounds = Bounds(*(data[name] for name in Bounds._fields))
    solution = solver.solve(data['x0'], data['P'], bounds, Plan(data['X'], data['U']))
print(solver.name, solution.status, solution.iterations)
