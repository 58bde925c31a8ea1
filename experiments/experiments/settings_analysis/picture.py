"""The picture of the paper's double lane change as numbers, and how far three drives are from it.

The file that fixes it is config/paper_picture.yaml.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from bags.errors import BagError
from experiments.settings import arms
from msgs_yaml import share
from msgs_yaml.strict_yaml import Item, YamlError, parse_value, read
from node_runtime.parameters import Range, Struct

FILE = ('config', 'paper_picture.yaml')
Positive = Annotated[float, Range(1e-6, 1e6, '')]
Count = Annotated[int, Range(1, 1_000_000, '')]
Seed = Annotated[int, Range(0, 2**31 - 1, '')]
Metres = Annotated[float, Range(-1e4, 1e4, 'm')]

# what `features` computes
ITEMS = (
    *('no_ca_outline_1_m', 'mpcc_clear_m', 'baseline_clear_m'),
    *('least_limit_share', 'greatest_brake_share', 'mpcc_kept_m'),
    *('baseline_intrusion_2_m', 'baseline_intrusion_right_m'),
    *('baseline_overshoot_near_m', 'baseline_overshoot_far_m'),
    *('baseline_sideslip_deg', 'baseline_sideslip_off_m', 'mpcc_sideslip_deg'),
    *('onset_lead_m', 'speed_gain_mps', 'braking_gain_s', 'counter_steer_gain_s'),
)
OVERSHOOTS = 'overshoots_at_m'  # beside the columns of the study's table


class Bound(Struct):
    """The values of an item that belong to the picture, and what counts as one off it."""

    scale: Positive
    least: Annotated[float, Range(-1e4, 1e4, '')] = -math.inf
    most: Annotated[float, Range(-1e4, 1e4, '')] = math.inf

    def shortfall(self, value: float | None, cap: float) -> float:
        """Return by how many scales a value misses the bounds, at most `cap`; None misses by it."""
        if value is None or not math.isfinite(value):
            return cap
        return min(cap, max(0.0, self.least - value, value - self.most) / self.scale)


class Items(dict[str, Bound]):
    """The bounds by the name of the item."""

    @classmethod
    def from_item(cls, item: Item) -> 'Items':
        """Read a node of a YAML file. Raises YamlError for names other than ITEMS."""
        members = item.members(ITEMS)
        return cls((name, parse_value(Bound, member)) for name, member in members.items())


class Stations(Struct):
    """Where the paper sees what, as stations of the coarse path."""

    overshoot_near_m: Metres
    overshoot_far_m: Metres
    sideslip_m: Metres


class Search(Struct):
    """The size of the search."""

    baseline: Literal['frenet_matched', 'frenet_lineage', 'frenet_tuned']
    seed: Seed
    trials: Count
    random: Count
    batch: Count
    starts: Annotated[int, Range(0, 10_000, '')]


class HoldOut(Struct):
    """The drives by which what was found is judged."""

    seed: Seed
    best: Count
    perturbations: Count
    speed_mps: Annotated[float, Range(0.0, 1.0, 'm/s')]
    y_m: Annotated[float, Range(0.0, 1.0, 'm')]
    neighbours: Count
    ratio: Annotated[float, Range(0.0, 0.5, '-')]


class Demo(Struct):
    """Which of the judged settings becomes the demo."""

    near: Positive
    accept: Positive


class Picture(Struct):
    """The whole file."""

    schema: Literal[1]
    cap: Positive
    items: Items
    stations: Stations
    search: Search
    hold_out: HoldOut
    demo: Demo


def load(path: Path | None = None) -> Picture:
    """Return the contents of a file, by default that of this package.

    Raises BagError that names file, line, field and what is allowed.
    """
    path = path or share.path('experiments', *FILE)
    try:
        return parse_value(Picture, read(path))
    except YamlError as error:
        raise BagError(str(error)) from None


Measures = Mapping[str, Any]  # of one drive: the columns of the study's table


def features(
    no_ca: Measures, mpcc: Measures, baseline: Measures, values: Measures, stations: Stations
) -> dict[str, float | None]:
    """Return the value of every item; None where a drive has none.

    The drives are those of one setting, `values` its dimensions. They have the columns of the
    study's table and OVERSHOOTS, the x [m] at which a car ran wide.
    """
    safe_obstacle, safe_edge = values['safety_obstacle_m'], values['safety_edge_m']

    def peak(name, chosen):
        known = [drive[name] for drive in (no_ca, mpcc, baseline)]
        return None if None in known else chosen(known)

    def gain(name, more, less):
        return _difference(more[name], less[name])

    wide = baseline[OVERSHOOTS]
    sideslip_at = baseline['peak_sideslip_at_m']
    return {
        'no_ca_outline_1_m': no_ca['outline_1_m'],
        'mpcc_clear_m': _clear(mpcc),
        'baseline_clear_m': _clear(baseline),
        'least_limit_share': peak('limit_share', min),
        'greatest_brake_share': _share(peak('peak_brake_mps2', max), values['plant_limit_mps2']),
        'mpcc_kept_m': _least(
            _difference(mpcc['min_v2o_m'], safe_obstacle), _difference(mpcc['min_v2e_m'], safe_edge)
        ),
        'baseline_intrusion_2_m': _difference(safe_obstacle, baseline['v2o_2_m']),
        'baseline_intrusion_right_m': _difference(safe_edge, baseline['v2e_right_m']),
        'baseline_overshoot_near_m': _nearest(wide, stations.overshoot_near_m),
        'baseline_overshoot_far_m': _nearest(wide, stations.overshoot_far_m),
        'baseline_sideslip_deg': baseline['peak_sideslip_deg'],
        'baseline_sideslip_off_m': _nearest(
            [] if sideslip_at is None else [sideslip_at], stations.sideslip_m
        ),
        'mpcc_sideslip_deg': mpcc['peak_sideslip_deg'],
        'onset_lead_m': gain('brake_onset_planned_at_m', baseline, mpcc),
        'speed_gain_mps': gain('min_speed_mps', mpcc, baseline),
        'braking_gain_s': gain('braking_s', baseline, mpcc),
        'counter_steer_gain_s': gain('counter_steer_s', baseline, mpcc),
    }


def shortfalls(values: Mapping[str, float | None], picture: Picture) -> dict[str, float]:
    """Return by how many scales each item misses the picture."""
    return {
        name: bound.shortfall(values[name], picture.cap) for name, bound in picture.items.items()
    }


def distance(missed: Mapping[str, float]) -> float:
    """Return the distance from the picture: the root of the sum of the squared shortfalls."""
    return math.sqrt(sum(value**2 for value in missed.values()))


def greatest_distance(picture: Picture) -> float:
    """Return the distance of a setting that cannot be driven."""
    return picture.cap * math.sqrt(len(picture.items))


def arms_of(picture: Picture) -> tuple[str, str, str]:
    """Return the names of the arms of the picture: without collision avoidance, MPCC, baseline."""
    return arms.NO_CA, arms.MPCC, picture.search.baseline


def _clear(drive):
    """Return the least clearance [m] of circle and outline; None unless the drive was completed."""
    if not drive['completed']:
        return None
    known = [drive[name] for name in ('min_v2o_m', 'min_outline_gap_m', 'outline_edge_m')]
    return min((value for value in known if value is not None), default=None)


def _difference(first, second):
    return None if first is None or second is None else first - second


def _least(*values):
    return None if None in values else min(values)


def _share(value, whole):
    return None if value is None else value / whole


def _nearest(stations, wanted):
    return min((abs(station - wanted) for station in stations), default=None)
