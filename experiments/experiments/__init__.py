"""Experiments: runs of the closed loop, replay of recordings, studies, tuning, the paper.

Run
    simulation        the closed loop in process, without ROS
    run               runs of the node graph: processes, recording, comparison
    configuration     nodes and parameters of a run, checked before it starts
Analyse
    replay            recorded ticks through today's controller
    study             the controllers compared over many paired runs
    tuning            controller weights by Bayesian optimisation
    paper             the results of the paper, reproduced
Common
    cli, commands     the command `experiments`
    worker_pool       processes that share work over the cores
    progress          progress on the console
"""
