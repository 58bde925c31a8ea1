"""Segments of a line in the scenario file: curvature over distance, one kind of piece each."""

from dataclasses import dataclass

from scenario_publisher.quantities import Curvature, Length, Offset


@dataclass(frozen=True)
class Straight:
    """Straight on."""

    length_m: Length


@dataclass(frozen=True)
class Arc:
    """Constant curvature."""

    length_m: Length
    curvature_1pm: Curvature


@dataclass(frozen=True)
class Clothoid:
    """Curvature that changes linearly with the distance."""

    length_m: Length
    start_curvature_1pm: Curvature
    end_curvature_1pm: Curvature


@dataclass(frozen=True)
class LaneChange:
    """S-shaped step to the side; length measured along the heading it starts with."""

    length_m: Length
    offset_m: Offset


@dataclass(frozen=True)
class StraightSegment:
    """A segment that is straight."""

    straight: Straight


@dataclass(frozen=True)
class ArcSegment:
    """A segment that is an arc."""

    arc: Arc


@dataclass(frozen=True)
class ClothoidSegment:
    """A segment that is a clothoid."""

    clothoid: Clothoid


@dataclass(frozen=True)
class LaneChangeSegment:
    """A segment that changes the lane."""

    lane_change: LaneChange


Segment = StraightSegment | ArcSegment | ClothoidSegment | LaneChangeSegment
