"""The file that fixes the study over many settings before it is run: config/settings_study.yaml."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from bags.errors import BagError
from experiments.batch import distributions
from experiments.batch.distributions import Distribution
from msgs_yaml import share
from msgs_yaml.strict_yaml import Item, YamlError, parse_value, read
from node_runtime.parameters import SPEED, Range, Struct

FILE = ('config', 'settings_study.yaml')
RUNS = ('confirmatory', 'repetition', 'levels')
LEVELS = ('P0', 'P1', 'P2', 'P3', 'P4')
Level = Literal['P0', 'P1', 'P2', 'P3', 'P4']
Share = Annotated[float, Range(0.0, 1.0, '-')]
Metres = Annotated[float, Range(0.0, 1e3, 'm')]
Positive = Annotated[float, Range(1e-6, 1e6, '')]


class Dimensions(dict[str, Distribution]):
    """The drawn values by name, in the order of the coordinates."""

    @classmethod
    def from_item(cls, item: Item) -> 'Dimensions':
        """Read a node of a YAML file. Raises YamlError for names other than NAMES."""
        members = item.items()
        item.members(NAMES)
        return cls((name, distributions.parse(member)) for name, member in members.items())


# what `course`, `plant_variants` and `arms` make a setting of
NAMES = (
    *('change_1_m', 'change_2_m', 'offset_m', 'plateau_m'),
    *('obstacle_1_share', 'obstacle_2_share', 'clearance_1_m', 'clearance_2_m'),
    *('radius_1_m', 'radius_2_m', 'room_left_m', 'room_right_m'),
    *('safety_obstacle_m', 'safety_edge_m', 'priority_obstacle', 'priority_edge_ratio'),
    *('velocity_tolerance_mps', 'contouring_tolerance_m', 'lag_tolerance_m'),
    *('steer_rate_tolerance_radps', 'force_rate_tolerance_nps'),
    *('heading', 'heading_tolerance_rad', 'circles', 'brake_split', 'theta', 'arcs'),
    *('friction_error', 'latency_ms', 'car', 'rear_cornering', 'roll_share', 'S'),
)


class Run(Struct):
    """The settings of one run."""

    seed: Annotated[int, Range(0, 2**31 - 1, '-')]
    count: Annotated[int, Range(1, 1_000_000, 'settings')]
    screened: Literal[False, True]


class Runs(Struct):
    """The planned runs, each of settings of its own."""

    confirmatory: Run
    repetition: Run
    levels: Run


class Strata(Struct):
    """The limits of the strata, ascending."""

    S: tuple[Positive, ...]


class Course(Struct):
    """What of the double lane change is not drawn."""

    least_entry_m: Metres
    entry_s: Annotated[float, Range(0.0, 10.0, 's')]
    entry_extra_m: Metres
    preview_m: Metres
    after_s: Annotated[float, Range(0.0, 10.0, 's')]
    least_after_m: Metres
    horizon_s: Annotated[float, Range(0.0, 10.0, 's')]
    time_factor: Annotated[float, Range(1.0, 10.0, '-')]


class Admissible(Struct):
    """The speeds of a setting."""

    least_speed_mps: Annotated[float, SPEED]
    greatest_speed_mps: Annotated[float, SPEED]


class Circles(Struct):
    """The vehicle circles of a setting with one or two; three cover the outline."""

    radius_m: Annotated[float, Range(0.1, 5.0, 'm')]
    apart_m: Annotated[float, Range(0.1, 5.0, 'm')]


class Lineage(Struct):
    """What the baseline's lineage published."""

    contouring_m: Positive
    velocity_mps: Positive
    heading_rad: Positive
    steer_rate_radps: Positive
    force_rate_nps: Positive
    circles: Annotated[int, Range(1, 3, 'circles')]
    brake_split: Literal['free', 'fixed']


class Arms(Struct):
    """What the controllers have that is not drawn."""

    fixed_brake_front_share: Share
    lineage: Lineage
    smaller_priority: Share
    factorial_settings: Annotated[int, Range(0, 100_000, 'settings')]


class Perturbation(Struct):
    """Differences of the start from the setting."""

    speed_mps: Annotated[float, Range(-1.0, 1.0, 'm/s')]
    y_m: Annotated[float, Range(-1.0, 1.0, 'm')]


class DemandCondition(Struct):
    """P0: the task is near the limit."""

    least_S: Annotated[float, Range(0.0, 10.0, '-')]


class ContactCondition(Struct):
    """P1 and P2: which shape of the car touches."""

    by: Literal['circle', 'outline']


class LimitCondition(Struct):
    """P3: lateral acceleration over the plant's limit."""

    least_limit_share: Share


class BrakeCondition(Struct):
    """P4: braking with a converged plan before obstacle 2."""

    brake_n: Annotated[float, Range(-1e5, 0.0, 'N')]


class Preconditions(Struct):
    """The nested conditions on a setting."""

    P0: DemandCondition
    P1: ContactCondition
    P2: ContactCondition
    P3: LimitCondition
    P4: BrakeCondition


class UnsafeArea(Struct):
    """The baseline enters an unsafe area, the MPCC does not."""

    level: Level
    margin: Positive
    slack_m: Metres


class Sideslip(Struct):
    """The baseline's sideslip peak is large, that of the MPCC small."""

    level: Level
    margin: Positive
    baseline_deg: Positive
    mpcc_deg: Positive


class BrakeOnset(Struct):
    """The MPCC brakes earlier."""

    level: Level
    margin: Positive
    earlier_m: Positive
    censored_s: Annotated[float, Range(0.0, 10.0, 's')]


class MinSpeed(Struct):
    """The MPCC keeps a higher least speed."""

    level: Level
    margin: Positive
    higher_mps: Positive


class Conjunction(Struct):
    """All of the others."""

    level: Level


class Primaries(Struct):
    """The claims, with what counts as equal and the level at which they are judged."""

    unsafe_area: UnsafeArea
    sideslip: Sideslip
    brake_onset: BrakeOnset
    min_speed: MinSpeed
    conjunction: Conjunction


class Decision(Struct):
    """How the shares of settings become verdicts."""

    confidence: Share
    confirmatory: Literal['frenet_matched', 'frenet_lineage', 'frenet_tuned']
    correction: Literal['holm']
    holds_from: Share
    rare_below: Share
    undetermined: Literal['disagreement']
    undetermined_strictly: Literal['margin']
    from_level: Literal['P0', 'P1']
    least_settings: Annotated[int, Range(1, 1_000_000, 'settings')]


class Preregistration(Struct):
    """The whole file."""

    schema: Literal[1]
    runs: Runs
    dimensions: Dimensions
    strata: Strata
    course: Course
    admissible: Admissible
    circles: Circles
    arms: Arms
    perturbations: tuple[Perturbation, ...]
    preconditions: Preconditions
    primaries: Primaries
    decision: Decision
    text: str = ''
    path: str = ''

    def __repr__(self) -> str:
        return f'Preregistration({self.path!r}, {len(self.dimensions)} dimensions)'

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def load(path: Path | None = None) -> Preregistration:
    """Return the contents of a file, by default that of this package.

    Raises BagError that names file, line, field and what is allowed.
    """
    path = path or share.path('experiments', *FILE)
    try:
        plan = parse_value(Preregistration, read(path))
    except (YamlError, OSError) as error:
        raise BagError(str(error)) from None
    fields: Mapping[str, object] = vars(plan)
    return Preregistration(
        **{**fields, 'text': path.read_text(encoding='utf-8'), 'path': path.name}
    )
