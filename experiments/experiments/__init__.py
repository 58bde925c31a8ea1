"""Experiments: runs of the closed loop, replay of recordings, studies, tuning, the paper.

Run
    simulation         the closed loop in process, without ROS
    run                runs of the node graph: processes, recording, comparison
    configuration      nodes and parameters of a run, checked before it starts
    batch              a study file: scenarios, parameters and controllers, combined and driven
    library            families of random emergencies, and who survives them
    settings           random settings of everything that the paper does not print
Analyse
    replay             recorded ticks through today's controller
    results            tables and plots of the drives of a batch
    survivable         which emergencies any driver can survive
    study              the controllers compared over many paired runs
    settings_analysis  the claims of the paper over the settings
    tuning             controller weights by Bayesian optimisation
    paper              the results of the paper, reproduced
Common
    cli, commands      the command `experiments`
    worker_pool        processes that share work over the cores
    cluster_pool       the same on the machines of a dask.distributed cluster
    search_journal     the trials of a search, kept in a file
    progress           progress on the console
    pass_criteria      what a scenario expects of a run
    plant_limit        the lateral acceleration that the plant reaches
    wilson             the interval of a share
    multiple_tests     the correction of the p-values of several tests
"""
