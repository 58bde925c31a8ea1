"""The study over many settings: each a random point of everything that the paper does not print.

preregistration  the file that fixes ranges, arms, preconditions and claims beforehand
course           the double lane change of a setting, and what it demands
plant_variants   plants, their lateral limits, and the car files identified on them
setting          a drawn point made into a setting, or why it is none
arms             the controllers that drive a setting
measures         what the table holds of a drive
drive            one drive, in a worker
preconditions    which settings say something about the paper's claims
primaries        the claims on a setting
outcomes         preconditions and claims of every setting, from the table of drives
run_settings     all of that, in parallel, to be interrupted at any time
"""
