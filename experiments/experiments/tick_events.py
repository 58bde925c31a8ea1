"""Events of a drive that name a tick, as `experiments resolve --at EVENT` takes them."""

LOSS = 'loss'
LEAD_S = 1.0  # from the tick of LOSS to that
# events, and where their ticks are
EVENTS = {
    'closest': 'least distance to an obstacle',
    'edge': 'least distance to a road edge',
    'sideslip': 'largest sideslip angle',
    'fallback': 'first tick without a fresh plan',
    LOSS: f'{LEAD_S:g} s before the car first collided, left the road or slid',
}
