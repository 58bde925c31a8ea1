"""Drives that were made by hand, as the figures and the comparison take recorded ones."""

from bags.evaluation.drive import drop_nonfinite
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import style
from bags.report.comparison import compare_runs


def evaluate_runs(drives):
    """Return the runs of drives by name, in their order, each with its look."""
    return style.assign({name: EvaluatedDrive(drive) for name, drive in drives.items()})


def compare_drives(drives, out):
    """Evaluate drives by name and write the results into the folder `out`."""
    finite = {name: drop_nonfinite(drive) for name, drive in drives.items()}
    return compare_runs(evaluate_runs(finite), out)
