"""The study over many settings: each a random point of everything that the paper does not print.

plan            ranges, arms, preconditions and claims: config/settings_study.yaml
course          the double lane change of a setting
demand          the lateral acceleration that it demands of any car
plant_variants  plants, their lateral limits, and the car files identified on them
setting         a drawn point made into a setting, or why it is none
arms            the controllers that drive a setting
measures        what a row holds of a drive
drive           one drive, in a worker
preconditions   which settings say something about the paper's claims
primaries       the claims on a setting
outcomes        preconditions and claims of every setting, from the rows of drives
factorial       effects of the factors that separate MPCC and baseline
recompute       what was published of the first study, from the rows that are kept
"""
