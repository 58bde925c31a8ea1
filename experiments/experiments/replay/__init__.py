"""Replay: recorded ticks through today's controller.

check                `experiments replay-check`: all ticks, compared with the recorded answers
resolve              `experiments resolve`: one tick, chosen, solved again, changed

recorded_ticks       the inputs and the recorded answer of each tick of a bag; golden recordings
replayed_controller  a controller with the parameters of a recorded run
recorded_problem     the optimal control problem of one tick
horizon_figure       the figure of one tick's plan
"""

# events of a drive that name a tick, as `experiments resolve --at EVENT` takes them
LOSS = 'loss'
LEAD_S = 1.0  # s, from the tick that LOSS names to the loss
# events, and where their ticks are
EVENTS = {
    'closest': 'least distance to an obstacle',
    'edge': 'least distance to a road edge',
    'sideslip': 'largest sideslip angle',
    'fallback': 'first tick without a fresh plan',
    LOSS: f'{LEAD_S:g} s before the car first collided, left the road or slid',
}
