"""Standard test procedures of the plant, with closed forms to compare with.

procedure            how a manoeuvre is driven and evaluated
settings             their settings, config/manoeuvres.yaml
steady_circle        ISO 4138: understeer gradient, lateral limit
step_steer           ISO 7401: rise, response and peak time
sine_sweep           ISO 7401: frequency response
straight_braking     stopping distance
turn_braking         ISO 7975: braking on a circle
sine_with_dwell      FMVSS 126: stability and agility
linear_single_track  closed forms of small steering at constant speed

A manoeuvre is a module with runs(case) -> tuple[Run, ...] and numbers(case, runs, trajectories) ->
dict[str, Number]; trajectories are in the order of the runs.
"""
