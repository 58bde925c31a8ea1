"""Obstacles on another friction, under one side of the car or both; no topic carries it."""

from random import Random

from experiments.families import feasibility
from experiments.families.scenario_document import (
    LEFT,
    RIGHT,
    Document,
    disc,
    document_either_side,
)


def split_mu(random: Random, hard: bool) -> Document | None:
    """Return an obstacle where one half of the own lane is slippery."""
    return _patch(random, hard, (0.0, LEFT), 'One half of the road')


def low_mu(random: Random, hard: bool) -> Document | None:
    """Return an obstacle where the whole road is slippery."""
    return _patch(random, hard, (RIGHT, LEFT), 'The whole road')


def _patch(random, hard, offsets, what):
    speed = random.uniform(10.0, 20.0)
    friction = random.uniform(0.25, 0.5) if hard else random.uniform(0.5, 0.85)
    begin, length = random.uniform(20.0, 40.0), random.uniform(40.0, 80.0)
    ahead_s = random.uniform(1.2, 2.2) if hard else random.uniform(1.6, 3.5)
    x = begin + random.uniform(0.2, 0.9) * length
    radius, offset = random.uniform(0.4, 1.0), random.uniform(-1.0, 1.0)
    if not hard and not feasibility.can_pass_or_stop(speed, ahead_s, radius, offset, friction):
        return None
    patch = {
        'from_m': begin,
        'to_m': begin + length,
        'from_offset_m': offsets[0],
        'to_offset_m': offsets[1],
        'friction': friction,
    }
    return document_either_side(
        random,
        description=f'{what} has a friction of {friction:.2f}, and an obstacle; {speed:.1f} m/s.',
        last=max(x, begin + length),
        speed=speed,
        obstacles=[disc(x, offset, radius, appears_at_s=max(0.0, x / speed - ahead_s))],
        patches=[patch],
    )
