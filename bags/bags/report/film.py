"""A film of recorded runs, from their bags."""

import warnings
from collections.abc import Sequence
from pathlib import Path

from bags.errors import DamagedBagWarning
from bags.evaluation.controller_log import read_controller_log
from bags.evaluation.drive import drive_from_bag, drop_nonfinite
from bags.figures import film, panels
from bags.report.comparison import name_runs
from bags.storage import read
from bags.storage.invalid_messages import drop_invalid


def film_bags(paths: Sequence[Path | str], out: Path, options: film.FilmOptions) -> int:
    """Write a film of the bags at `paths`, one below the other; return how many frames it has.

    The runs may be of different scenarios: each is seen on its own road. Raises BagError for bags
    that cannot be evaluated, and for what `film.check` refuses.
    """
    film.check(out, options)
    with warnings.catch_warnings():
        # a film of what can be read
        warnings.simplefilter('ignore', DamagedBagWarning)
        loaded = [drop_invalid(read.load(path)) for path in paths]
    drives = [drop_nonfinite(drive_from_bag(bag)) for bag in loaded]
    names = name_runs(paths, [drive.facts.controller for drive in drives])
    logs = {name: read_controller_log(bag) for name, bag in zip(names, loaded)}
    return film.write_film(panels.evaluate_runs(dict(zip(names, drives))), logs, out, options)
