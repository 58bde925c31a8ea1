"""ROS node of the plant: commands in; state, sensors and the clock out."""

import sys
import time
from functools import partial

from rcl_interfaces.msg import ParameterDescriptor

from msgs_yaml import conversions, decode, encode
from msgs_yaml.decode import DecodeError
from msgs_yaml.types import Reference, StopPlan
from node_runtime import ros, spin_node, subscriptions_node
from node_runtime.log_filters import ChangeFilter, RejectionLog
from node_runtime.managed_node import ManagedNode
from node_runtime.parameters import START_SPEED, ParameterError
from node_runtime.subscriptions_node import PublisherMonitor
from stage_solver import compile_cache
from vehicle_plant import (
    health,
    initial_state,
    integrator,
    parameters,
    road_friction,
    sensors,
)
from vehicle_plant.frames_node import FramesPublisher
from vehicle_plant.gate import UNREADABLE
from vehicle_plant.modes_node import LockstepMode, RealtimeMode
from vehicle_plant.sensors import Sensors
from vehicle_plant.simulator import STEP_NS, Simulator, model_of
from vehicle_plant.state import messages

COMMAND, STOP_PLAN = '/controller/command', '/controller/stop_plan'
POLL_S = 0.1  # between two checks whether the run can start
THROTTLE_S = 1.0
HEALTH_NS = 1_000_000_000


class PlantNode(ManagedNode):
    """Publishes the motion of the car; its mode decides when the car advances."""

    def __init__(self):
        super().__init__(health.NODE)
        car, start = (self._declare_text(doc) for doc in parameters.EXTRAS.parameters)
        self.starts_at_reference = start == 'reference'
        self.params = ros.declare(self, parameters.NodeParams, parameters.car_file(car))

    def configure(self):
        """Load the files that the parameters name, compile the car if need be, join the graph."""
        self.plant = parameters.plant_params(self.params)
        patches = self.params.patches
        self.patches = road_friction.patch_array(patches.corners_m, patches.friction)
        try:
            # compiles, if need be, before time starts
            integrator.library(model_of(self.plant))
        except compile_cache.CompileError as error:
            raise ParameterError(str(error)) from None
        self.odometry_pub = ros.TemplatePublisher(self, '/vehicle/odometry')
        self.actuators_pub = ros.TemplatePublisher(self, '/vehicle/actuators')
        self.imu_pub = ros.TemplatePublisher(self, '/vehicle/imu')
        self.wheels_pub = ros.TemplatePublisher(self, '/vehicle/wheels')
        self.sensor_params, self.sensors = parameters.load_sensors(self.params), None
        topics = sensors.TOPICS if self.sensor_params else ()
        self.sensor_pubs = {topic: ros.TemplatePublisher(self, topic) for topic in topics}
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.frames = FramesPublisher(self, self.plant.car, self.params.publish_tf is not False)
        self.reference = None
        self.waiting_log = ChangeFilter()
        if self.starts_at_reference:
            ros.subscribe(self, '/scenario/reference', self.on_reference, raw=True)
        self.mode = {'lockstep': LockstepMode, 'realtime': RealtimeMode}[ros.mode(self)](self)
        self.command_sub = ros.subscribe(self, COMMAND, self.on_command)
        ros.subscribe(self, STOP_PLAN, self.on_stop_plan, raw=True)
        self.command_publishers = PublisherMonitor(self, {COMMAND: self.command_sub})
        self.rejections = RejectionLog(COMMAND)
        self.start_timer = ros.steady_timer(self, POLL_S, self.on_poll)

    def activate(self):
        """Begin a run, at the start, as soon as nothing is missing."""
        self.frames.announce()
        self.mode.reset()
        self.waiting_log = ChangeFilter()
        self.start_timer.reset()

    def deactivate(self):
        """Give up the run: nothing is published any more, and commands are ignored."""
        self.start_timer.cancel()
        self.mode.reset()

    def _declare_text(self, doc) -> str:
        """Declare a parameter as documented; return its value. Raises ParameterError."""
        descriptor = ParameterDescriptor(description=doc.meaning, read_only=True)
        value = self.declare_parameter(doc.name, doc.default, descriptor).value
        if doc.words and value not in doc.words:
            raise ParameterError(f'{doc.name} is {value!r}; allowed {doc.allowed}')
        return value

    def on_reference(self, raw):
        """Keep the path for the start."""
        if self.mode.stepper:  # repeats: there is a step to take every millisecond
            return
        try:
            self.reference = read_start_path(raw)
        except DecodeError as error:
            text = f'/scenario/reference rejected: {error}'
            self.get_logger().error(text, throttle_duration_sec=THROTTLE_S)

    def on_poll(self):
        """Begin once nothing is missing; log what is missing, once per change."""
        if not self.is_active:
            return
        missing = self.missing()
        if missing:
            text = f'waiting for {", ".join(missing)}'
            if self.waiting_log.has_changed(text):
                self.get_logger().info(text)
            self.mode.report_waiting(text)
            return
        self.start_timer.cancel()
        self.mode.begin()

    def missing(self) -> list[str]:
        """Return the topics, publishers and subscribers that the start waits for."""
        checks = (
            ('/scenario/reference', self.starts_at_reference and self.reference is None),
            (f'a publisher of {COMMAND}', not self.command_sub.get_publisher_count()),
        )
        missing = [what for what, is_missing in checks if is_missing]
        # a controller, or an estimator before it
        ways = [['/vehicle/odometry'], *([self.sensor_pubs] if self.sensor_pubs else ())]
        unheard = [ros.missing_subscriptions(self, dict.fromkeys(way, 1)) for way in ways]
        return missing + min(unheard, key=len)

    def simulator_at(self, stamp_ns: int) -> Simulator:
        """Return the car at its start at a stamp; its sensors begin there."""
        if self.starts_at_reference:
            start = initial_state.start_from_reference(self.reference)
        else:
            start = initial_state.start_from_parameters(self.params.start)
        faults = self.params.faults
        car = Simulator(self.plant, self.params.friction, start, stamp_ns, self.patches, faults)
        if self.sensor_params:
            seed = self.params.sensors_seed or 0
            self.sensors = Sensors(self.sensor_params, self.plant.car, seed, car.now)
        return car

    def on_command(self, msg):
        """Pass a command to the mode; log it when it violates the contract or fails the gate."""
        stamp_ns, command, kind, reason = conversions.stamp_to_ns(msg.header.stamp), None, '', ''
        try:
            command = decode.command(msg)
        except DecodeError as error:
            kind, reason = UNREADABLE, str(error)
        rejected = self.mode.stepper.car.gate.rejected if self.mode.stepper else 0
        self.mode.on_command(stamp_ns, command, reason)
        gate = self.mode.stepper.car.gate if self.mode.stepper else None
        if command and gate and gate.rejected > rejected:
            kind, reason = gate.last_code, gate.last_reason
        # the first rejected command of each kind, then counts
        line = kind and self.rejections.line(kind, reason, time.monotonic_ns())
        if line:
            self.get_logger().warning(line)

    def on_stop_plan(self, raw):
        """Keep the plan for a silent controller: it is read, and checked, only then."""
        if not self.mode.stepper:
            return
        try:
            self.mode.stepper.stop.keep(decode.stamp_ns_of(raw), partial(read_stop_plan, raw))
        except DecodeError as error:
            text = f'{STOP_PLAN} rejected: {error}'
            self.get_logger().error(text, throttle_duration_sec=THROTTLE_S)

    def publish(self, trajectory):
        """Publish every row of a trajectory; on each topic in the order of time."""
        self.publish_sensors(trajectory)  # first: an estimator works while the rest is published
        fast = trajectory.state_columns(), trajectory.actuator_columns()
        for state, actuators in zip(*map(messages, fast)):
            self.odometry_pub.publish(state)
            self.actuators_pub.publish(actuators)
        period_ns = self.params.imu_wheels_period_ms * STEP_NS
        slow = trajectory.where(trajectory.stamp_ns % period_ns == 0)
        for imu, wheels in zip(*map(messages, (slow.imu_columns(), slow.wheel_columns()))):
            self.imu_pub.publish(imu)
            self.wheels_pub.publish(wheels)
        self.frames.publish(trajectory)

    def publish_sensors(self, trajectory):
        """Publish what the sensors, if there are any, measure during a trajectory."""
        for topic, value in self.sensors.measure(trajectory) if self.sensors else ():
            self.sensor_pubs[topic].publish(value)

    def publish_health(self, stepper, monitor, trajectory):
        """Publish health once a second and at the end of the run; log how the run ended."""
        for stamp_ns in trajectory.stamp_ns[trajectory.stamp_ns % HEALTH_NS == 0].tolist():
            self.send_health(monitor.health(stamp_ns))
        if stepper.outcome:
            self.send_health(monitor.health(stepper.car.stamp_ns))
            self.get_logger().info(stepper.outcome.message)

    def send_health(self, status):
        """Publish a health, with warnings about other publishers of the command."""
        self.health_pub.publish(encode.health(self.command_publishers.add_warnings(status)))


def read_start_path(raw: bytes) -> Reference:
    """Return a serialised path; DecodeError, too, for one without a speed to start with."""
    path = subscriptions_node.read_reference(raw)
    if not path.t.any():
        raise DecodeError(
            'all poses have the same stamp, which says no speed to start with; allowed with '
            'start.from: parameters'
        )
    speed = initial_state.start_from_reference(path).speed
    if START_SPEED.fault(float, round(speed, 3)):  # stamps are rounded
        raise DecodeError(
            f'its first poses say a speed of {speed:g} m/s; allowed {START_SPEED.allowed}'
        )
    return path


def read_stop_plan(raw: bytes) -> StopPlan:
    """Return a serialised plan. Raises DecodeError."""
    return decode.stop_plan(ros.deserialize(STOP_PLAN, raw))


def main() -> int:
    """Run the node."""
    about = 'Simulate the car: publish its state, and obey the commands of a controller.'
    example = '--ros-args -p mode:=realtime -p friction:=0.9'
    return spin_node.run(PlantNode, about, example)


if __name__ == '__main__':
    sys.exit(main())
