"""Compile the plant and controllers into the cache, ahead of their first drive.

The cache is the folder $MPCC_CACHE_DIR, else mpcc in $XDG_CACHE_HOME, else ~/.cache/mpcc. What is
there is not compiled again. It serves this machine and others with the same processor, compiler,
version of CasADi and sources.
"""

import argparse
import os

from rich.console import Console

from experiments.commands import add_jobs

HELP = 'compile plant and controllers ahead of their first drive'
EXAMPLE = 'experiments compile mpcc_road ./my_controller.yaml'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments compile`."""
    text = 'a name in mpcc_controller/config, or a YAML file (default: every name)'
    parser.add_argument('controllers', nargs='*', metavar='CONTROLLER', help=text)
    add_jobs(parser, 'what is compiled')


def run(options: argparse.Namespace) -> int:
    """Compile; return 0. Raises BagError, and CompileError without a working compiler."""
    from experiments.configuration import node_config
    from experiments.pool import Pool
    from stage_solver import compile_cache

    names = options.controllers or list(node_config.known_controllers())
    console = Console()
    controllers = node_config.find_controllers(names)
    tasks = [(None,), *((str(controller.config),) for controller in controllers)]
    with Pool(options.jobs, console=console) as pool:
        pool.progress.show('compiling', 0, len(tasks))
        for done, finished in enumerate(pool.finish_each(_prepare, tasks), start=1):
            if finished.error:
                raise finished.error
            pool.progress.show('compiling', done, len(tasks))
    folder = os.path.relpath(compile_cache.cache_dir())
    console.print(f'compiled, in {folder}: the plant, {", ".join(names)}', highlight=False)
    return 0


def _prepare(config):
    """Make a controller as its node does, or the plant for None."""
    from experiments.configuration import inputs
    from mpcc_controller import car_file
    from mpcc_controller.driving.controller import Controller
    from vehicle_plant import integrator

    if config is None:
        integrator.library()
    else:
        params = inputs.controller_params(config)
        Controller(params, car_file.load(params))
