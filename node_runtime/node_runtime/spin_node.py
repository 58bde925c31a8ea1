"""Runs a node from its command line to its exit code."""

import gc
import os
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
from rclpy.utilities import get_rmw_implementation_identifier

from msgs_yaml.strict_yaml import YamlError
from node_runtime import leaving, overrides, parameters, realtime, ros, signals
from node_runtime.parameters import ParameterError

# also because EventsExecutor without a time-out runs no callback in the wheels of Jazzy
_WAKE_S = 0.1  # longest time until a signal is noticed
_FLUSH_S = 5.0  # what was lost on its way is sent again with the next heartbeat, after 3 s
_LEAVE_S = 4.0  # as a rule it takes a tenth of a second
FAST_DDS = 'rmw_fastrtps'
EXIT_CONFIGURATION = os.EX_CONFIG
_EXIT_ERROR = 1


def finish(node: Node, exit_code: int = 0) -> None:
    """End the spinning of a node after this callback; its process exits with this code."""
    node.exit_code = exit_code
    node.finished = True
    if hasattr(node, 'spinning'):
        node.spinning.set_result(None)


def spin(make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """Make a node, run it until it finishes or is told to end, and return its exit code.

    SIGINT and SIGTERM end it after the callback under way, with the node's `exit_code`, 0 unless
    set. Wrong parameters or a broken contract are one line of the log and EXIT_CONFIGURATION; an
    error in a callback is shown and ends the node with 1. In the end `node.close()` is called, if
    there is one, which may take its time. Then the node is destroyed; if the middleware does not
    let it go the process ends after 4 s with the same exit code, and says where it was held.
    Discovery stays on this machine unless the environment says otherwise. To be called from the
    main thread, as the last thing that a process does: from then on both signals are ignored.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with signals.caught():
        return _spin(make_node, args)


def leave(*nodes: Node, context: Context | None = None) -> None:
    """Destroy nodes and shut down their context; this process hears nothing of others any more."""
    _hear_nothing()
    _destroy(nodes, context)


def _spin(make_node, args):
    node, code, error = None, 0, None
    try:
        _start(args)
        node = make_node()
        _be_punctual(node)
        _run(node)
    except BaseException as caught:
        _be_undisturbed()
        error = caught  # it holds a node that is half made, whose end needs a bound, too
        code = _told(error)
    _be_undisturbed()
    code = _close(node) or code or _exit_code(node)
    with leaving.within(_LEAVE_S, code):
        _hear_nothing()
        _forget(error)
        _destroy([node] if node else [], None)
    return code


def _be_undisturbed():
    """Let no signal interrupt the closing."""
    signals.ask_instead(lambda: None)


def _hear_nothing():
    # others may wake their own threads with a packet
    if get_rmw_implementation_identifier().startswith(FAST_DDS):
        leaving.deafen()


def _told(error):
    """Say what ended a node, if it is not the user; return the exit code for it."""
    if isinstance(error, (KeyboardInterrupt, ExternalShutdownException)):
        return 0
    if isinstance(error, (ParameterError, YamlError)):
        rclpy.logging.get_logger('start').fatal(str(error))
        return EXIT_CONFIGURATION
    traceback.print_exception(error)
    return _EXIT_ERROR


def _close(node):
    """Let a node complete what it has; return the exit code of that."""
    try:
        if hasattr(node, 'close'):
            node.close()
    except Exception:
        traceback.print_exc()
        return _EXIT_ERROR
    return 0


def _destroy(nodes, context):
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown(context=context)


def _forget(error):
    """Free what an exception and those before it hold."""
    while error is not None:
        traceback.clear_frames(error.__traceback__)
        error.__traceback__ = None
        error = error.__cause__ or error.__context__
    gc.collect()


def _exit_code(node):
    return getattr(node, 'exit_code', 0)


def _be_punctual(node):
    """Ask Linux for what the parameters `realtime.*` say; what it refuses is logged."""
    if not node.has_parameter(overrides.MODE) or ros.mode(node) != overrides.REALTIME:
        return
    names = parameters.flatten(realtime.DEFAULTS)
    given = {k: node.get_parameter(f'{overrides.REALTIME}.{k}').value for k in names}
    for refusal in realtime.apply(realtime.Options(**given)):
        node.get_logger().warning(refusal)


def _start(args):
    try:
        # rclpy's own handlers shut down in the middle of a callback
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # the base of what rcl refuses
        raise ParameterError(f'command line: {error}') from None


def _run(node):
    executor = EventsExecutor()
    executor.add_node(node)
    node.spinning = Future(executor=executor)
    # in a thread: the signal may come while this one holds the lock of the future
    signals.ask_instead(lambda: Thread(target=finish, args=(node, _exit_code(node))).start())
    while rclpy.ok() and not getattr(node, 'finished', False):
        executor.spin_until_future_complete(node.spinning, timeout_sec=_WAKE_S)
    if rclpy.ok():
        _flush(node)


def _flush(node):
    """Let reliable subscribers receive what was just published."""
    end = time.monotonic() + _FLUSH_S
    for pub in node.publishers:
        pub.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
