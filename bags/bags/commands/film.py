"""Make a film of runs from above, as GIF or MP4: a strip of road per run, at the same time."""

import argparse
from pathlib import Path

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
    """Make the film, a strip per bag, and say how large it is. Raises BagError.

    The runs may be of different scenarios: each is seen on its own road.
    """
    from bags.figures import film, style
    from bags.report.comparison import load_runs

    options = film.FilmOptions(args.width, args.fps, args.speed, args.begin, args.end)
    film.check(args.out, options)
    frames = film.write_film(style.assign(load_runs(args.bags)), args.out, options)
    print(f'{args.out}: {frames} frames, {args.out.stat().st_size / 1e6:.2f} MB')
    return 0
