"""Run a node from its command line to its exit code."""

import argparse
import gc
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from threading import Thread

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_rmw_implementation_identifier, remove_ros_args

from node_runtime import node_parameters, parameters, ros, scheduling, shutdown, transport
from node_runtime.managed_node import REFUSALS, ManagedNode
from node_runtime.parameters import ParameterError

# also because EventsExecutor without a time-out runs no callback in the wheels of Jazzy
_WAKE_S = 0.1  # longest time until a signal is noticed
_FLUSH_S = 5.0  # with the profiles of others a lost message is sent again after 3 s
_SHUTDOWN_S = 4.0  # usually it takes a tenth of a second
EXIT_CONFIGURATION = os.EX_CONFIG
_EXIT_ERROR = 1
EXIT_CODES = {
    0: 'ended by SIGINT or SIGTERM, or with the run',
    _EXIT_ERROR: 'an error while it ran',
    EXIT_CONFIGURATION: 'a wrong parameter, file or contract: one line in the log, nothing ran',
}


_PARAMETERS = """\
parameters follow `--ros-args`, as `-p NAME:=VALUE` or `--params-file FILE`; their names, ranges,
units and defaults:
  experiments parameters         of all nodes of a run
  ros2 param list                of the nodes that run
  ros2 param describe NODE NAME

example:
  %(prog)s {example}"""


def run(make_node: Callable[[], Node], about: str, example: str) -> int:
    """Run a node as a program, see `spin`; return the exit code.

    Prints what the node is `about`, and an `example` of its arguments, for `--help`; exits with 2
    and one line for words that neither it nor ROS reads. No ROS runs for that.
    """
    argparse.ArgumentParser(
        description=about,
        epilog=_PARAMETERS.format(example=example),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    ).parse_args(remove_ros_args(sys.argv)[1:])
    return spin(make_node)


def finish(node: Node, exit_code: int = 0) -> None:
    """Stop the spinning of a node after this callback; its process exits with this code."""
    node.exit_code = exit_code
    node.finished = True
    if hasattr(node, 'spinning'):
        node.spinning.set_result(None)


def spin(make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Create a node, spin it until it finishes or gets a signal, and return its exit code.

    SIGINT and SIGTERM end it after the running callback, with the node's `exit_code`, 0 unless set.
    A managed node configures and activates itself unless its parameter `autostart` is false. Wrong
    parameters, a file that cannot be used or an invalid contract give one log line and
    EXIT_CONFIGURATION; an error in a callback is printed and gives 1. Then `node.close()` is
    called, if there is one, without a time limit, and the node is destroyed; if the middleware
    hangs there, the process prints its traceback and ends after 4 s with the same exit code. DDS
    discovery is limited to this machine unless the environment sets ROS_AUTOMATIC_DISCOVERY_RANGE
    (`transport.configure`). Call it from the main thread, as the last action of a process: from its
    end on both signals are ignored.
    """
    transport.configure(os.environ, get_rmw_implementation_identifier())
    with shutdown.signals_as_interrupts():
        return _spin(make_node, args)


def shut_down(*nodes: Node, context: Context | None = None) -> None:
    """Destroy nodes and shut down their context; from now on incoming packets are dropped."""
    _drop_incoming()
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown(context=context)


def _spin(make_node, args):
    node, code, error = None, 0, None
    try:
        try:
            # rclpy's own handlers shut down in the middle of a callback
            rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as wrong:  # the base of what rcl raises
            raise ParameterError(f'command line: {wrong}') from None
        node = make_node()
        if isinstance(node, ManagedNode):
            node.start()
        _apply_scheduling(node)
        _spin_until_finished(node)
    except BaseException as caught:
        shutdown.call_on_signal(lambda: None)  # none interrupts the closing
        error = caught  # it refers to a half-built node, whose destruction needs a time limit, too
        if isinstance(error, REFUSALS):
            rclpy.logging.get_logger('start').fatal(str(error))
            code = EXIT_CONFIGURATION
        elif not isinstance(error, (KeyboardInterrupt, ExternalShutdownException)):
            traceback.print_exception(error)
            code = _EXIT_ERROR
    shutdown.call_on_signal(lambda: None)
    failed = 0
    try:
        if hasattr(node, 'close'):
            node.close()
    except Exception:
        traceback.print_exc()
        failed = _EXIT_ERROR
    code = failed or code or getattr(node, 'exit_code', 0)
    with shutdown.exit_after(_SHUTDOWN_S, code):
        _drop_incoming()
        while error is not None:  # free the objects that it and its causes refer to
            traceback.clear_frames(error.__traceback__)
            error.__traceback__ = None
            error = error.__cause__ or error.__context__
        gc.collect()
        if node:
            node.destroy_node()
        rclpy.try_shutdown()
    return code


def _drop_incoming():
    # other middlewares may wake their own threads with a packet
    if get_rmw_implementation_identifier().startswith(transport.FAST_DDS):
        shutdown.drop_incoming()


def _apply_scheduling(node):
    """Apply the parameters `realtime.*`; log what the system refuses."""
    realtime = node_parameters.REALTIME
    if not node.has_parameter(node_parameters.MODE) or ros.mode(node) != realtime:
        return
    names = parameters.flatten(scheduling.DEFAULTS)
    given = {name: node.get_parameter(f'{realtime}.{name}').value for name in names}
    for refusal in scheduling.apply(scheduling.SchedulingOptions(**given)):
        node.get_logger().warning(refusal)


def _spin_until_finished(node):
    executor = EventsExecutor()
    executor.add_node(node)
    node.spinning = Future(executor=executor)
    # in a thread: the signal may come while this one holds the lock of the future
    shutdown.call_on_signal(
        lambda: Thread(target=finish, args=(node, getattr(node, 'exit_code', 0))).start()
    )
    while rclpy.ok() and not getattr(node, 'finished', False):
        executor.spin_until_future_complete(node.spinning, timeout_sec=_WAKE_S)
    end = time.monotonic() + _FLUSH_S
    # reliable subscribers receive the last messages
    for pub in node.publishers if rclpy.ok() else ():
        pub.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
