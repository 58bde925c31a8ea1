"""Obstacles in bends, slaloms, gates and lane changes: where the room is narrow.

Each public function is a family.
"""

from experiments.families import feasibility
from experiments.families.scenario_document import (
    FRICTION,
    LANE,
    LEFT,
    RIGHT,
    Document,
    ImpossibleError,
    Trial,
    arc,
    clothoid,
    disc,
    document,
    either_side,
    emergency,
    finish,
    lane_change,
    straight,
)

WIDE = 4.5  # m, half of a road of no lanes
# ISO 3888-1:2018 and ISO 3888-2:2011: lengths of sections 1 to 5, and the widths of the lanes as
# factor of the vehicle's width and constant
ISO_1_LENGTHS = (15.0, 30.0, 25.0, 25.0, 15.0)
ISO_1_WIDTHS = ((1.1, 0.25), (1.2, 0.25), (1.3, 0.25))
ISO_1_OFFSET = 3.5  # m between the lanes
ISO_2_LENGTHS = (12.0, 13.5, 11.0, 12.5, 12.0)
ISO_2_WIDTHS = ((1.1, 0.25), (1.0, 1.0), (1.3, 0.25))
ISO_2_GAP = 1.0  # m between the left side of lane 1 and the right side of lane 3
ISO_2_LEAST = 3.0  # m, width of the last lane
RUN_IN = 15.0  # m before section 1
FLARE = 3.5  # m over which the edges of a gate open, by up to 1 m per metre
# of bends
RADII = (30.0, 200.0)  # m
GRIP_SHARES = (0.3, 0.75)  # of the lateral acceleration that the friction allows
SPEEDS = (9.0, 30.0)  # m/s
HALF_ROAD = 4.25  # m


def bend_inside(trial: Trial) -> Document:
    """Return an obstacle on the inside of a bend."""
    return _bend(trial, 1.0, 'inside')


def bend_outside(trial: Trial) -> Document:
    """Return an obstacle on the outside of a bend."""
    return _bend(trial, -1.0, 'outside')


def _bend(trial, side, name):
    radius = trial.uniform(*RADII)
    share = trial.uniform(*GRIP_SHARES)
    speed = (share * FRICTION * feasibility.GRAVITY * radius) ** 0.5
    ahead_s = trial.among((1.2, 3.0), hard=(0.8, 1.5))
    size, offset = trial.uniform(0.4, 1.0), trial.uniform(0.2, 1.4)
    into_s = trial.uniform(0.5, 2.0)
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        raise ImpossibleError
    # grip that the bend leaves to either side of the circle
    left_over = FRICTION * (1.0 - share**2) ** 0.5
    trial.require(feasibility.can_pass_or_stop(speed, ahead_s, size, offset, left_over))
    lead_in, into = speed * 1.2, speed * 1.5
    x = lead_in + into + speed * into_s
    turn = speed * into_s + max(15.0, 1.5 * speed)
    length = max(lead_in + into + turn + into + speed, finish(x, speed))
    kappa = 1.0 / radius
    segments = [
        straight(lead_in),
        clothoid(into, 0.0, kappa),
        arc(turn, kappa),
        clothoid(into, kappa, 0.0),
        straight(length - lead_in - 2 * into - turn),
    ]
    text = f'An obstacle {name} of a bend of {radius:.0f} m at {speed:.1f} m/s.'
    obstacles = [disc(x, side * offset, size, appears_at_s=max(0.0, x / speed - ahead_s))]
    edges = {'left': HALF_ROAD, 'right': -HALF_ROAD}
    parts = document(text, length, speed, obstacles, segments=segments, **edges)
    return either_side(trial, parts)


def slalom(trial: Trial) -> Document:
    """Return four obstacles, alternately left and right of the path."""
    speed = trial.uniform(12.0, 22.0)
    spacing = trial.among((20.0, 36.0), hard=(16.0, 28.0))
    radius, offset = trial.uniform(0.4, 1.0), trial.uniform(0.2, 1.2)
    swing = feasibility.shift_beside(radius, offset)
    # a sine through the gaps: half a period per obstacle
    peak = swing * (3.1416 * speed / spacing) ** 2
    trial.require(peak <= feasibility.GRIP_SHARE * feasibility.GRAVITY * FRICTION)
    x = [40.0 + spacing * i for i in range(4)]
    text = f'Slalom of four, {spacing:.1f} m apart, at {speed:.1f} m/s.'
    obstacles = [disc(at, offset * (-1) ** i, radius) for i, at in enumerate(x)]
    return emergency(trial, text, x[-1], speed, obstacles, left=WIDE, right=-WIDE)


def chicane(trial: Trial) -> Document:
    """Return two barriers, from the left and from the right, each leaving one half of the road."""
    speed = trial.uniform(10.0, 20.0)
    spacing = trial.among((22.0, 40.0), hard=(18.0, 28.0))
    radius, reach = 1.0, trial.uniform(-0.4, 0.4)  # m, how far a barrier goes beyond the middle
    half = 4.2
    swing = feasibility.shift_beside(0.0, 0.0) + reach
    trial.require(feasibility.lateral_shift_and_back(spacing / speed, FRICTION) >= 2.0 * swing)
    x = 45.0
    centres = [radius - reach, 3.0 * radius - reach]
    obstacles = [disc(x, offset, radius) for offset in centres]
    obstacles += [disc(x + spacing, -offset, radius) for offset in centres]
    text = f'A chicane of two barriers, {spacing:.1f} m apart, at {speed:.1f} m/s.'
    return emergency(trial, text, x + spacing, speed, obstacles, left=half, right=-half)


def narrowing(trial: Trial) -> Document:
    """Return a road that narrows to one lane, beside the path."""
    speed = trial.uniform(12.0, 28.0)
    width = trial.among((2.7, 3.4), hard=(2.5, 2.8))
    middle = trial.uniform(-0.7, 0.7)
    over = trial.among((15.0, 40.0), hard=(10.0, 20.0))
    begin, length = 45.0, trial.uniform(15.0, 40.0)
    stations = [begin, begin + over, begin + over + length, begin + over + length + over]
    # the path stays on the road, not the whole car
    left = max(middle + width / 2, 0.6)
    right = min(left - width, -0.6)
    text = f'The road narrows to {left - right:.2f} m at {speed:.1f} m/s.'
    edges = {
        'left': (stations, [WIDE, left, left, WIDE]),
        'right': (stations, [-WIDE, right, right, -WIDE]),
    }
    return emergency(trial, text, stations[-1], speed, [], **edges)


def closed_road(trial: Trial) -> Document:
    """Return a barrier across the whole road: the car has to stop."""
    speed = trial.uniform(12.0, 28.0)
    seen_s, radius = trial.uniform(0.0, 1.0), 1.1
    spare = trial.among((4.0, 30.0), hard=(0.0, 10.0))
    distance = feasibility.braking_distance(speed, FRICTION) + feasibility.CAR_NOSE + radius + spare
    x = speed * seen_s + distance
    count = 4
    spacing = (LEFT - RIGHT) / count
    offsets = [RIGHT + spacing * (i + 0.5) for i in range(count)]
    text = f'The road is closed {distance:.0f} m ahead at {speed:.1f} m/s.'
    barrier = [disc(x, offset, radius, appears_at_s=seen_s) for offset in offsets]
    return document(text, finish(x, speed), speed, barrier, extra_s=5.0)


def double_lane_change(trial: Trial) -> Document:
    """Return a double lane change around two obstacles, at 18 to 30 m/s with changes of 20 to 32 m.

    The coarse path changes lanes. Grip 0.85 to 1, which the controller knows.
    """
    speed = trial.among((18.0, 30.0), hard=(24.0, 36.0))
    first, second = trial.uniform(20.0, 32.0), trial.uniform(20.0, 32.0)
    friction = trial.uniform(0.85, 1.0)
    # between the first obstacle, 2/3 into the change, and the second in the next, a car parallel at
    # both moves aside by the room that the lanes leave
    between = (first / 3.0 + 25.0 + second * 0.85) / speed
    shift = LANE - 2.0 * 0.6
    trial.require(feasibility.lateral_shift_and_back(between, friction) >= shift)
    trial.require(feasibility.lateral_shift(0.75 * first / speed + 0.25, friction) >= 2.0)
    begin = 45.0
    path = [
        straight(begin),
        lane_change(first, LANE),
        straight(25.0),
        lane_change(second, -LANE),
        straight(max(40.0, 3.0 * speed)),
    ]
    x_1, x_2 = begin + 0.77 * first, begin + first + 25.0 + 0.88 * second
    length = begin + first + 25.0 + second + max(30.0, 2.5 * speed)
    text = f'Double lane change, {first:.0f} and {second:.0f} m, at {speed:.1f} m/s.'
    obstacles = [disc(x_1, 1.1, 1.0), disc(x_2, 2.45, 1.0)]
    lines = {'segments': [straight(length + 10.0)], 'path_segments': path}
    parts = document(text, length, speed, obstacles, friction=friction, **lines)
    return either_side(trial, parts)


def iso_3888_1(trial: Trial) -> Document:
    """Return the double lane change of ISO 3888-1; the lanes are the edges of the road."""
    speed = trial.among((18.0, 24.0), hard=(23.0, 28.0))
    widths = [_lane_width(*width) for width in ISO_1_WIDTHS]
    return _iso_course(speed, ISO_1_LENGTHS, widths, ISO_1_OFFSET, 4.0, 'ISO 3888-1')


def iso_3888_2(trial: Trial) -> Document:
    """Return the obstacle avoidance of ISO 3888-2; the lanes are the edges of the road."""
    speed = trial.among((9.0, 12.5), hard=(12.5, 16.0))
    first, third, last = (_lane_width(*width) for width in ISO_2_WIDTHS)
    offset = first / 2 + ISO_2_GAP + third / 2
    widths = [first, third, max(ISO_2_LEAST, last)]
    return _iso_course(speed, ISO_2_LENGTHS, widths, offset, 2.0, 'ISO 3888-2')


def _lane_width(factor, constant):
    """Return the width [m] of a lane of the standard for our car."""
    return factor * feasibility.CAR_WIDTH + constant


def _iso_course(speed, lengths, widths, offset, early, name):
    """Return a course of five sections, the third one `offset` [m] to the left.

    The centre line runs through the middle of the lanes and changes in sections 2 and 4; there the
    road is open to both sides. A lane opens within FLARE at its ends, outside of it. The coarse
    path begins to change `early` [m] before a lane ends and ends so far behind the next begins, as
    a driver does.
    """
    section_1, section_2, section_3, section_4, section_5 = lengths
    # along the centre line a change is longer than straight ahead, by less than a flare
    ends, begin = [], RUN_IN
    for lane, change in ((section_1, section_2), (section_3, section_4), (section_5, 0.0)):
        ends.append((begin, begin + lane))
        begin += lane + change
    stations, offsets = [0.0], [WIDE]
    for (from_s, to_s), width in zip(ends, widths):
        stations += [from_s - FLARE, from_s, to_s, to_s + FLARE]
        offsets += [WIDE, width / 2, width / 2, WIDE]
    length = ends[-1][1] + 35.0
    text = f'{name} at {speed:.1f} m/s: the lanes are the edges of the road.'
    return document(
        text,
        length,
        speed,
        [],
        segments=_changes(lengths, offset, 0.0, length),
        path_segments=_changes(lengths, offset, early, length),
        left=(stations, offsets),
        right=(stations, [-value for value in offsets]),
    )


def _changes(lengths, offset, early, length):
    section_1, section_2, section_3, section_4, _ = lengths
    return [
        straight(RUN_IN + section_1 - early),
        lane_change(section_2 + 2.0 * early, offset),
        straight(section_3 - 2.0 * early),
        lane_change(section_4 + 2.0 * early, -offset),
        straight(length - RUN_IN - section_1 - section_2 - section_3 - section_4 - early),
    ]
