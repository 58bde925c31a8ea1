"""How fast are the solvers, on the problems of one closed-loop drive?

A drive with fatrop collects the problems: first states, parameters, limits and warm starts. Then
every solver solves every problem, one problem after the other with the solvers in turn, so that a
busy machine slows all of them alike; a problem's time is the smallest of several passes. The first
problem has a cold start and is listed apart. `gap` is the cost above the best solver's cost.

    .venv/bin/python bench/solver.py [--scenario NAME] [--passes 3] [--problems 120]
"""

import argparse
import tempfile
import time
from contextlib import contextmanager
from dataclasses import replace
from os import environ
from typing import NamedTuple

import numpy as np

from bags import closed_loop
from mpcc_controller import car_file, solver
from mpcc_controller.controller import Controller
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.solver import Solution, SolverOptions
from msgs_yaml import parameters, ring, share
from msgs_yaml.stamp import NS_PER_S
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.ring import Lockstep
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import Simulator, Start

MS = 1e3


class Variant(NamedTuple):
    """A solver to be measured."""

    label: str
    name: str
    compiled: bool


class Recorder:
    """A StageSolver that keeps the arguments of every call."""

    def __init__(self, inner):
        self.inner = inner
        self.calls = []

    def solve(self, *numbers) -> Solution:
        """Solve, and keep the numbers."""
        self.calls.append(numbers)
        return self.inner.solve(*numbers)


VARIANTS = (
    Variant('fatrop', 'fatrop', compiled=True),
    Variant('fatrop interpreted', 'fatrop', compiled=False),
    Variant('ipopt', 'ipopt', compiled=True),
    Variant('ipopt interpreted', 'ipopt', compiled=False),
)


def controller_params() -> ControllerParams:
    """Return the parameters of the MPCC."""
    return parameters.load(ControllerParams, share.path('mpcc_controller', 'config', 'mpcc.yaml'))


def collect(name: str, most: int):
    """Drive a scenario; return the problem and at most `most` calls of its solver, evenly taken."""
    params, scn = controller_params(), scenario.load(name)
    params = replace(params, solver=replace(params.solver, name='fatrop'))
    car = Simulator(plant_parameters.load(), scn.friction, Start(*scn.start))
    plant_side = Lockstep(car, RunEnd(closed_loop.stop_params(scn), car.now))
    controller = Controller(params, car_file.load(params))
    recorder = controller.horizon.solver = Recorder(controller.horizon.solver)
    controller.reset(car.actuators)
    controller.set_reference(ring.reference(scn.reference))
    controller.set_edges(scn.edges)
    while not plant_side.outcome:
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        controller.set_obstacles(scenario.obstacles_at(scn, t, car.stamp_ns))
        command, _, _ = controller.step(ring.odometry(car.state))
        plant_side.tick(command)
    chosen = np.unique(np.linspace(0, len(recorder.calls) - 1, most).round().astype(int))
    return controller.horizon.problem, [recorder.calls[i] for i in chosen]


@contextmanager
def empty_cache():
    """Compile into a folder of its own."""
    before = environ.get('MPCC_CACHE_DIR')
    with tempfile.TemporaryDirectory() as folder:
        environ['MPCC_CACHE_DIR'] = folder
        try:
            yield
        finally:
            environ.pop('MPCC_CACHE_DIR')
            if before is not None:
                environ['MPCC_CACHE_DIR'] = before


def start(problem, variant: Variant):
    """Return a solver, and the seconds to make it the first time and with a full cache."""
    rules = controller_params().solver
    options = SolverOptions(
        variant.name, rules.max_iterations, rules.tolerance, None, variant.compiled
    )
    seconds = []
    with empty_cache():
        for _ in range(2):
            began = time.perf_counter()
            made = solver.make(problem, options)
            seconds.append(time.perf_counter() - began)
    return made, seconds


def measure(solvers, calls, passes: int):
    """Return the solutions of the last pass and the smallest times [s], (solver, problem)."""
    seconds = np.full((passes, len(solvers), len(calls)), np.inf)
    solutions = [[None] * len(calls) for _ in solvers]
    for a_pass in range(passes):
        for j, numbers in enumerate(calls):
            for i, one in enumerate(solvers):
                solutions[i][j] = one.solve(*numbers)
                seconds[a_pass, i, j] = solutions[i][j].solve_s
    return solutions, seconds.min(axis=0)


def row(label, solutions, seconds, best, starts):
    """Return one line of the table."""
    ms = seconds[1:] * MS
    iterations = [s.iterations for s in solutions[1:]]
    solved = np.array([s.status == solver.SOLVED for s in solutions])
    gap = np.array([s.cost for s in solutions]) / best - 1
    return (
        f'| {label:<19} | {np.median(ms):7.2f} | {np.quantile(ms, 0.99):7.2f} | {ms.max():7.2f} '
        f'| {seconds[0] * MS:7.2f} | {np.median(iterations):4.0f} / {max(iterations):<4} '
        f'| {solved.mean():6.1%} | {np.median(gap):8.0e} / {gap.max():<8.0e} '
        f'| {starts[0]:6.2f} / {starts[1]:5.2f} |'
    )


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--scenario', default='double_lane_change')
    parser.add_argument('--passes', type=int, default=3)
    parser.add_argument('--problems', type=int, default=120)
    arguments = parser.parse_args()
    problem, calls = collect(arguments.scenario, arguments.problems)
    made = [start(problem, variant) for variant in VARIANTS]
    solutions, seconds = measure([one for one, _ in made], calls, arguments.passes)
    best = np.min([[s.cost for s in of_one] for of_one in solutions], axis=0)
    print(
        f'{len(calls)} problems of {arguments.scenario}: {problem.nx} states, {problem.nu} inputs, '
        f'{problem.np} parameters, {problem.horizon} steps; times in ms, starts in s\n'
    )
    print(
        '| solver              |  median |     p99 |     max |    cold | iterations  '
        '| solved | gap median / max    | start / again  |'
    )
    print('|---' * 9 + '|')
    for variant, (_, starts), of_one, its_seconds in zip(VARIANTS, made, solutions, seconds):
        print(row(variant.label, of_one, its_seconds, best, starts))


if __name__ == '__main__':
    main()
