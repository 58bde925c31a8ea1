"""Emergencies on a road without a stream of traffic; each public function is a family.

First what appears, comes towards the car, drives ahead of it or crosses, on a straight road: where
a part of it is slippery, no topic carries its friction, and the coarse path goes straight on and
prescribes no side to pass on. Then obstacles in bends, slaloms, gates and lane changes, where the
room is narrow.
"""

from experiments.families import feasibility
from experiments.families.scenario_document import (
    CAR_RADIUS,
    FRICTION,
    LANE,
    LEFT,
    RIGHT,
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
    lane_change,
    straight,
    waypoint,
)

CAR_BACK = 2.4  # m from the middle of another car to its bumpers
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


def pop_up(trial: Trial) -> Document:
    """Return an obstacle that appears in the lane, 0.8 to 2 s ahead at 14 to 30 m/s."""
    speed = trial.uniform(14.0, 30.0)
    ahead_s = trial.among((0.8, 2.0), hard=(0.6, 1.2))
    seen_s = trial.uniform(0.5, 1.5)
    radius, offset = trial.uniform(0.4, 1.1), trial.uniform(-1.0, 1.0)
    trial.require(_can_pass_or_stop(speed, ahead_s, radius, offset))
    x = speed * (seen_s + ahead_s)
    text = f'An obstacle appears {ahead_s:.2f} s ahead at {speed:.1f} m/s.'
    return emergency(trial, text, x, speed, [disc(x, offset, radius, appears_at_s=seen_s)])


def oncoming(trial: Trial) -> Document:
    """Return a car that comes towards the car in its own lane, at 8 to 20 m/s."""
    speed, theirs = trial.uniform(14.0, 25.0), trial.uniform(8.0, 20.0)
    meets_s = trial.among((2.0, 4.5), hard=(1.5, 3.0))
    seen_s, offset = trial.uniform(0.3, 1.0), trial.uniform(-0.6, 0.6)
    shift = feasibility.shift_beside(CAR_RADIUS, offset)
    # their front arrives CAR_BACK before their middle does
    early_s = (CAR_BACK + feasibility.CAR_NOSE) / (speed + theirs)
    trial.require(feasibility.lateral_shift(meets_s - early_s, FRICTION) >= shift)
    meet = speed * (seen_s + meets_s)
    text = f'A car comes at {theirs:.1f} m/s, seen {meets_s:.2f} s before they meet.'
    other = car(meet + theirs * meets_s, offset, -theirs, appears_at_s=seen_s)
    return emergency(trial, text, meet, speed, [other])


def slower_car(trial: Trial) -> Document:
    """Return a slower car ahead in the lane; the other lane is free."""
    speed = trial.uniform(14.0, 28.0)
    theirs = trial.uniform(0.2, 0.65) * speed
    reach_s = trial.among((1.5, 4.0), hard=(1.0, 2.0))
    seen_s, offset = trial.uniform(0.0, 1.0), trial.uniform(-0.6, 0.6)
    gap = (speed - theirs) * reach_s
    shift = feasibility.shift_beside(CAR_RADIUS, offset)
    can_pass = feasibility.lateral_shift(reach_s - CAR_BACK / (speed - theirs), FRICTION) >= shift
    trial.require(can_pass or _can_follow(speed, theirs, gap - CAR_BACK))
    x = speed * seen_s + gap
    # until the car is past at its own speed
    last = x + theirs * (reach_s + 3.0)
    text = f'A car ahead drives at {theirs:.1f} m/s, the own car at {speed:.1f} m/s.'
    return emergency(trial, text, last, speed, [car(x, offset, theirs, appears_at_s=seen_s)])


def cut_in(trial: Trial) -> Document:
    """Return a car that moves over from the next lane and brakes."""
    speed = trial.uniform(14.0, 28.0)
    theirs = trial.uniform(0.65, 0.95) * speed
    slow = trial.uniform(0.0, 0.5) * theirs
    deceleration = trial.among((2.5, 5.0), hard=(4.0, 7.0))
    # moving aside by d in T on a quintic takes 10 d / (sqrt(3) T^2) at most: a lane in 1.6 s 0.8 g
    move_s = trial.among((1.5, 2.5), hard=(1.6, 2.2))
    lead = trial.among((14.0, 30.0), hard=(8.0, 16.0))
    offset = trial.uniform(-0.4, 0.4)
    # where it has arrived in the lane, and where it has braked
    braking = (theirs**2 - slow**2) / (2.0 * deceleration)
    arrives = lead + theirs * move_s
    gap = arrives - speed * move_s - CAR_BACK - feasibility.CAR_NOSE
    trial.require(feasibility.can_follow_braking(speed, theirs, slow, deceleration, gap, FRICTION))
    points = [
        waypoint(lead, LANE, theirs),
        waypoint(arrives, offset, theirs),
        waypoint(arrives + braking, offset, slow),
    ]
    last = arrives + braking + slow * 3.0
    text = f'A car cuts in {lead:.0f} m ahead and brakes to {slow:.1f} m/s.'
    return emergency(trial, text, last, speed, [car_along(points)], extra_s=5.0)


def crossing_pedestrian(trial: Trial) -> Document:
    """Return a pedestrian who walks across the road."""
    walks = trial.uniform(1.0, 2.2)
    return _crossing(trial, trial.uniform(10.0, 20.0), walks, 0.35, 'pedestrian')


def crossing_cyclist(trial: Trial) -> Document:
    """Return a cyclist who rides across the road."""
    rides = trial.uniform(3.0, 6.0)
    return _crossing(trial, trial.uniform(10.0, 22.0), rides, 0.6, 'cyclist')


def _crossing(trial, speed, theirs, radius, who):
    ahead_s = trial.among((1.2, 3.0), hard=(0.8, 1.6))
    seen_s = trial.uniform(0.3, 1.0)
    # where the crosser is when the car arrives at its desired speed
    at = trial.uniform(-1.0, 1.0)
    begin = at - theirs * ahead_s
    x = speed * (seen_s + ahead_s)
    trial.require(feasibility.can_pass_or_stop(speed, ahead_s, radius, at, FRICTION))
    text = f'A {who} crosses at {theirs:.1f} m/s, seen {ahead_s:.2f} s ahead.'
    crosser = disc(x, begin, radius, across_mps=theirs, appears_at_s=seen_s)
    return emergency(trial, text, x, speed, [crosser])


def split_mu(trial: Trial) -> Document:
    """Return an obstacle where one half of the own lane is slippery."""
    return _patch(trial, (0.0, LEFT), 'One half of the road')


def low_mu(trial: Trial) -> Document:
    """Return an obstacle where the whole road is slippery."""
    return _patch(trial, (RIGHT, LEFT), 'The whole road')


def _patch(trial, offsets, what):
    speed = trial.uniform(10.0, 20.0)
    friction = trial.among((0.5, 0.85), hard=(0.25, 0.5))
    begin, length = trial.uniform(20.0, 40.0), trial.uniform(40.0, 80.0)
    ahead_s = trial.among((1.6, 3.5), hard=(1.2, 2.2))
    x = begin + trial.uniform(0.2, 0.9) * length
    radius, offset = trial.uniform(0.4, 1.0), trial.uniform(-1.0, 1.0)
    trial.require(feasibility.can_pass_or_stop(speed, ahead_s, radius, offset, friction))
    patch = {
        'from_m': begin,
        'to_m': begin + length,
        'from_offset_m': offsets[0],
        'to_offset_m': offsets[1],
        'friction': friction,
    }
    text = f'{what} has a friction of {friction:.2f}, and an obstacle; {speed:.1f} m/s.'
    obstacle = disc(x, offset, radius, appears_at_s=max(0.0, x / speed - ahead_s))
    return emergency(trial, text, max(x, begin + length), speed, [obstacle], patches=[patch])


def several_movers(trial: Trial) -> Document:
    """Return a slower car ahead, an oncoming one in the next lane, and a walker on the shoulder."""
    speed = trial.uniform(14.0, 25.0)
    slower, theirs = trial.uniform(0.35, 0.65) * speed, trial.uniform(8.0, 18.0)
    reach_s = trial.among((2.2, 4.0), hard=(1.5, 2.5))
    gap = (speed - slower) * reach_s
    trial.require(_can_follow(speed, slower, gap - CAR_BACK))
    # the oncoming car is beside the slower one some time around that
    beside_s = reach_s + trial.uniform(-1.0, 2.0)
    beside = gap + slower * beside_s
    walker = trial.uniform(0.3, 1.0) * speed * reach_s
    last = gap + slower * (max(reach_s, beside_s) + 3.0)
    text = f'A car ahead at {slower:.1f} m/s, one that comes at {theirs:.1f} m/s.'
    others = [
        car(gap, trial.uniform(-0.3, 0.3), slower),
        disc(beside + theirs * beside_s, LANE, CAR_RADIUS, along_mps=-theirs),
        disc(walker, RIGHT + 0.2, 0.3, along_mps=trial.uniform(-1.5, 1.5)),
    ]
    return emergency(trial, text, last, speed, others, extra_s=10.0)


def three_in_sequence(trial: Trial) -> Document:
    """Return three obstacles in the lane, each seen late, one behind the other."""
    speed = trial.uniform(12.0, 22.0)
    x, obstacles = speed * 0.5, []
    for _ in range(3):
        ahead_s = trial.among((1.3, 2.2), hard=(0.8, 1.5))
        radius, offset = trial.uniform(0.4, 1.0), trial.uniform(-1.0, 1.0)
        trial.require(_can_pass_or_stop(speed, ahead_s, radius, offset))
        x += speed * ahead_s
        obstacles.append(disc(x, offset, radius, appears_at_s=x / speed - ahead_s))
    text = f'Three obstacles appear one after the other at {speed:.1f} m/s.'
    return emergency(trial, text, x, speed, obstacles)


def stop_and_go(trial: Trial) -> Document:
    """Return a car ahead that brakes to a stop, waits and drives on, where there is no way past."""
    speed = trial.uniform(10.0, 20.0)
    lead_s = trial.among((1.3, 2.5), hard=(0.8, 1.2))
    deceleration = trial.among((2.0, 4.5), hard=(4.0, 7.0))
    wait_s, on = trial.uniform(1.0, 3.0), trial.uniform(0.6, 1.0) * speed
    lead = CAR_BACK + feasibility.CAR_NOSE + speed * lead_s
    gap = speed * lead_s
    trial.require(feasibility.can_follow_braking(speed, speed, 0.0, deceleration, gap, FRICTION))
    brakes = lead + speed * trial.uniform(0.5, 1.5)
    stands = brakes + speed**2 / (2.0 * deceleration)
    pulls_away = stands + on**2 / (2.0 * 2.0)
    points = [
        waypoint(lead, 0.0, speed),
        waypoint(brakes, 0.0, speed),
        waypoint(stands, 0.0, 0.0, wait_s),
        waypoint(pulls_away, 0.0, on),
    ]
    text = f'The car ahead brakes with {deceleration:.1f} m/s2, waits, and drives on.'
    more = {'left': 2.2, 'right': -2.2, 'extra_s': 15.0}
    return either_side(trial, document(text, stands + 40.0, speed, [car_along(points)], **more))


def _can_pass_or_stop(speed, ahead_s, radius, offset):
    """Return whether a car can move aside of, or stop before, an obstacle seen so late."""
    shift = feasibility.shift_beside(radius, offset)
    # there must be road on the side that is nearer
    room = LEFT - offset - radius if offset <= 0.0 else offset - radius - RIGHT
    if room < feasibility.CAR_WIDTH + 2.0 * feasibility.CLEARANCE:
        shift = radius + abs(offset) + feasibility.CAR_WIDTH / 2 + feasibility.CLEARANCE
    can_pass = feasibility.lateral_shift(ahead_s, FRICTION) >= shift
    return can_pass or feasibility.can_stop(speed, speed * ahead_s - radius, FRICTION)


def _can_follow(speed, theirs, gap):
    """Return whether a car can brake to another's speed before it has closed a gap [m]."""
    return feasibility.can_stop(speed - theirs, gap, FRICTION)


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
