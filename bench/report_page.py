"""How long the report of three runs takes to make, and how large it is.

The runs are driven in process; making the page is repeated, and the median of CPU time printed.
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from bags.evaluation import metrics
from bags.figures import panels
from bags.report import page
from experiments import simulation

CONTROLLERS = ('mpcc', 'mpcc_no_ca', 'frenet')
REPEATS = 5


def main() -> int:
    """Print median time and size."""
    drives = {
        name: simulation.drive(simulation.prepare('double_lane_change', name))
        for name in CONTROLLERS
    }
    runs = panels.evaluate_runs(drives)
    found = {run.name: metrics.compute_metrics(run.drive, run.series) for run in runs}
    material = page.ReportData({'scenario': 'double_lane_change', 'runs': found}, runs, {})
    took = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, page.REPORT_FILE)
        for _ in range(REPEATS):
            start = time.process_time()
            page.write_report(material, file)
            took.append(time.process_time() - start)
        size = file.stat().st_size
    print(f'{statistics.median(took):.2f} s of CPU time, {size / 1e6:.2f} MB')
    return 0


if __name__ == '__main__':
    sys.exit(main())
