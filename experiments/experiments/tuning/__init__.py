"""Tuning: Bayesian optimisation of controller weights in two stages, simulated in process.

problem        weights and ranges, objective, constraints
weight_search  the two stages of the optimisation, resumable
tune           `experiments tune`: search, tuned controller files, summary
tuning_figure  the history of a search
"""
