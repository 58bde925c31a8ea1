"""Positions that no car can leave: emergencies that friction makes impossible.

The centre of gravity is a point whose acceleration is at most that of the tyres' peak friction. So
t seconds after the instant of action it is within a t^2 / 2 of where it would have coasted, and
from one instant to the next it moves by no more than its speed allows. It may not come closer to
an obstacle than half the width of the car, which the outline covers on every side, and no farther
beyond an edge than a wheel may: some wheel is always at least as far out. The set of positions
that keep all this, on a grid, contains every position of every car that survives; where it becomes
empty the emergency is impossible. All roundings make the set larger.
"""

import numpy as np
from scipy.ndimage import distance_transform_edt, find_objects

from bags.evaluation.metrics.survival import SHOULDER_M
from experiments.survivable.emergency import Emergency
from msgs_yaml.conversions import NS_PER_S

CELL_M = 0.1  # of a grid with up to MOST_CELLS, else wider
MOST_CELLS = 500_000
STEP_S = 0.025
MARGIN = 1.05  # of the friction, for vertical motion
STANDSTILL_S = 1.0
BEND_M = 0.1  # by which the inside of a bend may lie beyond the chord between two wheels
ROLLING = 0.15  # m/s^2, rolling resistance and what else slows a car


def greatest_acceleration(emergency: Emergency) -> float:
    """Return a bound on the acceleration [m/s^2] of the centre of gravity in the road plane.

    A tyre's friction force is concave in its load, so four tyres have most friction at equal loads.
    Drag counts at the speed at the instant of action.
    """
    plant, setup = emergency.setup.plant, emergency.setup
    body, tyre, scaling = plant.car.body, plant.tyre, plant.car.scaling
    friction = max((setup.friction, *setup.scn.patches.friction))
    load = body.mass_kg * body.gravity_mps2 / 4
    peaks = []
    for axle in (scaling.front, scaling.rear):
        nominal = tyre.reference.FNOMIN * axle.LFZO
        excess = (load - nominal) / nominal
        lateral = abs(tyre.lateral.PDY1 + tyre.lateral.PDY2 * excess) * axle.LMUY
        longitudinal = abs(tyre.longitudinal.PDX1 + tyre.longitudinal.PDX2 * excess) * axle.LMUX
        peaks += [lateral, longitudinal]
    now = emergency.car.state
    drag = body.air_density_kgpm3 * body.drag_area_m2 * (now.vx**2 + now.vy**2) / 2 / body.mass_kg
    return MARGIN * max(peaks) * friction * body.gravity_mps2 + drag + ROLLING


def impossible_at(emergency: Emergency) -> float | None:
    """Return when [s after the action] no position is left, or None while the bound allows some."""
    now, a = emergency.car.state, greatest_acceleration(emergency)
    c, s = np.cos(now.psi), np.sin(now.psi)
    v = np.array([now.vx * c - now.vy * s, now.vx * s + now.vy * c])
    speed = float(np.hypot(*v))
    # a car that has stood for STANDSTILL_S ends the run: later nothing can happen to it
    ticks = min(emergency.most_ticks, int((speed / a + STANDSTILL_S) / STEP_S))
    start = np.array([now.X, now.Y])
    grid = _Grid(emergency, start, v, a, ticks * STEP_S)
    box = tuple(slice(0, size) for size in grid.X.shape)
    reached = grid.near(box, start, 0.0)
    for k in range(1, ticks + 1):
        t = k * STEP_S
        stamp = emergency.start_ns + round(t * NS_PER_S)
        obstacles = [disc for o in emergency.foreseen_at(stamp).items for disc in o.discs()]
        # within a step the velocity stays in a disc of radius a t around v
        box, reached = grid.moved(box, reached, v * STEP_S, a * t * STEP_S)
        reached &= grid.near(box, start + v * t, a * t**2 / 2)
        reached &= ~grid.blocked(box, emergency.discs_at(stamp).values())
        if not reached.any():
            return t
        if not obstacles and t > speed / a:
            return None
        stand = obstacles and not any(o.vX or o.vY for o in obstacles)
        if stand and grid.has_passed(box, reached, obstacles):
            return None
    return None


class _Grid:
    """Cells around all positions that can be reached."""

    def __init__(self, emergency, start, v, a, time_s):
        self._half_width = emergency.setup.plant.car.outline.width_m / 2
        self._course = emergency.course
        far = a * time_s**2 / 2
        ends = np.array([start, start + v * time_s])
        low, high = ends.min(axis=0) - far, ends.max(axis=0) + far
        # no position farther from the course than its edges counts
        road = np.column_stack([self._course.X, self._course.Y])
        side = float(np.max(np.abs([self._course.left, self._course.right]))) + 1.0
        close = road[np.all((road > low) & (road < high), axis=1)]
        if len(close):
            low = np.maximum(low, close.min(axis=0) - side)
            high = np.minimum(high, close.max(axis=0) + side)
        self._cell = cell = max(CELL_M, float(np.sqrt(np.prod(high - low) / MOST_CELLS)))
        x = np.arange(low[0], high[0] + cell, cell)
        y = np.arange(low[1], high[1] + cell, cell)
        self.X, self.Y = np.meshgrid(x, y, indexing='ij')
        # positions within a cell are up to its half diagonal from its centre
        self._slack = cell * np.sqrt(0.5)
        beyond = self._course.beyond_edge(self.X, self.Y)
        self._off = beyond > SHOULDER_M + BEND_M + self._slack

    def near(self, box, centre, radius):
        """Return the cells of a box with a position within a radius of a centre."""
        square = (self.X[box] - centre[0]) ** 2 + (self.Y[box] - centre[1]) ** 2
        return square <= (radius + self._slack) ** 2

    def moved(self, box, cells, shift, spread):
        """Return a box and its cells that positions of `cells` reach by a shift and a spread."""
        whole = np.round(shift / self._cell).astype(int)
        rest_m = spread + 2 * self._slack + float(np.hypot(*(shift - whole * self._cell)))
        margin = int(np.ceil(rest_m / self._cell)) + 1
        (filled,) = find_objects(cells.astype(int))
        begin = [side.start + rows.start for side, rows in zip(box, filled)] + whole - margin
        away = np.pad(~cells[filled], margin, constant_values=True)
        reached = distance_transform_edt(away, self._cell) <= rest_m
        # what lies beyond the grid is out of reach, or off the road
        first, last = np.maximum(0, begin), np.minimum(self.X.shape, begin + away.shape)
        kept = tuple(map(slice, first - begin, last - begin))
        return tuple(map(slice, first, last)), reached[kept]

    def blocked(self, box, obstacles):
        """Return the cells of a box that lie off the road or in an obstacle altogether."""
        blocked = self._off[box].copy()
        for o in obstacles:
            radius = o.r_obs + self._half_width - self._slack
            if radius > 0:
                blocked |= radius**2 > (self.X[box] - o.X) ** 2 + (self.Y[box] - o.Y) ** 2
        return blocked

    def has_passed(self, box, cells, obstacles):
        """Return whether a position lies behind all of the obstacles, seen along the course."""
        furthest = max(float(self._course.project(o.X, o.Y)[0]) + o.r_obs for o in obstacles)
        X, Y = self.X[box][cells], self.Y[box][cells]
        return bool((self._course.project(X, Y)[0] > furthest + self._half_width + 1.0).any())
