"""A film of runs as GIF or MP4: a strip of road per run, all at the same time, and a key."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from bags.errors import BagError
from bags.evaluation.controller_log import EMPTY_LOG, ControllerLog
from bags.figures import film_strip, style
from bags.figures.film_strip import Strip
from bags.figures.panels import Run

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


class FilmOptions(NamedTuple):
    """What of the runs is shown, and how."""

    width_px: int = 800
    fps: float = 12.5  # frames per second of the film
    speed: float = 1.0  # seconds of the drive per second of the film
    begin_s: float = 0.0
    end_s: float | None = None  # None: the end of the longest run


class Range(NamedTuple):
    """Allowed values of an option."""

    low: float
    high: float


RANGES: Mapping[str, Range] = {
    'width_px': Range(480, 1920),
    'fps': Range(1, 50),
    'speed': Range(0.05, 10),
}


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
    for name, allowed in RANGES.items():
        value = getattr(options, name)
        if not allowed.low <= value <= allowed.high:
            raise BagError(f'{name} is {value:g}; allowed {allowed.low:g} to {allowed.high:g}')


def write_film(
    runs: Sequence[Run], logs: Mapping[str, ControllerLog], out: Path, options: FilmOptions
) -> int:
    """Write the film of runs as GIF or MP4, by the name of the file; return how many frames it has.

    `logs` by run: without one the strip of a run shows no plan. Raises BagError for what `check`
    refuses, and for a time span without a frame.
    """
    check(out, options)
    times = frame_times(runs, options)
    with mpl.rc_context(style.RC):
        figure, strips, clock = _sheet(runs, logs, options)
        write = _write_gif if out.suffix.lower() == GIF else _write_mp4
        write(out, figure, _shown(strips, clock, times), options)
    return len(times)


def frame_times(runs: Sequence[Run], options: FilmOptions) -> np.ndarray:
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


def _shown(strips, clock, times) -> Iterator[float]:
    """Yield each time after everything was moved to it."""
    for t in times:
        for strip in strips:
            strip.show(float(t))
        clock.set_text(f'{t:.1f} s')
        yield t


def _sheet(runs, logs, options):
    """Return the figure, its strips, and the text of the time."""
    width = options.width_px
    road = width - PANEL_PX
    window = film_strip.window(logs.values())
    halves = [film_strip.half_width(run, window) for run in runs]
    heights = [max(LEAST_STRIP_PX, round(2 * half * road / window)) for half in halves]
    total = sum(heights) + GAP_PX * len(runs) + KEY_PX
    total += total % 2  # video wants even sizes
    figure = Figure(figsize=(width / DPI, total / DPI), dpi=DPI)
    FigureCanvasAgg(figure)

    def axes(left, bottom, size, **limits):
        place = left / width, bottom / total, size[0] / width, size[1] / total
        return figure.add_axes(place, **limits)

    strips, bottom = [], total
    for run, height in zip(runs, heights):
        bottom -= height + GAP_PX
        panel = axes(0, bottom, (PANEL_PX, height), xlim=(0, PANEL_PX), ylim=(0, height))
        log = logs.get(run.name, EMPTY_LOG)
        strip = Strip(panel, axes(PANEL_PX, bottom, (road, height)), run, log, window)
        strips.append(strip)
    clock = figure.text(6 / width, KEY_PX / 2 / total, '', fontsize=film_strip.FONT, va='center')
    _key(figure, PANEL_PX / width, KEY_PX / total)
    return figure, strips, clock


def _key(figure, left, height):
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
        bbox_to_anchor=(left, 0.0, 1.0 - left, height),
        ncols=len(keys),
        handlelength=1.8,
        columnspacing=1.4,
        borderaxespad=0.0,
        fontsize=film_strip.FONT - 1,
    )


def _write_gif(out, figure, frames, options):
    pictures = []
    for _ in frames:
        figure.canvas.draw()
        pictures.append(Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3]))
    few = pictures[:: max(1, len(pictures) // SAMPLES)]
    sample = Image.fromarray(np.concatenate([np.asarray(picture) for picture in few]))
    # one palette for all frames and no dithering: what stands still is the same in every frame
    palette = sample.quantize(COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    drawn = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    each = _frame_ms(options)
    durations = [each] * (len(drawn) - 1) + [max(each, HOLD_MS)]
    first, *others = drawn
    first.save(out, save_all=True, append_images=others, duration=durations, loop=0, optimize=False)


def _write_mp4(out, figure, frames, options):
    writer = FFMpegWriter(fps=1e3 / _frame_ms(options))
    with writer.saving(figure, str(out), DPI):
        for _ in frames:
            writer.grab_frame()
