"""The lateral acceleration that a plant holds in a steady turn: a property of car and road."""

import json
import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from experiments import code_version
from node_runtime import parameters, provenance
from stage_solver import compile_cache
from vehicle_plant import circular_driving, identify
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.circular_driving import CircleError
from vehicle_plant.parameters import PlantParams

MANOEUVRE = 'identify.yaml'
ROOTS = ('vehicle_plant.circular_driving', __name__)  # decide how a plant drives it
GRID = 10  # frictions at which a plant drives the circle, per 1; linear between them to 0.2 %


def lateral_limit(plant: PlantParams, friction: float = 1.0) -> float:
    """Return the peak lateral acceleration [m/s^2] of quasi-steady circular driving (ISO 4138).

    The manoeuvre is that of `identify` (config/identify.yaml of vehicle_plant): the steering angle
    increases slowly until the front axle slides. Raises CircleError when it does not.
    """
    file = plant_parameters.config_file(MANOEUVRE)
    manoeuvre = parameters.load(circular_driving.CircleParams, file)
    return float(circular_driving.drive(plant, friction, manoeuvre).column('acceleration.ay').max())


def held_lateral_limit(plant: PlantParams, friction: float) -> float | None:
    """Return the `lateral_limit` at any friction, interpolated between those of a grid.

    A drive of the circle takes as long as a run: of a plant each friction of the grid is driven
    once, and kept beside the compiled solvers. None for a plant that cannot drive the circle.
    """
    at = friction * GRID
    # the lowest friction of all, 0.05, is below the grid
    steps = (at,) if at < 1 else (float(np.floor(at)), float(np.ceil(at)))
    limits = [_limit_at(plant, step) for step in steps]
    return None if None in limits else float(np.interp(at, steps, limits))


@lru_cache(maxsize=256)
def _limit_at(plant, step):

    def find():
        try:
            return json.dumps(lateral_limit(plant, step / GRID))
        except CircleError:
            return json.dumps(None)

    manoeuvre = plant_parameters.config_file(MANOEUVRE).read_text()
    content = repr((identify.digest(plant), step, code_version.digest(ROOTS), manoeuvre))
    return json.loads(kept_text('lateral_limits/{}.json', content, find).read_text())


def kept_text(name: str, content: str, make: Callable[[], str]) -> Path:
    """Return a file beside the compiled solvers with the text of `make()`, made where it is not.

    The digest of `content`, all that decides the text, is put into the `name`.
    """
    file = compile_cache.cache_dir() / name.format(provenance.digest(content))
    if not file.is_file():
        text = make()
        file.parent.mkdir(parents=True, exist_ok=True)
        # written whole or not at all, also when another process writes the same text; other users
        # of the folder may read it, unlike a file of `tempfile`
        part = file.with_suffix(f'.{os.getpid()}.part')
        part.write_text(text)
        os.replace(part, file)
    return file
