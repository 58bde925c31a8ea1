"""Closed forms that say whether a draw can be mastered, of a point mass with a friction circle.

A nominal draw is one that a car can stop before or move aside of. The limits leave room for what a
point mass has not: a car needs DELAY_S until it turns or brakes, and reaches GRIP_SHARE of the
grip of its tyres. They are necessary conditions that a person can check, not a proof: what a car
can survive is the result of a search over manoeuvres on the plant. Hard draws are not sieved.
"""

GRAVITY = 9.81  # m/s^2
DELAY_S = 0.15  # until steering or brakes act
GRIP_SHARE = 0.85  # of friction * g
CAR_WIDTH = 1.86  # m
CAR_NOSE = 2.4  # m from the centre of gravity to the front bumper
CLEARANCE = 0.2  # m that a driver leaves


def lateral_shift(time_s: float, friction: float) -> float:
    """Return how far [m] a car can move aside in a time: a t^2 / 2."""
    t = max(0.0, time_s - DELAY_S)
    return GRIP_SHARE * friction * GRAVITY * t**2 / 2.0


def lateral_shift_and_back(time_s: float, friction: float) -> float:
    """Return how far [m] a car can move aside in a time and be parallel again: a t^2 / 4."""
    return lateral_shift(time_s, friction) / 2.0


def braking_distance(speed: float, friction: float) -> float:
    """Return the distance [m] from the sight of a reason to brake until the car stands."""
    return DELAY_S * speed + speed**2 / (2.0 * GRIP_SHARE * friction * GRAVITY)


def shift_beside(radius: float, offset: float) -> float:
    """Return how far [m] a car has to move aside to pass a disc on its nearer side.

    offset  of the disc's centre from that of the car, to either side
    """
    return max(0.0, radius + CAR_WIDTH / 2 + CLEARANCE - abs(offset))


def can_stop(speed: float, distance: float, friction: float) -> bool:
    """Return whether a car can stop before its nose has gone a distance [m]."""
    return braking_distance(speed, friction) + CAR_NOSE <= distance


def can_pass_or_stop(
    speed: float, ahead_s: float, radius: float, offset: float, friction: float
) -> bool:
    """Return whether a car can move aside of, or stop before, a disc that is `ahead_s` [s] away."""
    can_pass = lateral_shift(ahead_s, friction) >= shift_beside(radius, offset)
    return can_pass or can_stop(speed, speed * ahead_s - radius, friction)


def can_follow_braking(
    speed: float, theirs: float, slow: float, deceleration: float, gap: float, friction: float
) -> bool:
    """Return whether a car can stay behind one that brakes at once, from a gap [m].

    theirs, slow, deceleration  of the car ahead: its speed, that to which it brakes, and how hard
    gap                         from the own nose to its tail when it begins to brake

    Both brake; the gap is smallest when the speeds are equal, on the way or at the end.
    """
    own = GRIP_SHARE * friction * GRAVITY
    ends = (theirs - slow) / deceleration
    # own speed: speed - own (t - DELAY_S); theirs: theirs - deceleration t
    equal = ends
    if own > deceleration:
        equal = max(DELAY_S, (speed - theirs + own * DELAY_S) / (own - deceleration))
    if equal >= ends:
        # the other one has slowed down before
        equal = DELAY_S + max(0.0, speed - slow) / own
    braking, slowing = max(0.0, equal - DELAY_S), min(equal, ends)
    own_way = speed * equal - own * braking**2 / 2.0
    their_way = theirs * slowing - deceleration * slowing**2 / 2.0 + slow * (equal - slowing)
    return own_way - their_way + CLEARANCE <= gap
