"""Managed nodes: the standard life cycle of ROS 2 for a node of a run.

    unconfigured --configure--> inactive --activate--> active --deactivate--> inactive
    inactive --cleanup--> unconfigured          any of these --shutdown--> finalized

The transitions are requested with the service `~/change_state` (`ros2 lifecycle set NODE
TRANSITION`) and announced on `~/transition_event`. With the parameter `autostart`, which is true by
default, the node configures and activates itself when it starts, without a service call.
"""

import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from msgs_yaml.strict_yaml import YamlError, closest
from node_runtime import node_parameters
from node_runtime.parameters import ParameterError

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
REFUSALS = (ParameterError, YamlError)  # errors of the user, which need no traceback


class ManagedNode(LifecycleNode):
    """A node whose subclass says what the transitions do.

    The constructor of a subclass declares parameters, nothing else. What `configure` creates in the
    graph is destroyed by the clean-up. Publishers that `ros.publisher` returns publish while the
    node is active only; callbacks of subscriptions and timers check `is_active` themselves.
    """

    def __init__(self, name: str):
        super().__init__(name)
        self.is_active = False
        self._failure: Exception | None = None  # of the last transition
        self._is_starting = self._is_ending = False
        self._lasting = []  # what is in the graph before `configure`
        # rclpy lets the error of a transition that the state does not have end the node
        service = self._service_change_state
        service.callback = partial(self._refuse_impossible, service.callback)

    def configure(self) -> None:
        """Load files, prepare, and join the graph; ParameterError or YamlError for wrong input."""
        raise NotImplementedError

    def activate(self) -> None:
        """Begin, or go on after `deactivate`; publishers publish from now on."""

    def deactivate(self) -> None:
        """Pause; after it publishers publish nothing."""

    def clean_up(self) -> None:
        """Release what `configure` has opened or started outside of the graph, if it has."""

    def start(self) -> None:
        """Configure and activate the node if its parameter `autostart` is true.

        Raises the error that `configure` or `activate` raises.
        """
        if not self.get_parameter(node_parameters.AUTOSTART).value:
            name = self.get_fully_qualified_name()
            self.get_logger().info(f'unconfigured; `ros2 lifecycle set {name} configure`')
            return
        self._is_starting = True  # who raises an error does not log it
        for trigger in (self.trigger_configure, self.trigger_activate):
            trigger()
            if self._failure:
                raise self._failure
        self._is_starting = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; after a failure the node is unconfigured, and the log has the reason."""
        self._lasting = [entity for kind in self._entities() for entity in kind]
        result = self._attempt('configure', self.configure)
        if result != SUCCESS:
            self._release()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; after a failure the node is inactive, and the log has the reason."""
        super().on_activate(state)  # publishers: `activate` may publish
        self.is_active = True
        result = self._attempt('activate', self.activate, 'active')
        if result != SUCCESS:
            self._pause(state)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate: a node that falls silent, or is silent no longer, says so in the log."""
        text = 'inactive: it publishes nothing until it is activated'
        result = self._attempt('deactivate', self.deactivate, text)
        self._pause(state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up."""
        return self._attempt('cleanup', self._release, 'unconfigured: it has left the graph')

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause and clean up; only the end of the process follows."""
        self._is_ending = True
        if self.is_active:
            self.on_deactivate(state)
        return self._attempt('shutdown', self._release)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up after an error that a transition did not expect: unconfigured, not finalized."""
        self._pause(state)
        failure = self._failure
        result = self._attempt('cleanup', self._release)
        self._failure = failure
        return result

    def check_change(self, changes: dict[str, Any]) -> None:
        """Raise ParameterError for values by name that parameters of the node may not take.

        They are parameters that the node has declared as changeable; see `ros.declare`.
        """

    def apply_change(self, changes: dict[str, Any]) -> None:
        """Use the values that `check_change` was called with last, which are set now."""

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters, or none and say why."""
        changes = {
            parameter.name: parameter.value
            for parameter in parameter_list
            if not parameter.name.startswith(node_parameters.OF_ROS)
        }
        try:
            for name in changes:
                if not self.has_parameter(name):
                    hint = closest(name, self.list_parameters([], 0).names)
                    raise ParameterError(f'{name}: this node has no such parameter{hint}')
                if self.describe_parameter(name).read_only:
                    raise ParameterError(node_parameters.READ_ONLY.format(name))
            if changes:
                self.check_change(changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = super().set_parameters_atomically(parameter_list)
        if result.successful and changes:
            self.apply_change(changes)
        return result

    def _attempt(
        self, transition: str, change: Callable[[], None], then: str = ''
    ) -> TransitionCallbackReturn:
        """Make a change; log why it fails, or what is `then` if it was requested.

        At start and end no change is announced.
        """
        self._failure, reason, result = None, '', SUCCESS
        try:
            change()
        except REFUSALS as error:
            self._failure, reason, result = error, str(error), FAILURE
        except Exception as error:
            reason = traceback.format_exc().rstrip()
            self._failure, result = error, TransitionCallbackReturn.ERROR
        if self._failure and not self._is_starting:
            self.get_logger().error(f'{transition} failed: {reason}')
        elif then and not self._failure and not self._is_starting and not self._is_ending:
            self.get_logger().warning(then)
        return result

    def _pause(self, state):
        self.is_active = False
        super().on_deactivate(state)

    def _release(self):
        """Undo `configure`: leave the graph, then release the rest."""
        kept = set(map(id, self._lasting))
        destroyers = (
            self.destroy_timer,
            self.destroy_subscription,
            self.destroy_lifecycle_publisher,
        )
        for entities, destroy in zip(self._entities(), destroyers):
            for entity in [entity for entity in entities if id(entity) not in kept]:
                destroy(entity)
        self.clean_up()

    def _entities(self):
        return self.timers, self.subscriptions, self.publishers

    def _refuse_impossible(self, change_state, request, response):
        try:
            return change_state(request, response)
        except RuntimeError as error:  # the base of what rcl raises
            asked = request.transition.label or request.transition.id
            self.get_logger().error(f'transition {asked} is not possible: {error}')
            response.success = False
            return response
