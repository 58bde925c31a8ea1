"""Weights of a controller by Bayesian optimisation in two stages, on the ring in process."""
