"""An obstacle in a bend, on its inside or its outside; the coarse path follows the bend."""

from random import Random

from experiments.families import feasibility
from experiments.families.scenario_document import (
    Document,
    arc,
    clothoid,
    disc,
    document,
    either_side,
    finish,
    straight,
)

RADII = (30.0, 200.0)  # m
GRIP_SHARES = (0.3, 0.75)  # of the lateral acceleration that the friction allows
SPEEDS = (9.0, 30.0)  # m/s
HALF_ROAD = 4.25  # m
FRICTION = 1.0


def bend_inside(random: Random, hard: bool) -> Document | None:
    """Return an obstacle on the inside of a bend."""
    return _bend(random, hard, 1.0, 'inside')


def bend_outside(random: Random, hard: bool) -> Document | None:
    """Return an obstacle on the outside of a bend."""
    return _bend(random, hard, -1.0, 'outside')


def _bend(random, hard, side, name):
    radius = random.uniform(*RADII)
    share = random.uniform(*GRIP_SHARES)
    speed = (share * FRICTION * feasibility.GRAVITY * radius) ** 0.5
    ahead_s = random.uniform(0.8, 1.5) if hard else random.uniform(1.2, 3.0)
    size, offset = random.uniform(0.4, 1.0), random.uniform(0.2, 1.4)
    into_s = random.uniform(0.5, 2.0)
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        return None
    # grip that the bend leaves to either side of the circle
    left_over = FRICTION * (1.0 - share**2) ** 0.5
    if not hard and not feasibility.can_pass_or_stop(speed, ahead_s, size, offset, left_over):
        return None
    lead_in, into = speed * 1.2, speed * 1.5
    x = lead_in + into + speed * into_s
    turn = speed * into_s + max(15.0, 1.5 * speed)
    length = lead_in + into + turn + into + speed
    kappa = 1.0 / radius
    segments = [
        straight(lead_in),
        clothoid(into, 0.0, kappa),
        arc(turn, kappa),
        clothoid(into, kappa, 0.0),
    ]
    segments.append(straight(max(length, finish(x, speed)) - lead_in - 2 * into - turn))
    parts = document(
        description=f'An obstacle {name} of a bend of {radius:.0f} m at {speed:.1f} m/s.',
        length=max(length, finish(x, speed)),
        speed=speed,
        segments=segments,
        obstacles=[disc(x, side * offset, size, appears_at_s=max(0.0, x / speed - ahead_s))],
        left=HALF_ROAD,
        right=-HALF_ROAD,
    )
    return either_side(random, parts)
