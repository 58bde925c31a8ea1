"""Other road users, mostly on roads that bend: they keep their lane, merge, cross, stand, hide.

The road has a lane each way, and the coarse path is the middle of the own one. Who comes keeps its
lane, so the car has nothing to avoid there: it has to stay in its own. Each public
function is a family.
"""

from typing import NamedTuple

import numpy as np
import yaml

from experiments.families import feasibility
from experiments.families.scenario_document import (
    CAR_DISCS,
    CAR_RADIUS,
    FRICTION,
    LANE,
    LEFT,
    Block,
    Document,
    ImpossibleError,
    Trial,
    arc,
    car,
    car_along,
    clothoid,
    disc,
    document,
    either_side,
    emergency,
    finish,
    rounded,
    straight,
    waypoint,
)
from msgs_yaml.types import Obstacle
from scenario_publisher import scenario, sight
from scenario_publisher.schema import ALONG_ROAD

RADII = (25.0, 300.0)  # m
GRIP_SHARES = (0.1, 0.45)  # of the lateral acceleration that the friction allows
SPEEDS = (7.0, 33.0)  # m/s
CLOTHOID_S = 1.2  # of driving into a bend
MOST_TURN = 2.4  # rad, of one bend
FAR_M = 500.0  # seen behind a crest
REACTION_S, BRAKING_MPS2 = 0.5, 5.0  # of a driver who drives by sight
CAR_BACK = 2.4  # m from the middle of another car to its bumpers
# a truck and its trailer: 2.55 m wide and 17 m long
TRUCK_RADIUS, TRUCK_DISCS = 1.65, tuple(2.1 * (k - 3.5) for k in range(8))
VAN_RADIUS, VAN_DISCS = 1.0, (1.7, 0.57, -0.57, -1.7)  # 2 m wide and 5.4 m long
PERSON_RADIUS = 0.35  # m
EMERGING_MPS = 2.0  # of who is taken to come out from behind a van


class Road(NamedTuple):
    """A straight, bends, and what is needed to place others on them."""

    segments: list[Block]
    speed: float  # m/s, desired
    grip: float  # left over in the bends, as a friction
    begin: float  # m, station at which the first bend has its full curvature
    end: float  # m, at which the last one begins to end

    def station(self, share: float) -> float:
        """Return the station [m] at a share of the bends."""
        return self.begin + share * (self.end - self.begin)


def bend_oncoming(trial: Trial) -> Document:
    """Return a car that comes in its own lane of a bend."""
    return _oncoming(trial, bends=1)


def s_curve_oncoming(trial: Trial) -> Document:
    """Return a car that comes in its own lane of two bends in opposite directions."""
    return _oncoming(trial, bends=2)


def narrow_road_oncoming(trial: Trial) -> Document:
    """Return a car that comes on a winding road with lanes of 2.6 to 2.9 m."""
    return _oncoming(trial, bends=2, lane=trial.uniform(2.6, 2.9))


def truck_oncoming(trial: Trial) -> Document:
    """Return a truck with a trailer that comes in its own lane of a bend."""
    return _oncoming(trial, bends=1, who='A truck with a trailer')


def _oncoming(trial, bends, lane=LANE, who='A car'):
    road = _road(trial, bends)
    at, seen_s = road.station(trial.uniform(0.1, 0.9)), _seen_s(trial, (2.5, 5.0))
    speed, offset = trial.uniform(0.7, 1.15) * road.speed, lane + trial.uniform(-0.3, 0.3)
    others = [_comes(road, at, speed, offset, seen_s, who != 'A car')]
    return _two_lanes(trial, road, f'{who} comes in its lane', at, others, lane)


def parked_and_oncoming(trial: Trial) -> Document:
    """Return a car that stands in the own lane of a bend, where another one comes."""
    road = _road(trial, shares=(0.1, 0.3))
    at, seen_s = road.station(trial.uniform(0.2, 0.8)), _seen_s(trial, (3.0, 5.0))
    trial.require(_can_stop(road, road.speed, road.speed * seen_s))
    parked = car(at, trial.uniform(-1.3, -0.2), appears_at_s=_appears_s(road, at, seen_s))
    meet, speed = at + trial.uniform(-10.0, 30.0), trial.uniform(0.6, 1.1) * road.speed
    others = [parked, _comes(road, meet, speed, LANE, seen_s)]
    text = 'A car stands in the lane of a bend, and another one comes'
    return _two_lanes(trial, road, text, at, others, extra_s=8.0)


def crest(trial: Trial) -> Document:
    """Return a car that stands behind a crest, where sight ends; in half of the draws one comes.

    Before the crest the car sees as far as a little behind it; the desired speed is one from which
    it can stop within that.
    """
    road = _road(trial, radii=(120.0, 300.0), shares=(0.05, 0.25))
    top = road.station(0.4)
    least = road.speed * trial.among((1.0, 2.5), hard=(0.8, 1.5))  # m, seen at the top
    view = {'stations_m': [0.0, top, top + 1.0], 'ranges_m': [top + least, least, FAR_M]}
    slow = float(sight.stopping_speed(np.array(least), REACTION_S, BRAKING_MPS2))
    trial.require(_can_stop(road, slow, least))
    at = top + least + trial.uniform(0.0, 10.0)
    others = [car(at, trial.uniform(-1.0, 0.5))]
    if trial.random() < 0.5:
        # it is about there when the car comes to the top
        s = np.arange(0.0, top)
        seen = sight.stopping_speed(top + least - s, REACTION_S, BRAKING_MPS2)
        top_s = float(np.sum(1.0 / np.minimum(seen, road.speed)))
        begin = at + road.speed * (top_s + trial.uniform(0.0, 2.0))
        others.append(car(begin, LANE, -road.speed, motion=ALONG_ROAD))
    text = f'A car stands behind a crest, on which {least:.0f} m of road are seen'
    parts = _two_lanes(trial, road, text, at, others, extra_s=15.0)
    pace = {'reaction_s': REACTION_S, 'deceleration_mps2': BRAKING_MPS2}
    return parts | {'sight': rounded(view | pace)}


def slower_car_in_bend(trial: Trial) -> Document:
    """Return a slower car ahead in a bend; in half of the draws another one comes."""
    return _ahead(trial, 'A slower car', (0.3, 0.7), (-0.3, 0.3))


def cyclist_in_bend(trial: Trial) -> Document:
    """Return a cyclist ahead in a bend; in half of the draws a car comes."""
    return _ahead(trial, 'A cyclist', (0.25, 0.45), (-1.4, -0.6))


def _ahead(trial, who, shares, offsets):
    road = _road(trial)
    theirs, offset = trial.uniform(*shares) * road.speed, trial.uniform(*offsets)
    gap = (road.speed - theirs) * trial.among((2.0, 4.0), hard=(1.2, 2.2))
    trial.require(_can_stop(road, road.speed - theirs, gap))
    # where it is at the start, to be reached in the bend, and where that is
    begin = max(road.station(0.4) * (1.0 - theirs / road.speed), gap)
    reached = begin / (1.0 - theirs / road.speed)
    if who == 'A cyclist':
        motion = {'along_mps': theirs, 'motion': ALONG_ROAD}
        others = [disc(begin, offset, 0.45, discs_m=(-0.5, 0.5), **motion)]
    else:
        others = [car(begin, offset, theirs, motion=ALONG_ROAD)]
    if trial.random() < 0.5:
        meet = reached + trial.uniform(-1.0, 2.0) * road.speed
        others.append(_comes(road, meet, road.speed, LANE, 4.0))
    text = f'{who} is ahead at {theirs:.1f} m/s in a bend'
    return _two_lanes(trial, road, text, reached + 3.0 * theirs, others, extra_s=12.0)


def motorway_merge(trial: Trial) -> Document:
    """Return a slower car that merges from a ramp; in half of the draws one is beside the car."""
    road = _road(trial, radii=(350.0, 900.0), shares=(0.06, 0.2), speeds=(20.0, 36.0))
    theirs = trial.uniform(0.6, 0.9) * road.speed
    move_s = trial.among((2.5, 4.0), hard=(1.5, 2.5))
    gap_s = trial.among((0.7, 1.5), hard=(0.3, 0.7))
    lead = CAR_BACK + feasibility.CAR_NOSE + gap_s * road.speed
    # what is left of the gap when it has reached the lane
    gap = lead - (road.speed - theirs) * move_s / 2.0
    trial.require(_can_stop(road, road.speed - theirs, gap))
    merged = lead + theirs * (1.0 + move_s)
    points = [
        waypoint(lead, -LANE, theirs),
        waypoint(lead + theirs, -LANE, theirs),
        waypoint(merged, 0.0, theirs),
        # behind the bend, where straight on is along the road
        waypoint(max(merged, road.end + CLOTHOID_S * road.speed) + 5.0, 0.0, theirs),
    ]
    others = [car_along(points)]
    if trial.random() < 0.5:
        others.append(car(trial.uniform(-15.0, 15.0), LANE, road.speed, motion=ALONG_ROAD))
    last = lead + theirs * (move_s + 3.0)
    text = f'A car merges at {theirs:.1f} m/s'
    return _two_lanes(trial, road, text, last, others, ramp=LANE)


def roundabout_entry(trial: Trial) -> Document:
    """Return two cars on a roundabout that the car enters; both have the right of way."""
    ring, entry = trial.uniform(14.0, 22.0), trial.uniform(18.0, 30.0)
    speed = (trial.uniform(0.2, 0.4) * FRICTION * feasibility.GRAVITY * ring) ** 0.5
    lead_in, turn = trial.uniform(25.0, 45.0), trial.uniform(1.6, 3.0)
    inwards, kappa, bend, mouth = -1.0 / entry, 1.0 / ring, 0.6 * entry, 8.0
    merge = lead_in + bend + 2.0 * mouth
    trial.require(feasibility.can_stop(speed, merge - 12.0, FRICTION))
    segments = [
        straight(lead_in),
        clothoid(mouth, 0.0, inwards),
        arc(bend, inwards),
        clothoid(mouth, inwards, kappa),
        arc(turn * ring, kappa),
        clothoid(mouth, kappa, inwards),
        arc(bend, inwards),
        clothoid(mouth, inwards, 0.0),
        straight(25.0),
    ]
    length = merge + turn * ring + 2.0 * mouth + bend + 25.0
    # their way begins to the left, as long before the merge as their speed needs
    theirs, before, aside = speed * trial.uniform(0.6, 0.8), 26.0, 16.0
    points = [
        waypoint(merge - before, aside, theirs),
        waypoint(merge + 10.0, 0.0, theirs),
        waypoint(length - 5.0, 0.0, theirs),
    ]
    first_s = merge / speed + trial.uniform(-1.0, 1.0) - (before**2 + aside**2) ** 0.5 / theirs
    times = (first_s, first_s + trial.uniform(1.6, 4.0))
    text = f'A roundabout of {ring:.0f} m; two cars are on it.'
    others = [car_along(points, appears_at_s=max(0.0, t)) for t in times]
    more = {'segments': segments, 'left': 3.0, 'right': -3.0, 'extra_s': 10.0}
    return either_side(trial, document(text, length, speed, others, **more))


def junction_crossing(trial: Trial) -> Document:
    """Return a car that crosses at a junction."""
    speed, theirs = trial.uniform(10.0, 22.0), trial.uniform(6.0, 13.0)
    ahead_s = trial.among((1.8, 4.0), hard=(1.2, 2.0))
    trial.require(feasibility.can_stop(speed, speed * ahead_s - CAR_RADIUS, FRICTION))
    way, seen_s = trial.choice((-1.0, 1.0)), trial.uniform(0.3, 1.0)
    # where it is when the car arrives at its desired speed, and where when it is seen
    x, at = speed * (seen_s + ahead_s), trial.uniform(-3.0, 3.0)
    begin = at - way * theirs * ahead_s
    motion = {'across_mps': way * theirs, 'appears_at_s': seen_s}
    text = f'A car crosses at {theirs:.1f} m/s, seen {ahead_s:.2f} s ahead.'
    others = [disc(x, begin, CAR_RADIUS, discs_m=CAR_DISCS, **motion)]
    return emergency(trial, text, x, speed, others)


def hidden_pedestrian(trial: Trial) -> Document:
    """Return a pedestrian from behind a parked van, whom the desired speed foresees."""
    return _behind_van(trial, EMERGING_MPS)


def unforeseen_pedestrian(trial: Trial) -> Document:
    """Return a pedestrian from behind a parked van, whom the desired speed does not foresee."""
    return _behind_van(trial, 0.0)


def _behind_van(trial, emerging):
    """Return who is in the way when a car at the desired speed is there.

    The same draw for each of the two speeds: from a car that does not foresee them they are hidden
    at first, one that does has all but stopped beside the van by then.
    """
    speed, at = trial.uniform(8.0, 15.0), trial.uniform(-1.0, 0.5)
    beside = trial.among((0.6, 1.5), hard=(0.4, 1.0))  # m between van and car
    left = trial.uniform(1.8, 2.6)  # m, of the edge: there is little room to move aside
    walks = trial.among((1.0, EMERGING_MPS), hard=(1.5, 3.0))
    x, offset = speed * trial.uniform(4.5, 6.0), -beside - feasibility.CAR_WIDTH / 2 - VAN_RADIUS
    there = x + VAN_DISCS[0] + VAN_RADIUS + PERSON_RADIUS + trial.uniform(0.2, 1.0)
    first, *others = VAN_DISCS
    spread = tuple((ahead - first, 0.0) for ahead in others)
    parked = Obstacle(1, x + first, offset, VAN_RADIUS, 0.0, 0.0, spread)
    person = Obstacle(2, there, offset, PERSON_RADIUS, 0.0, 0.0)

    def road(foreseen, *people):
        text = f'A pedestrian comes out at {walks:.1f} m/s from behind a parked van, '
        text += f'{beside:.1f} m beside the car; {speed:.1f} m/s.'
        others = [disc(x, offset, VAN_RADIUS, discs_m=VAN_DISCS), *people]
        parts = document(text, finish(there, speed), speed, others, left=left, extra_s=15.0)
        return parts | {'sight': {'hidden_by_obstacles': True, 'emerging_mps': foreseen}}

    def begin(foreseen):
        path = scenario.parse(yaml.safe_dump(road(foreseen)), 'van.yaml').reference
        arrives_s = float(np.interp(there - feasibility.CAR_NOSE, path.X, path.t))
        begins_s = rounded(arrives_s - (at - offset) / walks)
        return begins_s, (float(np.interp(begins_s, path.t, path.X)), 0.0)

    if not sight.is_hidden(begin(0.0)[1], person, (parked,)):
        raise ImpossibleError
    begins_s, _ = begin(emerging)
    walker = disc(there, offset, PERSON_RADIUS, across_mps=walks, appears_at_s=begins_s)
    return either_side(trial, road(emerging, walker))


def _road(trial, bends=1, radii=RADII, shares=GRIP_SHARES, speeds=SPEEDS) -> Road:
    """Return a road with one bend, or two in opposite directions."""
    speed = 0.0
    while not speeds[0] <= speed <= speeds[1]:
        radius, share = trial.uniform(*radii), trial.uniform(*shares)
        speed = (share * FRICTION * feasibility.GRAVITY * radius) ** 0.5
    lead_in, into = trial.uniform(1.0, 2.5) * speed, CLOTHOID_S * speed
    length = max(min(trial.uniform(2.0, 5.0) * speed, MOST_TURN * radius - into), 5.0)
    segments, kappa = [straight(lead_in)], trial.choice((-1.0, 1.0)) / radius
    for _ in range(bends):
        segments += [clothoid(into, 0.0, kappa), arc(length, kappa), clothoid(into, kappa, 0.0)]
        kappa = -kappa
    grip = FRICTION * (1.0 - share**2) ** 0.5
    end = lead_in + bends * (length + 2.0 * into)
    return Road(segments, speed, grip, lead_in + into, end - into)


def _seen_s(trial, nominal):
    """Return how long [s] before they meet another one is seen."""
    return trial.among(nominal, hard=(1.2, nominal[0]))


def _appears_s(road, at, seen_s):
    """Return when [s] something appears that is seen so long before the car is there."""
    return max(0.0, at / road.speed - seen_s)


def _comes(road, meet, theirs, offset, seen_s, is_truck=False) -> Block:
    """Return who comes along the road and meets the car at a station, seen before by a time."""
    appears_s = _appears_s(road, meet, seen_s)
    begin = meet + theirs * (meet / road.speed - appears_s)
    motion = {'along_mps': -theirs, 'appears_at_s': appears_s, 'motion': ALONG_ROAD}
    radius, places = (TRUCK_RADIUS, TRUCK_DISCS) if is_truck else (CAR_RADIUS, CAR_DISCS)
    return disc(begin, offset, radius, discs_m=places, **motion)


def _can_stop(road, speed, gap):
    """Return whether a car can brake from a speed [m/s] before it has closed a gap [m]."""
    return feasibility.can_stop(speed, gap - CAR_BACK, road.grip)


def _two_lanes(trial, road, text, last, others, lane=LANE, ramp=0.0, extra_s=0.0):
    """Return the document of a road with others on it, or its mirror image."""
    driven = road.end + CLOTHOID_S * road.speed
    on_road = [block for block in others if 'station_m' in block]
    stations = [block['station_m'] + max(block['discs_m']) for block in on_road]
    length = max(finish(last, road.speed), driven + 1.0, *stations)
    shoulders = LEFT - 1.5 * LANE if lane == LANE else 0.15
    edges = {'left': 1.5 * lane + shoulders, 'right': -0.5 * lane - shoulders - ramp}
    own = {'segments': [*road.segments, straight(length - driven)], 'extra_s': extra_s}
    text = f'{text}; {road.speed:.1f} m/s.'
    return either_side(trial, document(text, length, road.speed, others, **own, **edges))
