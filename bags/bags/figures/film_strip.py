"""One run of a film: the road around the car from above, its speed, friction use and steering.

The camera follows the car along the road and is turned with the road, so that the car drives to
the right in every scenario; both directions have equal scales. It sees as far ahead as the car
plans, and the obstacles there: what the car reacts to is in the film.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.transforms import Affine2D

from bags.evaluation import geometry
from bags.evaluation.controller_log import ControllerLog
from bags.evaluation.series import obstacle_position
from bags.evaluation.signals import EvaluatedRun, friction_use
from bags.figures import style
from bags.figures.panels import Run
from msgs_yaml.conversions import NS_PER_S

WINDOW_M = 52.0  # of the road, along it, at least
BEHIND = 0.28  # share of the window behind the car
HALF_WIDTHS_M = (4.0, 14.0)  # of the road, that the camera shows
MARGIN_M = 1.2  # beyond the edges
CHORD_M = (-10.0, 35.0)  # of the edge, from the car: its direction is that of the camera
TRAIL_S = 0.02  # between two points of the line that the car has driven
POST_M = 10.0  # between two posts at an edge, which show that the car moves
POST_LENGTH_M = 0.7
WHEEL_M = (0.65, 0.24)  # length and width, as drawn
FAR_M = 5.0  # distances to obstacles beyond this are not printed
KPH = 3.6
FULL = 1.0  # friction use at µg
FONT = 10.0  # points
NAME_LENGTH = 17  # characters of the name of a run that fit; a longer one is written smaller
WARN = 0.9  # friction use from which the bar is orange
WHEEL_ICON_PX = (34.0, 11.0)
BAR_PX = (84.0, 11.0)


class Camera(NamedTuple):
    """Where the camera looks at one moment."""

    x: float  # m, of the point in the middle of the road beside the car
    y: float  # m
    heading: float  # rad, of the road


class Strip:
    """The artists of one run on two axes: `panel` for its numbers, counted in pixels, `road`."""

    def __init__(self, panel, road, run: Run, log: ControllerLog, window_m: float = WINDOW_M):
        self.run, self.log, self.window_m = run, log, window_m
        self.t = run.series.t
        self.cameras = _cameras(run)
        self.use = friction_use(EvaluatedRun(run.drive, run.series, {}))
        self.steer = _steer(run)
        self.nearest = _nearest(run)
        step = float(np.median(np.diff(self.t))) if len(self.t) > 1 else TRAIL_S
        self.every = max(1, round(TRAIL_S / step))
        self.view = Affine2D()
        self._draw_road(road)
        self._draw_movers(road)
        self._draw_panel(panel)

    def show(self, t: float) -> None:
        """Move everything to the time t [s]; after the end of the run its last state stays."""
        at = {name: np.interp(t, self.t, column) for name, column in self._columns().items()}
        camera = Camera(*(np.interp(t, self.t, column) for column in self.cameras))
        self.view.clear().translate(-camera.x, -camera.y).rotate(-camera.heading)
        self._show_car(at)
        self._show_plan(t)
        self._show_obstacles(t)
        self._show_numbers(at, t)

    def _columns(self):
        motion = self.run.drive.motion
        columns = {'x': motion.x, 'y': motion.y, 'yaw': np.unwrap(motion.yaw)}
        columns |= {'speed': self.run.series.speed, 'steer': self.steer, 'nearest': self.nearest}
        return columns | ({} if self.use is None else {'use': self.use})

    def _draw_road(self, ax):
        scene, facts = self.run.drive.scene, self.run.drive.facts
        self.in_world = self.view + ax.transData
        world = {'transform': self.in_world}
        half, window = half_width(self.run, self.window_m), self.window_m
        ax.set(xlim=(-BEHIND * window, (1 - BEHIND) * window), ylim=(-half, half))
        ax.set_axis_off()
        surface = np.concatenate([scene.left, scene.right[::-1]])
        ax.add_patch(Polygon(surface, fc='#F0F0EE', ec='none', zorder=0, **world))
        keep_off = facts.vehicle_radius + facts.safe_edge
        for edge, inside in ((scene.left, -1.0), (scene.right, 1.0)):
            strip = [edge, geometry.offset_polyline(edge, inside * keep_off)[::-1]]
            look = {'fc': (style.UNSAFE, 0.18), 'ec': 'none'}
            ax.add_patch(Polygon(np.concatenate(strip), zorder=0.5, **look, **world))
            ax.plot(*edge.T, color=style.EDGE, lw=1.6, zorder=2, **world)
            posts = _posts(edge, -inside)
            ax.add_collection(
                LineCollection(posts, colors=style.EDGE, lw=1.2, zorder=2, **world), autolim=False
            )
        ax.plot(*scene.reference.T, **style.coarse_path_line(), **world)

    def _draw_movers(self, ax):
        facts, run = self.run.drive.facts, self.run
        world = {'transform': self.in_world}
        self.obstacles = []
        for obstacle in run.drive.scene.obstacles:
            touch = obstacle.radius + facts.vehicle_radius
            discs = [
                Circle((0, 0), touch + facts.safe_obstacle, fc='#FBE7BD', ec=style.UNSAFE, lw=0.8),
                Circle((0, 0), touch, fc='#F5C9BC', ec=style.COLLISION, lw=0.8),
                Circle((0, 0), obstacle.radius, fc=style.EDGE, ec='none'),
            ]
            for disc in discs:
                disc.set(transform=self.in_world, zorder=1.5)
                ax.add_patch(disc)
            self.obstacles.append((obstacle, discs))
        (self.driven,) = ax.plot([], [], color=run.colour, lw=1.6, zorder=3, **world)
        (self.plan,) = ax.plot(
            [], [], 'o', ms=3.2, mec='none', color=run.colour, zorder=3.5, **world
        )
        look = {'fc': 'white', 'ec': run.colour, 'lw': 1.8}
        self.body = ax.add_patch(Polygon([[0, 0]], zorder=4, **look, **world))
        self.wheels = [
            ax.add_patch(Polygon([[0, 0]], fc=style.INK, ec='none', zorder=4.2, **world))
            for _ in self._wheel_places()
        ]
        self.circles = [
            ax.add_patch(
                Circle((0, 0), facts.vehicle_radius, fc='none', ec=run.colour, zorder=4.4, **world)
            )
            for _ in facts.circles
        ]

    def _draw_panel(self, ax):
        height = ax.get_ylim()[1]
        rows = [height * share for share in (0.84, 0.60, 0.38, 0.16)]
        text = {'fontsize': FONT, 'va': 'center', 'color': style.INK}
        ax.set_axis_off()
        name = {'color': self.run.colour, 'weight': 'bold'}
        name['fontsize'] = FONT * min(1.0, NAME_LENGTH / len(self.run.name))
        ax.text(6, rows[0], self.run.name, **text | name)
        self.speed = ax.text(6, rows[1], '', **text)
        self.distance = ax.text(78, rows[1], '', **text)
        ax.text(6, rows[2], 'friction', **text)
        place = 62, rows[2] - BAR_PX[1] / 2
        ax.add_patch(Rectangle(place, *BAR_PX, fc='#E8E8E8', ec='none'))
        self.bar = ax.add_patch(Rectangle(place, 0.0, BAR_PX[1], ec='none'))
        ax.plot([place[0] + BAR_PX[0]] * 2, rows[2] + np.array([-9, 9]), color=style.INK, lw=1.2)
        ax.text(6, rows[3], 'steering', **text)
        self.icon_at = 68 + WHEEL_ICON_PX[0] / 2, rows[3]
        self.icon = ax.add_patch(Polygon([[0, 0]], fc=style.INK, ec='none'))
        self.angle = ax.text(112, rows[3], '', **text)

    def _wheel_places(self):
        """Return the wheels' middles [m] ahead and to the left, the front ones first."""
        facts = self.run.drive.facts
        if facts.wheels:
            return facts.wheels
        half = facts.outline.width / 2 - WHEEL_M[1] / 2
        ahead = 0.6 * facts.outline.front, -0.6 * facts.outline.rear
        return tuple((x, side * half) for x in ahead for side in (1.0, -1.0))

    def _show_car(self, at):
        pose = at['x'], at['y'], at['yaw']
        outline = self.run.drive.facts.outline
        half = outline.width / 2
        # the front is bevelled: one sees where the car points
        self.body.set_xy(
            _placed(
                np.array(
                    [
                        [-outline.rear, half],
                        [outline.front - 0.5 * half, half],
                        [outline.front, 0.55 * half],
                        [outline.front, -0.55 * half],
                        [outline.front - 0.5 * half, -half],
                        [-outline.rear, -half],
                    ]
                ),
                *pose,
            )
        )
        for patch, (ahead, left) in zip(self.wheels, self._wheel_places()):
            turned = _rotated(_box(WHEEL_M), at['steer'] if ahead > 0 else 0.0)
            patch.set_xy(_placed(np.add(turned, (ahead, left)), *pose))
        touching = at['nearest'] < 0.0
        for patch, ahead in zip(self.circles, self.run.drive.facts.circles):
            patch.center = tuple(_placed(np.array([[ahead, 0.0]]), *pose)[0])
            patch.set(
                ec=style.COLLISION if touching else self.run.colour, lw=2.2 if touching else 0.7
            )

    def _show_plan(self, t):
        motion = self.run.drive.motion
        now_ns = motion.stamp_ns[0] + round(t * NS_PER_S)
        past = np.searchsorted(motion.stamp_ns, now_ns, side='right')
        shown = slice(0, past, self.every)
        self.driven.set_data(motion.x[shown], motion.y[shown])
        plans = [plan for plan in self.log.predictions if plan.stamp_ns <= now_ns]
        X, Y = (plans[-1].X[::2], plans[-1].Y[::2]) if plans else ([], [])
        self.plan.set_data(X, Y)

    def _show_obstacles(self, t):
        motion, scene = self.run.drive.motion, self.run.drive.scene
        stamp_ns = motion.stamp_ns[0] + round(min(t, self.t[-1]) * NS_PER_S)
        for obstacle, discs in self.obstacles:
            x, y = obstacle_position(obstacle, scene, np.array([stamp_ns]))
            for disc in discs:
                disc.set_visible(bool(np.isfinite(x[0])))
                disc.center = (float(x[0]), float(y[0]))

    def _show_numbers(self, at, t):
        self.speed.set_text(f'{KPH * at["speed"]:.0f} km/h')
        near = at['nearest'] < FAR_M
        self.distance.set_text(f'gap {at["nearest"]:.2f} m' if near else '')
        self.distance.set_color(style.COLLISION if at['nearest'] < 0.0 else style.INK)
        use = at.get('use', np.nan)
        share = min(use, 1.2 * FULL) if np.isfinite(use) else 0.0
        self.bar.set_width(BAR_PX[0] * share)
        self.bar.set_facecolor(style.UNSAFE if share > WARN else '#7C8A94')
        icon = _rotated(_box(WHEEL_ICON_PX), at['steer']) + self.icon_at
        self.icon.set_xy(icon)
        self.angle.set_text(f'{np.degrees(at["steer"]):+.1f}°')
        if t > self.t[-1] + 1e-9:
            self.speed.set_text('ended')


def _cameras(run):
    """Return columns x, y, heading (n,) of the cameras of a run, at the samples of its motion."""
    motion, scene = run.drive.motion, run.drive.scene
    points = np.column_stack([motion.x, motion.y])
    sides = []
    for edge in (scene.left, scene.right):
        along = geometry.arc_length(edge)
        foot = geometry.project_drive(points, edge, np.inf).distance
        sides.append((edge, along, foot))

    def at(side, distance):
        edge, along, _ = side
        return np.column_stack([np.interp(distance, along, axis) for axis in edge.T])

    middle = (at(sides[0], sides[0][2]) + at(sides[1], sides[1][2])) / 2
    begin, end = (sum(at(side, side[2] + ahead) for side in sides) for ahead in CHORD_M)
    heading = np.unwrap(np.arctan2(*(end - begin).T[::-1]))
    # beside the car along the road, in its middle across it
    across = np.column_stack([-np.sin(heading), np.cos(heading)])
    offset = np.sum((points - middle) * across, axis=1)
    centre = points - offset[:, None] * across
    return centre[:, 0], centre[:, 1], heading


def window(logs: Iterable[ControllerLog]) -> float:
    """Return how many metres along the road the camera shows: the longest plan is seen whole."""
    plans = [plan for log in logs for plan in log.predictions if len(plan.X)]
    reach = [np.hypot(plan.X - plan.X[0], plan.Y - plan.Y[0]).max() for plan in plans]
    return max(WINDOW_M, max(reach, default=0.0) / (1 - BEHIND))


def half_width(run: Run, window_m: float = WINDOW_M) -> float:
    """Return how many metres the camera shows to either side of the middle of the road.

    Obstacles in the window of `window_m` [m] along the road are in it, as far as its limit allows.
    """
    scene = run.drive.scene
    points = np.column_stack([run.drive.motion.x, run.drive.motion.y])[::50]
    width = np.zeros(len(points))
    for edge, inside in ((scene.left, -1.0), (scene.right, 1.0)):
        width += np.maximum(inside * geometry.distance_to_polyline(points, edge), 0.0)
    half = max(width.max() / 2, _farthest_obstacle(run, window_m))
    return float(np.clip(half + MARGIN_M, *HALF_WIDTHS_M))


def _farthest_obstacle(run, window_m):
    """Return the largest distance [m] to an obstacle in the window from the road's middle."""
    every = slice(None, None, 50)
    x, y, heading = (column[every] for column in _cameras(run))
    ahead = np.array([np.cos(heading), np.sin(heading)])
    left = np.array([-ahead[1], ahead[0]])
    farthest = 0.0
    for obstacle in run.drive.scene.obstacles:
        at = obstacle_position(obstacle, run.drive.scene, run.drive.motion.stamp_ns[every])
        offset = np.array([at[0] - x, at[1] - y])
        along, across = np.sum(offset * ahead, axis=0), np.abs(np.sum(offset * left, axis=0))
        seen = (along > -BEHIND * window_m) & (along < (1 - BEHIND) * window_m)
        farthest = max(farthest, np.max(across[seen], initial=0.0))
    return farthest


def _posts(edge, outwards):
    """Return segments (n, 2, 2) [m] across an edge, every POST_M of it."""
    along = geometry.arc_length(edge)
    places = np.arange(0.0, along[-1], POST_M)
    foot = np.column_stack([np.interp(places, along, axis) for axis in edge.T])
    ahead = np.column_stack([np.interp(places + 0.1, along, axis) for axis in edge.T])
    forward = ahead - foot
    length = np.hypot(*forward.T)
    foot, forward = foot[length > 0], forward[length > 0] / length[length > 0, None]
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    return np.stack([foot, foot + outwards * POST_LENGTH_M * left], axis=1)


def _steer(run):
    inputs = run.drive.inputs
    if not inputs.stamp_ns.size:
        return np.zeros(len(run.series.t))
    return np.interp(run.drive.motion.stamp_ns, inputs.stamp_ns, inputs.steer)


def _nearest(run):
    gaps = [np.full(len(run.series.t), np.inf), *run.series.v2o.values()]
    return np.minimum(np.fmin.reduce(gaps), 1e3)


def _box(size):
    length, width = size
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]])
    return corners * [length / 2, width / 2]


def _rotated(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def _placed(points, x, y, yaw):
    return np.add(_rotated(points, yaw), (x, y))
