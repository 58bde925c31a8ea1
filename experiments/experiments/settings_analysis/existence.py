"""`experiments study exists`: does any setting show the paper's whole picture?

The search chooses by the distance, so that its best distance is too good. What it finds is judged
again by drives that nobody chose from: fresh perturbations of the start, and neighbours in which
every number differs a little. Existence is not typicality: the share of settings is another table.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from experiments.batch.distributions import Choice
from experiments.pool import Pool
from experiments.settings import setting as settings
from experiments.settings.preregistration import Perturbation, Preregistration
from experiments.settings.setting import Rejected
from experiments.settings_analysis import picture_search
from experiments.settings_analysis.picture import Picture
from experiments.settings_analysis.picture_search import Candidate


class Judged(NamedTuple):
    """A found setting, judged on drives that it was not chosen from."""

    candidate: Candidate
    distances: tuple[float, ...]  # from the picture, of the perturbations
    neighbours: tuple[float, ...]  # of the neighbours
    near: float  # a distance up to which a neighbour counts as near

    @property
    def median(self) -> float:
        """The median distance over the perturbations."""
        return float(np.median(self.distances))

    @property
    def whole(self) -> float:
        """The share of the perturbations that show the whole picture."""
        return float(np.mean([distance == 0.0 for distance in self.distances]))

    @property
    def near_share(self) -> float:
        """The share of the neighbours that are near to the picture."""
        return float(np.mean([distance <= self.near for distance in self.neighbours]))


def hold_out(
    plan: Preregistration, picture: Picture, candidates: Sequence[Candidate], pool: Pool
) -> list[Judged]:
    """Judge the best of the candidates of a search by fresh drives; the chosen one is the first.

    The order is that of the rule for the demo in the picture's file.
    """
    kept = [candidate for candidate in candidates if not candidate.rejected]
    best = sorted(kept, key=lambda candidate: candidate.distance)[: picture.hold_out.best]
    tasks = []
    for candidate in best:
        base = (plan, picture, candidate.number)
        tasks += [(*base, candidate.values, start) for start in _starts(picture, candidate)]
        tasks += [(*base, values) for values in neighbours(plan, picture, candidate)]
    driven = [again.distance for again in pool.run(picture_search.judge, tasks, lambda: None)]
    judged, size = [], picture.hold_out.perturbations
    count = size + picture.hold_out.neighbours
    for k, candidate in enumerate(best):
        own = driven[k * count : (k + 1) * count]
        judged.append(Judged(candidate, tuple(own[:size]), tuple(own[size:]), picture.demo.near))
    return sorted(
        judged, key=lambda result: (result.median, -result.near_share, result.candidate.number)
    )


def _starts(picture, candidate):
    chosen = picture.hold_out
    rng = np.random.default_rng((chosen.seed, candidate.number, 0))
    shares = rng.uniform(-1.0, 1.0, (chosen.perturbations, 2))
    return [
        Perturbation(speed_mps=float(speed) * chosen.speed_mps, y_m=float(y) * chosen.y_m)
        for speed, y in shares
    ]


def neighbours(
    plan: Preregistration, picture: Picture, candidate: Candidate
) -> list[dict[str, Any]]:
    """Return the values of neighbours: numbers times 1 -+ `ratio`, choices as they are.

    Numbers stay within the ranges of the study.
    """
    chosen = picture.hold_out
    rng = np.random.default_rng((chosen.seed, candidate.number, 1))
    result = []
    for _ in range(chosen.neighbours):
        values = dict(candidate.values)
        for name, kind in plan.dimensions.items():
            if isinstance(kind, Choice):
                continue
            low, high = kind.ends()[0], kind.ends()[-1]
            factor = 1.0 + rng.uniform(-chosen.ratio, chosen.ratio)
            values[name] = float(np.clip(values[name] * factor, low, high))
        result.append(values)
    return result


def demo_verdict(judged: Sequence[Judged], picture: Picture) -> str:
    """Return what becomes of the best judged setting by the rule of the picture's file."""
    if not judged:
        return 'no setting could be driven'
    first = judged[0]
    if first.whole == 1.0:
        return 'the whole picture exists'
    if first.median < picture.demo.accept:
        return 'the whole picture was not found; the nearest setting becomes the demo'
    return 'the whole picture was not found; no setting is near enough to become the demo'


def write_setting(plan: Preregistration, candidate: Candidate, folder: Path) -> list[Path]:
    """Write the scenario and the values of a candidate as files; return their paths."""
    built = settings.build(plan, candidate.number, candidate.values)
    assert not isinstance(built, Rejected), candidate
    folder.mkdir(parents=True, exist_ok=True)
    scenario, values = folder / 'nearest_scenario.yaml', folder / 'nearest_setting.yaml'
    scenario.write_text(built.text)
    values.write_text(yaml.safe_dump(dict(candidate.values), sort_keys=False))
    return [scenario, values]


def as_rows(judged: Sequence[Judged]) -> list[Mapping[str, Any]]:
    """Return one flat row per judged setting: distances, shortfalls, features, values."""
    return [
        {
            'trial': result.candidate.number,
            'distance': result.candidate.distance,
            'median_distance': result.median,
            'greatest_distance': max(result.distances),
            'whole_picture_share': result.whole,
            'near_neighbours_share': result.near_share,
            **{f'missed.{name}': value for name, value in result.candidate.missed.items()},
            **{f'feature.{name}': value for name, value in result.candidate.features.items()},
            **{f'value.{name}': value for name, value in result.candidate.values.items()},
        }
        for result in judged
    ]
