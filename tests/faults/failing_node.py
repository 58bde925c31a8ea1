"""The MPCC node with solvers that fail on some ticks.

    python failing_node.py TICK COUNT [--ros-args ...]

These are the real solvers: the parameters of the problem are NaN on those ticks, which count from
0. The node itself is unchanged. At TICK it prints `begins` and the stamp [ns].
"""

import sys

import numpy as np

from mpcc_controller.controller_node import ControllerNode
from msgs_yaml import decode
from node_runtime import spin_node


class NanProblemSolver:
    """A StageSolver that passes its problem to another one, with NaN parameters on some ticks."""

    def __init__(self, solver, is_failing):
        self.solver, self.is_failing = solver, is_failing

    def solve(self, x0, P, bounds, guess):
        """See `solution.StageSolver`."""
        return self.solver.solve(x0, P * np.nan if self.is_failing() else P, bounds, guess)

    def set_time_limit(self, seconds):
        """See `solution.StageSolver`."""
        self.solver.set_time_limit(seconds)


class FailingNode(ControllerNode):
    """Counts its steps and makes the solvers fail on some."""

    def __init__(self, first: int, count: int):
        super().__init__()
        self.ticks, self.tick = range(first, first + count), -1

    def configure(self):
        """Make the controller, and solvers that fail."""
        super().configure()
        solvers = self.controller.parts.solvers
        solvers.first = NanProblemSolver(solvers.first, self.is_failing)

    def is_failing(self):
        """Return whether the solvers must fail now."""
        return self.tick in self.ticks

    def step(self):
        """Compute the command for the last state."""
        self.tick += 1
        if self.tick == self.ticks.start:
            print('begins', decode.stamp_ns_of(self.inputs.state), flush=True)
        super().step()


def main() -> int:
    """Run until a signal ends it."""
    first, count, *rest = sys.argv[1:]
    return spin_node.spin(lambda: FailingNode(int(first), int(count)), args=rest)


if __name__ == '__main__':
    sys.exit(main())
