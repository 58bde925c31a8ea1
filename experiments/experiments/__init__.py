"""Experiments: runs of the closed loop, replay of recordings, studies, tuning, the paper.

Run
    scripting          `drive` and `drive_many`: drives from Python, results as DataFrames
    simulation         the closed loop in process, without ROS
    estimation         the estimator between sensors and controller
    run                runs of the node graph: processes, recording, comparison
    configuration      nodes and parameters of a run, checked before it starts
    batch              a study file: scenarios, parameters and controllers, combined and driven
    preview            a scenario before it is driven
    families           random emergencies as scenario files
    library            families and entries of emergencies, driven: who survives
Analyse
    replay             recorded ticks through today's controller
    drive_table        a table of drives: its metrics over columns, pairs of controllers
    drive_figures      these as figures, success surfaces among them
    survivable         which emergencies any driver can survive
    tuned_study        the study of tuned controllers: estimands, verdicts, figures
    settings_study     the published shares of the study over many settings
    tuning             controller weights by the search of the study
    measured           the car from recorded driving, and the prediction against it
Common
    cli, commands      the command `experiments`
    drive_row          one drive: scenario, controller, settings, start offset; its key and results
    row_runner         rows driven by a pool, finished ones kept one by one, and their table
    pool               processes of this machine or of a dask.distributed cluster
    code_version       the code that decides a drive
    progress           progress on the console
    pass_criteria      what a scenario expects of a run
    plant_limit        the lateral acceleration that the plant reaches
    statistical_inference  intervals of shares, of their paired differences, and of means

In Python:

    from experiments import drive

    result = drive('double_lane_change', 'mpcc', {'controller.tolerances.contouring_m': 0.4})
    result.metrics['min_v2o_m']
    result.frame('/vehicle/odometry')
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bags.run_set import compare
    from experiments.scripting import drive, drive_many

__all__ = ['compare', 'drive', 'drive_many']
# imported when they are first used
_MODULES = {
    'compare': 'bags.run_set',
    'drive': 'experiments.scripting',
    'drive_many': 'experiments.scripting',
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
