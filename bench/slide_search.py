"""The best that a car can do from a slide: a search over what its driver does.

A feedback driver tracks the centre of the road (`experiments.survivable.pilots.Tracker`); the
search adds a steering angle over the first two seconds, and changes the braking and the gains.
CMA-ES minimises what lacks to a recovery on the road. What it finds was driven by the plant, with
its servos, so it is a proof; what it does not find may still exist.
"""

from typing import NamedTuple

import numpy as np

from experiments.simulation import Setup
from experiments.survivable.emergency import TICK_S, Emergency, Rollout
from experiments.survivable.evolution import Evolution
from experiments.survivable.pilots import Manoeuvre, Tracker
from experiments.survivable.road_coordinates import Path
from msgs_yaml.types import Command, Obstacles
from vehicle_plant import double_track
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import join_trajectories

STEER_KNOTS_S = np.arange(0.0, 1.9, 0.15)  # of the added angle; the last one stays 0
BRAKE_KNOTS_S = np.array([0.0, 0.4, 0.8, 1.6, 3.0])
STARTS = (0.0, 0.4, 0.9)  # braking of the first drives, of the grip
STEER_RAD, BRAKE_SHARE, GAIN = 0.08, 0.25, 0.3  # of the first generation
JUDGED_S = 3.5  # of a drive of the search
SETTLED_S = 0.6  # at its end the slide has to be over
SAFETY = 0.6  # of the limits within which a slide is over
EDGE_M = 0.05  # inside the road, aimed at


class Goal(NamedTuple):
    """What the end of a slide is."""

    half_road_m: float  # wheels stay within it
    sideslip_rad: float  # settled below
    yaw_rate_radps: float  # the same
    spun_rad: float  # sideslip never beyond


class Driver:
    """Tracks the centre of the road with a steering angle added at first."""

    def __init__(self, emergency: Emergency, manoeuvre: Manoeuvre, steering: np.ndarray):
        """`steering` [rad] is the added angle, one per tick; 0 later."""
        self._tracker = Tracker(emergency, manoeuvre)
        limit = emergency.setup.plant.car.steering
        self._step, self._limit = limit.rate_radps * TICK_S, limit.limit_rad
        self._delta = emergency.car.actuators.delta
        self._steering, self._tick = steering, 0

    def __call__(self, car: Simulator, obstacles: Obstacles) -> Command:
        """Return the command of a tick."""
        command = self._tracker(car, obstacles)
        added = self._steering[self._tick] if self._tick < len(self._steering) else 0.0
        self._tick += 1
        delta = np.clip(command.delta + added, self._delta - self._step, self._delta + self._step)
        self._delta = float(np.clip(delta, -self._limit, self._limit))
        return command._replace(delta=self._delta)


class SlideSearch:
    """A search from the start of one setup, whose car slides on a road without obstacles."""

    def __init__(self, setup: Setup, goal: Goal):
        self._emergency = Emergency(setup)
        corners = double_track.wheel_corners(setup.plant.car)
        self._wheels = np.array([(corner.x, corner.y) for corner in corners])
        self._goal = goal
        self._grip = setup.friction * setup.plant.car.body.gravity_mps2
        course = self._emergency.course
        self._path: Path = course.shifted(course.s, np.zeros_like(course.s))

    def drives(self, budget: int, seed: int):
        """Yield the odometry (stamp, t, X, Y, psi, vx, vy, r) of drives that may be saved.

        At most `budget` drives are tried.
        """
        m, k = len(STEER_KNOTS_S) - 1, len(BRAKE_KNOTS_S)
        scale = np.repeat((STEER_RAD, BRAKE_SHARE, GAIN), (m, k, 3))
        starts = [np.repeat((0.0, share, 0.0), (m, k, 3)) for share in STARTS]
        costs = [self._cost(start) for start in starts]
        left = budget - len(starts)
        yield self._odometry(starts[int(np.argmin(costs))])
        evolution = Evolution(starts[int(np.argmin(costs))], scale, np.random.default_rng(seed))
        while left >= evolution.size:
            candidates = evolution.ask()
            costs = [self._cost(vector) for vector in candidates]
            left -= len(candidates)
            if min(costs) == 0.0:
                yield self._odometry(candidates[int(np.argmin(costs))])
            effort = np.mean(((candidates - starts[0]) / scale) ** 2, axis=1)
            evolution.tell(candidates, np.array(costs) + 1e-3 * effort)
        yield self._odometry(evolution.mean)

    def _roll(self, vector, time_s) -> Rollout:
        m, k = len(STEER_KNOTS_S) - 1, len(BRAKE_KNOTS_S)
        angles, braking, gains = np.append(vector[:m], 0.0), vector[m : m + k], vector[m + k :]
        ticks = round(time_s / TICK_S)
        t = TICK_S * np.arange(ticks)
        ax = -self._grip * np.interp(t, BRAKE_KNOTS_S, np.clip(braking, -0.3, 1.2))
        lookahead, gain, slip = np.exp(np.clip(gains, -1.0, 1.0))
        manoeuvre = Manoeuvre(self._path, ax, 0.5 * lookahead, 0.06 * gain, 0.14 * slip)
        driver = Driver(self._emergency, manoeuvre, np.interp(t, STEER_KNOTS_S, angles))
        return self._emergency.roll(driver, ticks)

    def _cost(self, vector) -> float:
        """Return what a drive lacks to the goal, in about its units; 0 where it reaches it."""
        rollout, goal = self._roll(vector, JUDGED_S), self._goal
        _, t, _, Y, psi, vx, vy, r = _odometry(rollout)
        offset = np.abs(Y + np.outer(self._wheels[:, 0], np.sin(psi))
                        + np.outer(self._wheels[:, 1], np.cos(psi))).max()  # fmt: skip
        beta = np.where(np.hypot(vx, vy) > 1.0, np.abs(np.arctan2(vy, vx)), 0.0)
        end = t > t[-1] - SETTLED_S
        slide = max(beta[end].max() / goal.sideslip_rad, np.abs(r[end]).max() / goal.yaw_rate_radps)
        return float(
            2.0 * max(0.0, offset - goal.half_road_m + EDGE_M)
            + max(0.0, slide - SAFETY)
            + 5.0 * max(0.0, beta.max() - 0.95 * goal.spun_rad)
        )

    def _odometry(self, vector):
        return _odometry(self._roll(vector, self._emergency.most_ticks * TICK_S))


def _odometry(rollout: Rollout):
    state = join_trajectories(rollout.pieces).state_columns()
    t = (state.stamp_ns - rollout.commands[0].stamp_ns) * 1e-9
    return (state.stamp_ns, t, *state[1:])
