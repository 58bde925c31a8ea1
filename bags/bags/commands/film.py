"""Make a film of runs from above, as GIF or MP4: a strip of road per run, at the same time."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

HELP = 'film of runs from above, as GIF or MP4'
EXAMPLE = 'bags film bags/runs/double_lane_change/mpcc --out film.gif'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags film`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument(
        '--out', type=Path, required=True, metavar='FILE', help='film.gif, or film.mp4 with ffmpeg'
    )
    parser.add_argument(
        '--width', type=int, default=800, metavar='PX', help='480 to 1920 (default: 800)'
    )
    parser.add_argument('--fps', type=float, default=12.5, help='frames per second (default: 12.5)')
    parser.add_argument(
        '--speed',
        type=float,
        default=1.0,
        help='seconds of the drive per second of the film (default: 1)',
    )
    parser.add_argument(
        '--from', type=float, default=0.0, dest='begin', metavar='S', help='begin of the film [s]'
    )
    parser.add_argument(
        '--to', type=float, dest='end', metavar='S', help='end of the film [s] (default: all)'
    )


def run(args: argparse.Namespace) -> int:
    """Make the film and say how large it is. Raises BagError."""
    from bags.figures.film import FilmOptions

    options = FilmOptions(args.width, args.fps, args.speed, args.begin, args.end)
    frames = film_bags(args.bags, args.out, options)
    print(f'{args.out}: {frames} frames, {args.out.stat().st_size / 1e6:.2f} MB')
    return 0


def film_bags(paths: Sequence[Path | str], out: Path, options: Any) -> int:
    """Write a film of the bags at `paths`, one below the other; return how many frames it has.

    The runs may be of different scenarios: each is seen on its own road. Raises BagError for bags
    that cannot be evaluated, and for what `film.check` refuses (`options`: a `film.FilmOptions`).
    """
    from bags.figures import film, panels
    from bags.report.comparison import load_runs

    film.check(out, options)
    return film.write_film(panels.assign(load_runs(paths)), out, options)
