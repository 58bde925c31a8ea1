"""What appears, comes towards the car, drives ahead of it or crosses, on a straight road.

Where a part of the road is slippery, no topic carries its friction. The coarse path goes straight
on and prescribes no side to pass on. Each public function is a family.
"""

from experiments.families import feasibility
from experiments.families.scenario_document import (
    CAR_RADIUS,
    FRICTION,
    LANE,
    LEFT,
    RIGHT,
    Document,
    Trial,
    car,
    car_along,
    disc,
    document,
    either_side,
    emergency,
    waypoint,
)

CAR_BACK = 2.4  # m from the middle of another car to its bumpers


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
