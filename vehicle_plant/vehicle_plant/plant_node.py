"""The plant on ROS 2: commands in; odometry, actuators, imu, wheels and the clock out."""

import sys
import time
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msgs_yaml import conversions, decode, encode
from msgs_yaml.decode import DecodeError
from node_runtime import ros, spin_node, subscriptions_node
from node_runtime.log_filters import ChangeFilter, RejectionLog
from node_runtime.parameters import ParameterError
from node_runtime.subscriptions_node import PublisherMonitor
from vehicle_plant import health, initial_state, integrator, parameters, road_friction
from vehicle_plant.gate import UNREADABLE
from vehicle_plant.modes_node import LockstepMode, RealtimeMode
from vehicle_plant.simulator import STEP_NS, Simulator

COMMAND = '/controller/command'
LOOK_S = 0.1  # how often the start is tried
THROTTLE_S = 1.0
HEALTH_NS = 1_000_000_000


class PlantNode(Node):
    """Publishes what the car does, in both modes; `drive` decides when it does it."""

    def __init__(self):
        super().__init__(health.NODE)
        self.wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.at_reference = self._declare_start()
        self.params = ros.declare(self, parameters.NodeParams, self._declare_car())
        self.plant = parameters.plant_params(self.params)
        self.patches = road_friction.patches_from_parameters(self.params.patches)
        integrator.library()  # compiles, if need be, before time starts
        self.odometry_pub = ros.TemplatePublisher(self, '/vehicle/odometry')
        self.actuators_pub = ros.TemplatePublisher(self, '/vehicle/actuators')
        self.imu_pub = ros.TemplatePublisher(self, '/vehicle/imu')
        self.wheels_pub = ros.TemplatePublisher(self, '/vehicle/wheels')
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.reference = None
        self.waited = ChangeFilter()
        if self.at_reference:
            ros.subscribe(self, '/scenario/reference', self.on_reference, raw=True)
        self.drive = {'lockstep': LockstepMode, 'realtime': RealtimeMode}[ros.mode(self)](self)
        self.command_sub = ros.subscribe(self, COMMAND, self.on_command)
        self.command_publishers = PublisherMonitor(self, {COMMAND: self.command_sub})
        self.refusals = RejectionLog(COMMAND)
        self.starting = self.every(LOOK_S, self.on_look)

    def _declare_start(self) -> bool:
        choices = parameters.START_FROM.words
        about = ParameterDescriptor(description=' or '.join(choices), read_only=True)
        chosen = self.declare_parameter('start.from', choices[0], about).value
        if chosen not in choices:
            raise ParameterError(f'start.from is {chosen!r}; allowed {" or ".join(choices)}')
        return chosen == 'reference'

    def _declare_car(self) -> Path:
        about = ParameterDescriptor(
            description='file of the car: in config/, or a path', read_only=True
        )
        name = self.declare_parameter('plant_params', parameters.DEFAULT_CAR, about).value
        return parameters.car_file(name)

    def every(self, seconds, callback):
        """Return a timer on the wall clock."""
        return self.create_timer(seconds, callback, clock=self.wall)

    def on_reference(self, raw):
        """Keep the path for the start."""
        if self.drive.ring:  # repeats: there is a step to take every millisecond
            return
        try:
            self.reference = subscriptions_node.read_reference(raw)
        except DecodeError as error:
            told = f'/scenario/reference turned down: {error}'
            self.get_logger().error(told, throttle_duration_sec=THROTTLE_S)

    def on_look(self):
        """Start once all are there; say who is missing, once per change."""
        missing = self.missing()
        if missing:
            text = f'waiting for {", ".join(missing)}'
            if self.waited.has_changed(text):
                self.get_logger().info(text)
            self.drive.wait(text)
            return
        self.starting.cancel()
        self.drive.begin()

    def missing(self) -> list[str]:
        """Return what the start still waits for."""
        checks = (
            ('/scenario/reference', self.at_reference and self.reference is None),
            (f'a publisher of {COMMAND}', not self.command_sub.get_publisher_count()),
        )
        missing = [what for what, is_missing in checks if is_missing]
        return missing + ros.missing_subscriptions(self, {'/vehicle/odometry': 1})

    def car_at(self, stamp_ns: int) -> Simulator:
        """Return the car at its start at this time."""
        at_path = initial_state.start_from_reference(self.reference) if self.at_reference else None
        start = at_path or initial_state.start_from_parameters(self.params.start)
        return Simulator(self.plant, self.params.friction, start, stamp_ns, self.patches)

    def on_command(self, msg):
        """Hand a command to the drive; one that breaks the contract counts as refused."""
        try:
            command = decode.command(msg)
        except DecodeError as error:
            self.drive.unreadable(conversions.stamp_to_ns(msg.header.stamp), str(error))
            self.say_refused(UNREADABLE, str(error))
        else:
            refused = self.drive.ring.car.gate.rejected if self.drive.ring else 0
            self.drive.command(command)
            gate = self.drive.ring.car.gate if self.drive.ring else None
            if gate and gate.rejected > refused:
                self.say_refused(gate.last_code, gate.last_reason)

    def say_refused(self, kind, reason):
        """Log the first refused command of each kind, then counts."""
        line = self.refusals.line(kind, reason, time.monotonic_ns())
        if line:
            self.get_logger().warning(line)

    def send(self, track):
        """Publish every row of a track; on each topic in the order of time."""
        for state, actuators in zip(track.states(), track.actuators()):
            self.odometry_pub.publish(state)
            self.actuators_pub.publish(actuators)
        slow = track.where(track.stamp_ns % (self.params.imu_wheels_period_ms * STEP_NS) == 0)
        for imu, wheels in zip(slow.imu(), slow.wheels()):
            self.imu_pub.publish(imu)
            self.wheels_pub.publish(wheels)

    def follow_up(self, ring, monitor, track):
        """Report health once a second, and how the run ended when it is over."""
        for stamp_ns in track.stamp_ns[track.stamp_ns % HEALTH_NS == 0].tolist():
            self.tell(monitor.health(stamp_ns))
        if ring.outcome:
            self.tell(monitor.health(ring.car.stamp_ns))
            self.get_logger().info(ring.outcome.message)

    def tell(self, found):
        """Publish a health."""
        self.health_pub.publish(encode.health(self.command_publishers.add_warnings(found)))


def main() -> int:
    """Run the node."""
    return spin_node.spin(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
