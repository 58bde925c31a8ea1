"""A film of runs as GIF or MP4: a strip of road per run, all at the same time, and a key.

The camera follows the car along the road and is turned with the road, so that the car drives to
the right in every scenario; both directions have equal scales. It sees as far ahead as the car
plans, and the obstacles there: what the car reacts to is in the film.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.transforms import Affine2D
from PIL import Image

from bags.errors import BagError
from bags.evaluation import geometry
from bags.evaluation.drive import PREDICTION
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.signals import friction_use
from bags.figures import scene, style

DPI = 100
PANEL_PX = 172  # of the numbers beside the road
LEAST_STRIP_PX = 104
GAP_PX = 6
KEY_PX = 26
COLOURS = 128  # of the palette of a GIF
SAMPLES = 8  # frames that the palette is made of
CENTISECOND_MS = 10  # the times of a GIF are multiples of it
HOLD_MS = 1500  # how long the last frame of a GIF stays
GIF, MP4 = '.gif', '.mp4'
WINDOW_M = 52.0  # of the road, along it, at least
BEHIND = 0.28  # share of the window behind the car
HALF_WIDTHS_M = (4.0, 14.0)  # of the road, that the camera shows
MARGIN_M = 1.2  # beyond the edges
CHORD_M = (-10.0, 35.0)  # of the edge, from the car: its direction is that of the camera
POST_M = 10.0  # between two posts at an edge, which show that the car moves
POST_LENGTH_M = 0.7
CAMERA_EVERY = 50  # of the samples of the drive, where only the size of the picture depends on it
FAR_M = 5.0  # distances to obstacles beyond this are not printed
KPH = 3.6
FULL = 1.0  # friction use at µg
FONT = 10.0  # points
NAME_LENGTH = 17  # characters of the name of a run that fit; a longer one is written smaller
WARN = 0.9  # friction use from which the bar is orange
WHEEL_ICON_PX = (34.0, 11.0)
BAR_PX = (84.0, 11.0)
LOOKS = {  # by kind of a shape; `colour` stands for that of the run
    'road': {'fc': '#F0F0EE', 'ec': 'none', 'zorder': 0},
    'strip': {'fc': (style.UNSAFE, 0.18), 'ec': 'none', 'zorder': 0.5},
    'edge': {'color': style.EDGE, 'lw': 1.6, 'zorder': 2},
    'path': style.coarse_path_line(),
    'unsafe': {'fc': '#FBE7BD', 'ec': style.UNSAFE, 'lw': 0.8, 'zorder': 1.5},
    'touch': {'fc': '#F5C9BC', 'ec': style.COLLISION, 'lw': 0.8, 'zorder': 1.5},
    'obstacle': {'fc': style.EDGE, 'ec': 'none', 'zorder': 1.5},
    'trail': {'color': 'colour', 'lw': 1.6, 'zorder': 3},
    'plan': {'color': 'colour', 'ls': '', 'marker': 'o', 'ms': 3.2, 'mec': 'none', 'zorder': 3.5},
    'body': {'fc': 'white', 'ec': 'colour', 'lw': 1.8, 'zorder': 4},
    'wheel': {'fc': style.INK, 'ec': 'none', 'zorder': 4.2},
    'circle': {'fc': 'none', 'ec': 'colour', 'zorder': 4.4},
}


class FilmOptions(NamedTuple):
    """What of the runs is shown, and how."""

    width_px: int = 800
    fps: float = 12.5  # frames per second of the film
    speed: float = 1.0  # seconds of the drive per second of the film
    begin_s: float = 0.0
    end_s: float | None = None  # None: the end of the longest run


RANGES = {'width_px': (480, 1920), 'fps': (1, 50), 'speed': (0.05, 10)}  # allowed


def check(out: Path, options: FilmOptions) -> None:
    """Raise BagError for a file or an option that no film can be made with."""
    if out.suffix.lower() not in (GIF, MP4):
        raise BagError(f'{out}: a film ends with {GIF} or {MP4}')
    if not out.parent.is_dir():
        raise BagError(f'{out}: there is no folder {out.parent}')
    if out.suffix.lower() == MP4 and shutil.which(mpl.rcParams['animation.ffmpeg_path']) is None:
        raise BagError(
            f'{out}: {MP4} needs the program ffmpeg, which is not installed (Debian and Ubuntu: '
            f'apt install ffmpeg); {GIF} needs nothing more'
        )
    for name, (low, high) in RANGES.items():
        value = getattr(options, name)
        if not low <= value <= high:
            raise BagError(f'{name} is {value:g}; allowed {low:g} to {high:g}')


def write_film(runs: Sequence[EvaluatedDrive], out: Path, options: FilmOptions) -> int:
    """Write the film of runs as GIF or MP4, by the name of the file; return how many frames it has.

    A run without predictions shows no plan. Raises BagError for what `check` refuses, and for a
    time span without a frame.
    """
    check(out, options)
    times, frame_ms = frame_times(runs, options), _frame_ms(options)
    with mpl.rc_context(style.RC):
        figure, strips, clock = _sheet(runs, options.width_px)

        def frames():
            for t in times.tolist():
                for strip in strips:
                    strip.show(t)
                clock.set_text(f'{t:.1f} s')
                yield

        if out.suffix.lower() == MP4:
            writer = FFMpegWriter(fps=1e3 / frame_ms)
            with writer.saving(figure, str(out), DPI):
                for _ in frames():
                    writer.grab_frame()
            return len(times)
        pictures = []
        for _ in frames():
            figure.canvas.draw()
            pictures.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3]))
    few = pictures[:: max(1, len(pictures) // SAMPLES)]
    sample = Image.fromarray(np.concatenate([np.asarray(picture) for picture in few]))
    # one palette for all frames and no dithering: what stands still is the same in every frame
    plain = {'dither': Image.Dither.NONE}
    palette = sample.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, **plain)
    first, *others = [picture.quantize(palette=palette, **plain) for picture in pictures]
    durations = [frame_ms] * len(others) + [max(frame_ms, HOLD_MS)]
    first.save(out, save_all=True, append_images=others, duration=durations, loop=0, optimize=False)
    return len(times)


def frame_times(runs: Sequence[EvaluatedDrive], options: FilmOptions) -> np.ndarray:
    """Return the times of the drive [s] that the frames show. Raises BagError without any."""
    longest = max(float(run.series.t[-1]) for run in runs)
    end = longest if options.end_s is None else min(options.end_s, longest)
    if not 0.0 <= options.begin_s < end:
        raise BagError(
            f'no frame lies between {options.begin_s:g} s and {end:g} s; the longest run takes '
            f'{longest:.2f} s'
        )
    step = options.speed * _frame_ms(options) / 1e3
    return np.arange(options.begin_s, end + step / 2, step)


def _frame_ms(options):
    return max(CENTISECOND_MS * round(1e3 / options.fps / CENTISECOND_MS), CENTISECOND_MS)


def _sheet(runs, width):
    """Return the figure, its strips, and the text of the time."""
    road, window_m = width - PANEL_PX, window(runs)
    heights = [
        max(LEAST_STRIP_PX, round(2 * half_width(run, window_m) * road / window_m)) for run in runs
    ]
    total = sum(heights) + GAP_PX * len(runs) + KEY_PX
    total += total % 2  # video wants even sizes
    figure = Figure(figsize=(width / DPI, total / DPI), dpi=DPI)
    FigureCanvasAgg(figure)
    strips, bottom = [], total
    for run, height in zip(runs, heights):
        bottom -= height + GAP_PX
        below, high = bottom / total, height / total
        limits = {'xlim': (0, PANEL_PX), 'ylim': (0, height)}
        panel = figure.add_axes((0, below, PANEL_PX / width, high), **limits)
        place = (PANEL_PX / width, below, road / width, high)
        strips.append(Strip(panel, figure.add_axes(place), run, window_m))
    clock = figure.text(6 / width, KEY_PX / 2 / total, '', fontsize=FONT, va='center')
    left = PANEL_PX / width
    keys = [
        Line2D([], [], label='coarse path', **style.coarse_path_line()),
        Line2D([], [], ls='', marker='o', ms=3, color=style.QUIET, label='plan'),
    ]
    keys += [
        Line2D([], [], color=colour, lw=7, alpha=0.35, label=label)
        for colour, label in style.AREAS.items()
    ]
    figure.legend(
        handles=keys,
        loc='center left',
        bbox_to_anchor=(left, 0.0, 1.0 - left, KEY_PX / total),
        ncols=len(keys),
        handlelength=1.8,
        columnspacing=1.4,
        borderaxespad=0.0,
        fontsize=FONT - 1,
    )
    return figure, strips, clock


class Strip:
    """The artists of one run on two axes: `panel` for its numbers, counted in pixels, `road`."""

    def __init__(self, panel, road, run: EvaluatedDrive, window_m: float = WINDOW_M):
        self.run, self.t = run, run.series.t
        self.cameras = _cameras(run)
        self.use = friction_use(run)
        self.view, self.artists = Affine2D(), {}
        drive, half = run.drive, half_width(run, window_m)
        road.set(xlim=(-BEHIND * window_m, (1 - BEHIND) * window_m), ylim=(-half, half))
        road.set_axis_off()
        keep_off = drive.facts.vehicle_radius + drive.facts.safe_edge
        edges = drive.scene.left, drive.scene.right
        for shape in scene.road_shapes(*edges, keep_off, drive.scene.reference):
            if shape.kind in LOOKS:
                self._draw(road, shape)
        for edge, outwards in zip(edges, (1.0, -1.0)):
            look = {'colors': style.EDGE, 'lw': 1.2, 'zorder': 2}
            world = {'transform': self.view + road.transData}
            posts = LineCollection(_posts(edge, outwards), **look, **world)
            road.add_collection(posts, autolim=False)
        for shape in scene.shapes_at(run, 0.0):
            self.artists[shape.kind, shape.number] = self._draw(road, shape)
        self._draw_panel(panel)

    def _draw(self, ax, shape):
        """Return the artist of a shape, in the world that the camera looks at."""
        colour = self.run.look.colour
        look = {k: colour if v == 'colour' else v for k, v in LOOKS[shape.kind].items()}
        look['transform'] = self.view + ax.transData
        if shape.radius:
            return ax.add_patch(Circle(shape.points, shape.radius, **look))
        if 'fc' in look:
            return ax.add_patch(Polygon(shape.points, **look))
        return ax.plot(*shape.points.T, **look)[0]

    def show(self, t: float) -> None:
        """Move everything to the time t [s]; after the end of the run its last state stays."""
        x, y, heading = (np.interp(t, self.t, column) for column in self.cameras)
        self.view.clear().translate(-x, -y).rotate(-heading)
        states = scene.states_at(self.run, np.array([t]))
        at = {name: float(column[0]) for name, column in states.items()}
        for shape in scene.shapes_at(self.run, t):
            artist = self.artists[shape.kind, shape.number]
            if shape.radius:
                artist.set_visible(bool(np.isfinite(shape.points).all()))
                artist.center = tuple(shape.points)
            elif 'fc' in LOOKS[shape.kind]:
                artist.set_xy(shape.points)
            else:
                artist.set_data(*shape.points.T)
            if shape.kind == 'circle':
                touching = at['nearest'] < 0.0
                colour = style.COLLISION if touching else self.run.look.colour
                artist.set(ec=colour, lw=2.2 if touching else 0.7)
        self._show_numbers(at, t)

    def _draw_panel(self, ax):
        height = ax.get_ylim()[1]
        rows = [height * share for share in (0.84, 0.60, 0.38, 0.16)]
        text = {'fontsize': FONT, 'va': 'center', 'color': style.INK}
        ax.set_axis_off()
        name = {'color': self.run.look.colour, 'weight': 'bold'}
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

    def _show_numbers(self, at, t):
        self.speed.set_text(f'{KPH * at["speed"]:.0f} km/h')
        near = at['nearest'] < FAR_M
        self.distance.set_text(f'gap {at["nearest"]:.2f} m' if near else '')
        self.distance.set_color(style.COLLISION if at['nearest'] < 0.0 else style.INK)
        use = np.nan if self.use is None else np.interp(t, self.t, self.use)
        share = min(use, 1.2 * FULL) if np.isfinite(use) else 0.0
        self.bar.set_width(BAR_PX[0] * share)
        self.bar.set_facecolor(style.UNSAFE if share > WARN else '#7C8A94')
        icon = geometry.transform_to_map(scene.box(WHEEL_ICON_PX), *self.icon_at, at['steer'])
        self.icon.set_xy(icon)
        self.angle.set_text(f'{np.degrees(at["steer"]):+.1f}°')
        if t > self.t[-1] + 1e-9:
            self.speed.set_text('ended')


def _cameras(run):
    """Return columns x, y [m], heading [rad] (n,) of the camera at the samples of the motion.

    It looks at the point in the middle of the road beside the car.
    """
    motion, road = run.drive.motion, run.drive.scene
    points = np.column_stack([motion.x, motion.y])
    sides = [
        (edge, geometry.project_drive(points, edge, np.inf).distance)
        for edge in (road.left, road.right)
    ]

    def at(ahead):
        return sum(_points_along(edge, foot + ahead) for edge, foot in sides)

    middle = at(0.0) / 2
    begin, end = map(at, CHORD_M)
    heading = np.unwrap(np.arctan2(*(end - begin).T[::-1]))
    # beside the car along the road, in its middle across it
    across = np.column_stack([-np.sin(heading), np.cos(heading)])
    offset = np.sum((points - middle) * across, axis=1)
    centre = points - offset[:, None] * across
    return *centre.T, heading


def _points_along(line, distance):
    """Return the points (n, 2) of a polyline at distances (n,) [m] along it."""
    along = geometry.arc_length(line)
    return np.column_stack([np.interp(distance, along, axis) for axis in line.T])


def window(runs: Sequence[EvaluatedDrive]) -> float:
    """Return how many metres along the road the camera shows: the longest plan is seen whole."""
    plans = [plan for run in runs for plan in run.sent(PREDICTION) if len(plan.X)]
    reach = [np.hypot(plan.X - plan.X[0], plan.Y - plan.Y[0]).max() for plan in plans]
    return max(WINDOW_M, max(reach, default=0.0) / (1 - BEHIND))


def half_width(run: EvaluatedDrive, window_m: float = WINDOW_M) -> float:
    """Return how many metres the camera shows to either side of the middle of the road.

    Obstacles in the window of `window_m` [m] along the road are in it, as far as its limit allows.
    """
    road, every = run.drive.scene, slice(None, None, CAMERA_EVERY)
    points = np.column_stack([run.drive.motion.x, run.drive.motion.y])[every]
    width = np.zeros(len(points))
    for edge, inside in ((road.left, -1.0), (road.right, 1.0)):
        width += np.maximum(inside * geometry.distance_to_polyline(points, edge), 0.0)
    x, y, heading = (column[every] for column in _cameras(run))
    ahead = np.array([np.cos(heading), np.sin(heading)])
    farthest = 0.0
    for place in scene.positions_at(run, run.series.t[every]):
        offset = place - [x, y]
        along = np.sum(offset * ahead, axis=0)
        across = np.abs(offset[1] * ahead[0] - offset[0] * ahead[1])
        seen = (along > -BEHIND * window_m) & (along < (1 - BEHIND) * window_m)
        farthest = max(farthest, np.max(across[seen], initial=0.0))
    return float(np.clip(max(width.max() / 2, farthest) + MARGIN_M, *HALF_WIDTHS_M))


def _posts(edge, outwards):
    """Return segments (n, 2, 2) [m] across an edge, every POST_M of it."""
    places = np.arange(0.0, geometry.arc_length(edge)[-1], POST_M)
    foot = _points_along(edge, places)
    forward = _points_along(edge, places + 0.1) - foot
    length = np.hypot(*forward.T)
    foot, forward = foot[length > 0], forward[length > 0] / length[length > 0, None]
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    return np.stack([foot, foot + outwards * POST_LENGTH_M * left], axis=1)
