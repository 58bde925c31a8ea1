"""The MPCC node whose solvers cannot solve what they are given on some ticks.

    python failing_node.py TICK COUNT [--ros-args ...]

The solvers are the real ones and really fail: the numbers of the problem are NaN on those ticks,
which count from 0. Nothing in the node knows of it. At TICK it prints `begins` and the stamp [ns].
"""

import sys

import numpy as np

from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import decode
from node_runtime import spin_node


class Spoilt:
    """A StageSolver that passes its problem on, on some ticks without a sound number in it."""

    def __init__(self, solver, is_spoilt):
        self.solver, self.is_spoilt = solver, is_spoilt

    def solve(self, x0, P, bounds, guess):
        """See `solution.StageSolver`."""
        return self.solver.solve(x0, P * np.nan if self.is_spoilt() else P, bounds, guess)

    def set_time_limit(self, seconds):
        """Tell the solver how long it may take [s]."""
        self.solver.set_time_limit(seconds)


class FailingNode(ControllerNode):
    """Counts its steps, and spoils the problems of some."""

    def __init__(self, first: int, count: int):
        super().__init__()
        self.ticks, self.tick = range(first, first + count), -1
        planner = self.controller.planner
        planner.first_solver = Spoilt(planner.first_solver, self.is_spoilt)
        planner.second_solver = Spoilt(planner.second_solver, self.is_spoilt)

    def is_spoilt(self):
        """Tell whether the solvers must fail now."""
        return self.tick in self.ticks

    def step(self):
        """Answer the state as ever."""
        self.tick += 1
        if self.tick == self.ticks.start:
            print('begins', decode.stamp_ns_of(self.inputs.state), flush=True)
        super().step()


def main() -> int:
    """Run until told to end."""
    first, count, *rest = sys.argv[1:]
    return spin_node.spin(lambda: FailingNode(int(first), int(count)), args=rest)


if __name__ == '__main__':
    sys.exit(main())
