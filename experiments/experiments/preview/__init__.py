"""A scenario before it is driven: `experiments scenario`.

scenario_checks   what it holds, what is checked with numbers, what is probably a mistake
preview_figure    the scenario from above, speed and lateral acceleration along the path
"""
