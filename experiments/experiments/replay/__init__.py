"""Replay: recorded ticks through today's controller.

check                `experiments replay-check`: all ticks, compared with the recorded answers
resolve              `experiments resolve`: one tick, solved again, changed, with sensitivities
golden               the golden recordings, which every version must answer as recorded

tick_choice          which tick is meant by a time, a station, or an event
recorded_ticks       the inputs and the recorded answer of each tick of a bag
replayed_controller  a controller with the parameters of a recorded run
recorded_problem     the optimal control problem of one tick
horizon_figure       the figure of one tick's plan
"""
