"""One run of the node graph: start the nodes, watch until the plant ends, stop them, keep the bag.

Each node is a process of its own.
"""

import json
import os
import re
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bags.storage.message_filing import CLOCK
from experiments.configuration import inputs, node_config
from experiments.configuration.node_config import Controller, LoadedFacts, Node
from experiments.progress import RunProgress
from experiments.run import processes
from experiments.run.live_position import STATE, PositionReader
from experiments.run.processes import Interrupt, Interrupted, Process, ProcessError
from experiments.run.staging import StagingDirectory
from node_runtime.provenance import DIRTY
from scenario_publisher.scenario import Scenario

POLL_S = {'lockstep': 0.0, 'realtime': 1.0}  # least time between two reads of the growing bag
NICE = {'recorder': 5}  # realtime: messages wait for the recorder without harm
RECORDER_S = 30.0  # to write the messages still queued, and to complete the bag
FIRST_STATE_S = 300.0  # of wall time; the solvers may have to be compiled before
TRACEBACK = 'traceback.txt'  # beside the logs of the nodes
# the prefix of ROS before a message: [INFO] [1700000000.123456789] [plant]:
PREFIX = re.compile(r'^(\[[^\]]*\] ?)+: ')
# exit codes of the plant after a regular end: finish line, neither reached, no controller
FINISHED, NOT_FINISHED, CONTROLLER_GONE = 0, 2, 3
REGULAR_ENDS = (FINISHED, NOT_FINISHED, CONTROLLER_GONE)


class RunSettings(NamedTuple):
    """The settings shared by the runs of a batch."""

    scn: Scenario
    mode: str  # lockstep or realtime
    folder: Path  # that receives <controller>/
    time_limit_s: float  # of wall time per run
    domain: int = 0  # ROS_DOMAIN_ID
    markers: bool = False  # whether to start the node that draws for 3D viewers
    overwrite: bool = False  # whether an older bag is replaced rather than kept under a number

    @property
    def path(self) -> np.ndarray:
        """The coarse path, (n, 2) [m]."""
        return np.column_stack([self.scn.reference.X, self.scn.reference.Y])


class RunOutcome(NamedTuple):
    """The end of one run."""

    controller: str  # with its label
    completed: bool
    message: str
    bag: Path | None  # where the bag was kept
    older: Path | None = None  # where the bag went that was in its place, if that was kept
    has_replaced: bool = False  # whether that bag was removed


def run_once(
    settings: RunSettings,
    controller: Controller,
    nodes: Sequence[Node],
    loaded: LoadedFacts,
    interrupt: Interrupt,
    progress: RunProgress,
) -> RunOutcome:
    """Run the nodes of one controller; `loaded` (`inputs.loaded_facts`) is recorded.

    In any case no process is left behind, the recording is kept, and an older bag makes way for a
    complete one only: it gets a number, unless `settings` overwrite it or the new one repeats it.
    A node that ends early, a run beyond its time limit, a bag that is not
    closed and an unexpected exception give an outcome that is not completed; recording and logs,
    with the traceback of such an exception, are then in `<controller>.failed`. Where they cannot
    be moved there, they stay in a hidden folder, which the outcome names. After a signal raises
    Interrupted: a complete bag is then in `<controller>.interrupted`, one that was not closed in
    `<controller>.failed`; without a recording nothing is kept.
    """
    name = controller.run_name
    try:
        staging = StagingDirectory(settings.folder, name)
    except OSError as error:
        return RunOutcome(name, False, f'no folder for the run: {error}', None)
    try:
        run_info = staging.logs / node_config.RUN_INFO_FILE
        nodes = inputs.record_to(nodes, staging.bag, run_info)
        node_config.write_run_info(settings.scn, controller, settings.mode, nodes, run_info, loaded)
        same = _is_repetition(run_info, staging.final / staging.logs.name / run_info.name)
        staging.keeps_older = not (settings.overwrite or same)
        if settings.markers:
            nodes = [node_config.build_markers_node(nodes), *nodes]
        reader = PositionReader(staging.bag, settings.path, POLL_S[settings.mode])
        message, code = _drive(nodes, settings, staging, interrupt, progress, reader)
    except Interrupted as interrupted:
        interrupted.kept = staging.root
        with suppress(OSError):
            interrupted.kept = staging.keep_interrupted()
        raise
    except Exception as error:
        # one run must not end the later ones, nor the comparison of the earlier ones
        message = str(error)
        if not isinstance(error, ProcessError):
            message = f'{type(error).__name__}: {error}'.removesuffix(': ')
            with suppress(OSError):
                (staging.logs / TRACEBACK).write_text(traceback.format_exc())
        return RunOutcome(name, False, _keep_failed(staging, message), None)
    kept = staging.final, staging.older, staging.has_replaced
    return RunOutcome(name, code == FINISHED, message, *kept)


def _is_repetition(new, old):
    """Return whether two files of run information say that both runs have the same bag.

    Only in lockstep, and only where a commit tells which program ran: with uncommitted changes, or
    outside of a repository, nothing does.
    """
    try:
        ours, theirs = infos = [json.loads(file.read_text()) for file in (new, old)]
        for info in infos:
            info['parameters'] = nodes = json.loads(info.get('parameters', '{}'))
            for name in ('out', 'run_info'):  # where the recorder writes differs between any two
                nodes.get('recorder', {}).pop(name, None)
    except (OSError, ValueError, TypeError, AttributeError):
        return False
    commit = ours.get('git_commit', '')
    is_known = bool(commit) and not commit.endswith(DIRTY)
    return is_known and ours.get('mode') == 'lockstep' and ours == theirs


def _keep_failed(staging, message):
    """Keep the files of a failed run; return the message with their location."""
    text = f'{message}\n  {staging.describe_recording()}\n  logs: {staging.logs}'
    try:
        staging.keep_failed()
    except OSError as error:
        return f'{text}\n  left in {staging.root}: {error}'
    return text.replace(str(staging.root), str(staging.failed))


def _drive(nodes, settings, staging, interrupt, progress, reader):
    """Run the nodes and keep the bag; return the last message of the plant and its exit code."""
    environment = processes.node_environment(settings.domain, staging.logs)
    cores = _cores(settings.mode)
    running: dict[str, Process] = {}
    try:
        for node in nodes:
            running[node.role] = processes.start_node(
                node,
                staging.logs,
                environment,
                name=node.executable,
                program=node.program,
                cores=cores.get(node.role),
                nice=NICE.get(node.role, 0) if cores else 0,
            )
        code = _watch(running, settings.time_limit_s, interrupt, progress, reader)
    finally:
        recorder = [process for role, process in running.items() if role == 'recorder']
        processes.stop([p for role, p in running.items() if role != 'recorder'])
        processes.stop(recorder, RECORDER_S)
    if running['recorder'].code != 0 or not staging.is_closed:
        report = processes.exit_report(running['recorder'])
        raise ProcessError(f'the bag was not closed: {report}')
    message = PREFIX.sub('', processes.last_line(running['plant'].log))
    staging.keep()
    return message or f'the plant ended with exit code {code}', code


def _watch(running, time_limit_s, interrupt, progress, reader):
    """Return the plant's exit code; ProcessError when a node ends early or time runs out."""
    plant = running['plant']
    others = [process for process in running.values() if process is not plant]
    begin, has_state = time.monotonic(), False
    while plant.code is None:
        processes.check_running(others)
        position = reader.poll()
        if position:
            has_state = True
            progress.show(*position)
        limit_s = time_limit_s if has_state else min(time_limit_s, FIRST_STATE_S)
        if time.monotonic() - begin > limit_s:
            what = f'the run took longer than {limit_s:g} s of wall time'
            if not has_state:
                sent = f'a plant sends {STATE}, in lockstep {CLOCK}, too'
                what += f', and no state of the car was recorded ({sent})'
            lines = (f'\n  {p.name}: {processes.last_line(p.log)}' for p in running.values())
            raise ProcessError(f'{what}; last messages of the nodes:{"".join(lines)}')
        interrupt.sleep()
    if plant.code not in REGULAR_ENDS:
        raise ProcessError(processes.exit_report(plant))
    return plant.code


def _cores(mode):
    """Return a core each for plant and controller in realtime, {} otherwise."""
    available = sorted(os.sched_getaffinity(0))
    if mode != 'realtime' or len(available) < 2:
        return {}
    return {'plant': {available[0]}, 'controller': {available[1]}}
