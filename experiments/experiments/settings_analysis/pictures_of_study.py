"""Where the search for the paper's picture begins: settings that were driven, and random ones."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import pandas as pd

from experiments.settings import setting as settings
from experiments.settings.preregistration import Preregistration
from experiments.settings.setting import Setting
from experiments.settings_analysis import picture as pictures
from experiments.settings_analysis.picture import Picture
from experiments.settings_analysis.study_tables import Study

ADMISSIBLE_SHARE = 0.02  # of the drawn points, at least


def nearest(study: Study, picture: Picture) -> list[dict[str, Any]]:
    """Return the values of the settings of a study that are nearest to the picture.

    Their table does not hold the stations of overshoots, so that those items do not count.
    """
    names = pictures.arms_of(picture)
    undisturbed = study.drives[(study.drives['perturbation'] == 0) & (study.drives['error'] == '')]
    table = undisturbed[undisturbed['arm'].isin(names)]
    distances = {}
    for number, rows in table.groupby('setting'):
        driven = {row['arm']: _known(row) for row in rows.to_dict('records')}
        if len(driven) == len(names):
            measured = [driven[name] | {pictures.OVERSHOOTS: []} for name in names]
            values = measured[0]
            features = pictures.features(*measured, values, picture.stations)
            distances[number] = pictures.distance(pictures.shortfalls(features, picture))
    best = sorted(distances, key=distances.get)[: picture.search.starts]
    dimensions = list(study.plan.dimensions)
    rows = table.drop_duplicates('setting').set_index('setting')[dimensions]
    return [_known(rows.loc[number].to_dict()) for number in best]


def _known(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with None where a data frame has NaN."""
    return {name: None if pd.isna(value) else value for name, value in row.items()}


def admissible_points(plan: Preregistration, picture: Picture, trials: int) -> list[dict[str, Any]]:
    """Return the first admissible settings of the search's seed, those that it tries at random."""
    wanted = min(picture.search.random, trials)
    points: list[dict[str, Any]] = []
    drawn = settings.draw(plan, picture.search.seed, 0, int(wanted / ADMISSIBLE_SHARE))
    for number, values in enumerate(drawn):
        if isinstance(settings.build(plan, number, values), Setting):
            points.append(values)
        if len(points) == wanted:
            break
    return points


def with_hold_out(picture: Picture, **changes: int) -> Picture:
    """Return a picture that judges what is found by another number of drives."""
    return dataclasses.replace(picture, hold_out=dataclasses.replace(picture.hold_out, **changes))
