"""What is possible: which emergencies any driver can survive, on the plant itself.

emergency         the instant from which the search may act, and everything that happens afterwards
road_coordinates  the coarse path as a coordinate line
sides             coarse paths past each obstacle on either side, the seeds of the search
pilots            who drives: an MPCC with hindsight, or a manoeuvre tracked by feedback
bound             positions that no car can leave: what is impossible
survival_search   `survivable(setup)`: possible (proved by a drive), impossible (bound) or undecided
report            the command: losses that were possible; controllers paired on the same draws
"""
