"""One run: start the nodes of the ring, watch until the plant ends, stop them, keep the bag."""

import os
import re
import time
import traceback
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from experiments.configuration import experiment
from experiments.configuration.experiment import Controller, ScenarioFacts
from experiments.run import launch, processes
from experiments.run.folders import Workshop
from experiments.run.follow import Follower
from experiments.run.interrupt import Interrupt, Interrupted
from experiments.run.processes import Process, ProcessError
from experiments.run.progress import Progress

LOOK_S = {'lockstep': 0.0, 'realtime': 1.0}  # least between two looks at the growing bag
STAND_BACK = {'recorder': 5}  # niceness, realtime: messages wait for it without harm
RECORDER_S = 30.0  # to write what is still under way, and to complete the bag
SETTLE_S = 0.3
TRACEBACK = 'traceback.txt'  # beside the logs of the nodes
# what ROS puts before a message: [INFO] [1700000000.123456789] [plant]:
PREFIX = re.compile(r'^(\[[^\]]*\] ?)+: ')
# exit codes of the plant that end a run as they should: finish line, neither reached, no controller
FINISHED, NOT_FINISHED, CONTROLLER_GONE = 0, 2, 3
ENDINGS = (FINISHED, NOT_FINISHED, CONTROLLER_GONE)


class Settings(NamedTuple):
    """How runs are made."""

    mode: str  # lockstep or realtime
    folder: Path  # that receives <controller>/
    overrides: Mapping[str, Mapping[str, Any]]  # parameters by role
    domain: int  # ROS_DOMAIN_ID
    time_limit_s: float  # of wall time per run
    markers: bool = False  # whether a node draws the ring for 3D viewers


class Outcome(NamedTuple):
    """How one run ended."""

    controller: str
    completed: bool
    message: str
    bag: Path | None  # where the bag was kept


def one(
    facts: ScenarioFacts,
    chosen: Controller,
    file_values: Mapping[str, Mapping[str, Any]],
    settings: Settings,
    interrupt: Interrupt,
    progress: Progress,
) -> Outcome:
    """Run one controller through a scenario with every node a process of its own.

    `file_values` are noted with the run; they come from `inputs.file_values`.
    Whatever happens, no process is left behind, what was recorded is kept, and an older bag is left
    alone unless the new one is complete. A node that ends early, a run beyond its time limit, a bag
    that is not closed or an exception that nobody expects give an Outcome that is not completed;
    the logs (with the traceback of such an exception) and the recording are then in
    `<controller>.failed`. After a signal a complete bag is in `<controller>.interrupted`, one that
    was not closed in `<controller>.failed`, and nothing is kept where nothing was recorded. Where
    the disk allows no such move, all stays in a hidden folder, which the Outcome names. Raises
    Interrupted.
    """
    try:
        workshop = Workshop(settings.folder, chosen.name)
    except OSError as error:
        return Outcome(chosen.name, False, f'no folder for the run: {error}', None)
    try:
        run_info = workshop.logs / launch.NOTES
        ring = experiment.nodes(
            facts, chosen, settings.mode, workshop.bag, run_info, settings.overrides
        )
        launch.note(facts, chosen, settings.mode, ring, run_info, file_values)
        if settings.markers:
            ring = [experiment.markers(ring), *ring]
        follower = Follower(workshop.bag, facts.path, LOOK_S[settings.mode])
        message, code = _drive(ring, settings, workshop, interrupt, progress, follower)
    except Interrupted as interrupted:
        interrupted.kept = workshop.root
        with suppress(OSError):
            interrupted.kept = workshop.keep_interrupted()
        raise
    except ProcessError as error:
        return Outcome(chosen.name, False, _set_aside(workshop, str(error)), None)
    except Exception as error:
        # one run must not end those that follow it, nor the comparison of those before
        with suppress(OSError):
            (workshop.logs / TRACEBACK).write_text(traceback.format_exc())
        message = f'{type(error).__name__}: {error}' if str(error) else type(error).__name__
        return Outcome(chosen.name, False, _set_aside(workshop, message), None)
    return Outcome(chosen.name, code == FINISHED, message, workshop.final)


def _set_aside(workshop, message):
    """Keep what there is of a failed run; return the message with where that is."""
    text = f'{message}\n  {workshop.describe_recording()}\n  logs: {workshop.logs}'
    try:
        workshop.set_aside()
    except OSError as error:
        return f'{text}\n  left in {workshop.root}: {error}'
    return workshop.after_set_aside(text)


def _drive(ring, settings, workshop, interrupt, progress, follower):
    """Return the plant's last words and its exit code; the bag is in its place by then."""
    environment = launch.environment(settings.domain, workshop.logs)
    cores = _cores(settings.mode)
    running: dict[str, Process] = {}
    try:
        for node in ring:
            running[node.role] = launch.start(
                node,
                workshop.logs,
                environment,
                name=node.executable,
                cores=cores.get(node.role),
                nice=STAND_BACK.get(node.role, 0) if cores else 0,
            )
        code = _watch(running, settings.time_limit_s, interrupt, progress, follower)
        # the state at the end is answered, too: so the same run always records the same messages
        time.sleep(SETTLE_S)
    finally:
        recorder = [process for role, process in running.items() if role == 'recorder']
        processes.stop([p for role, p in running.items() if role != 'recorder'])
        processes.stop(recorder, RECORDER_S)
    if running['recorder'].code != 0 or not workshop.is_closed:
        raise ProcessError(f'the bag was not closed: {processes.obituary(running["recorder"])}')
    said = PREFIX.sub('', processes.last_line(running['plant'].log))
    workshop.keep()
    return said or f'the plant ended with exit code {code}', code


def _watch(running, time_limit_s, interrupt, progress, follower):
    """Return the plant's exit code; ProcessError when anything ends that should not."""
    plant = running['plant']
    others = [process for process in running.values() if process is not plant]
    deadline = time.monotonic() + time_limit_s
    while plant.code is None:
        processes.check(others)
        sight = follower.look()
        if sight:
            progress.show(sight)
        if time.monotonic() > deadline:
            said = (f'\n  {p.name}: {processes.last_line(p.log)}' for p in running.values())
            raise ProcessError(
                f'the run took longer than {time_limit_s:g} s of wall time; the nodes said last:'
                + ''.join(said)
            )
        interrupt.sleep()
    if plant.code not in ENDINGS:
        raise ProcessError(processes.obituary(plant))
    return plant.code


def _cores(mode):
    """Return the core of its own that plant and controller get on the wall clock."""
    available = sorted(os.sched_getaffinity(0))
    if mode != 'realtime' or len(available) < 2:
        return {}
    return {'plant': {available[0]}, 'controller': {available[1]}}
