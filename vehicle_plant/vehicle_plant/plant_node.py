"""The plant on ROS 2: commands in; odometry, actuators, imu, wheels and the clock out."""

import sys
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msgs_yaml import decode, encode, realtime, ros, stamp
from msgs_yaml.checked import DecodeError
from msgs_yaml.parameters import ParameterError
from msgs_yaml.wall import Spoken, Wall
from vehicle_plant import health, parameters, road, starts, stepper
from vehicle_plant.ring import Hold, Lockstep, Realtime
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_STEPS, Simulator

LOOK_S = 0.1  # how often the start is tried
REPEAT_S = 1.0  # the first state, until somebody answers it
HELD_S = 0.02  # the same in realtime
ALONE_S = 0.001  # between ticks without a controller
HEALTH_NS = 1_000_000_000


class PlantNode(Node):
    """Publishes what the car does, in both modes; `drive` decides when it does it."""

    def __init__(self):
        super().__init__(health.NODE)
        self.wall = Clock(clock_type=ClockType.STEADY_TIME)
        self.at_reference = self._declare_start()
        self.params = ros.declare(self, parameters.NodeParams, self._declare_car())
        self.plant = parameters.plant(self.params)
        self.patches = road.of(self.params.patches)
        stepper.library()  # compiles, if need be, before time starts
        self.odometry_pub = ros.fast_publisher(self, '/vehicle/odometry')
        self.actuators_pub = ros.fast_publisher(self, '/vehicle/actuators')
        self.imu_pub = ros.fast_publisher(self, '/vehicle/imu')
        self.wheels_pub = ros.fast_publisher(self, '/vehicle/wheels')
        self.health_pub = ros.publisher(self, '/diagnostics')
        self.reference = None
        self.waited = Spoken()
        if self.at_reference:
            ros.subscribe(self, '/scenario/reference', self.on_reference)
        self.drive = {'lockstep': LockstepDrive, 'realtime': RealtimeDrive}[ros.mode(self)](self)
        self.command_sub = ros.subscribe(self, '/controller/command', self.on_command)
        self.starting = self.every(LOOK_S, self.on_look)

    def _declare_start(self) -> bool:
        choices = ('reference', 'parameters')
        about = ParameterDescriptor(description=' or '.join(choices), read_only=True)
        chosen = self.declare_parameter('start.from', 'reference', about).value
        if chosen not in choices:
            raise ParameterError(f'start.from is {chosen!r}; allowed {" or ".join(choices)}')
        return chosen == 'reference'

    def _declare_car(self) -> Path:
        about = ParameterDescriptor(
            description='file of the car: in config/, or a path', read_only=True
        )
        name = self.declare_parameter('plant_params', parameters.DEFAULT_CAR, about).value
        return parameters.config(name)

    def every(self, seconds, callback):
        """Return a timer on the wall clock."""
        return self.create_timer(seconds, callback, clock=self.wall)

    def on_reference(self, msg):
        """Keep the path for the start."""
        try:
            self.reference = decode.reference(msg)
        except DecodeError as error:
            told = f'/scenario/reference turned down: {error}'
            self.get_logger().error(told, throttle_duration_sec=REPEAT_S)

    def on_look(self):
        """Start once all are there; say who is missing, once per change."""
        missing = self.missing()
        if missing:
            text = f'waiting for {", ".join(missing)}'
            if self.waited.is_news(text):
                self.get_logger().info(text)
            self.drive.wait(text)
            return
        self.starting.cancel()
        self.drive.begin()

    def missing(self) -> list[str]:
        """Return what the start still waits for."""
        checks = (
            ('/scenario/reference', self.at_reference and self.reference is None),
            ('a publisher of /controller/command', not self.command_sub.get_publisher_count()),
        )
        missing = [what for what, is_missing in checks if is_missing]
        return missing + ros.unheard(self, {'/vehicle/odometry': 1})

    def car_at(self, stamp_ns: int) -> Simulator:
        """Return the car at its start at this time."""
        at_path = starts.from_reference(self.reference) if self.at_reference else None
        start = at_path or starts.from_parameters(self.params.start)
        return Simulator(self.plant, self.params.friction, start, stamp_ns, self.patches)

    def on_command(self, msg):
        """Hand a command to the drive; one that breaks the contract counts as refused."""
        try:
            command = decode.command(msg)
        except DecodeError as error:
            self.drive.unreadable(stamp.to_ns(msg.header.stamp), str(error))
        else:
            self.drive.command(command)

    def send(self, track):
        """Publish every row of a track."""
        for row, stamp_ns in enumerate(track.stamp_ns.tolist()):
            self.odometry_pub.publish(track.state(row))
            self.actuators_pub.publish(track.actuators(row))
            if stamp_ns % (self.params.imu_wheels_period_ms * STEP_NS) == 0:
                self.imu_pub.publish(track.imu(row))
                self.wheels_pub.publish(track.wheels(row))

    def follow_up(self, ring, monitor, track):
        """Report health once a second, and end the run when it is over."""
        for stamp_ns in track.stamp_ns[track.stamp_ns % HEALTH_NS == 0].tolist():
            self.tell(monitor.health(stamp_ns))
        if ring.outcome:
            self.tell(monitor.health(ring.car.stamp_ns))
            self.get_logger().info(ring.outcome.message)
            ros.finish(self, ring.outcome.exit_code)

    def tell(self, found):
        """Publish a health."""
        self.health_pub.publish(encode.health(found))


class LockstepDrive:
    """The plant owns time: a tick per command."""

    def __init__(self, node: PlantNode):
        self.node = node
        self.clock_pub = ros.publisher(node, '/clock')
        self.ring = self.monitor = None
        self.repeating = None
        self.watch = None  # for a controller that is gone
        self.asked_again = False

    def wait(self, told):
        """Tell nobody else: simulated time has not begun."""

    def begin(self):
        """Publish the first state until somebody answers it."""
        car = self.node.car_at(START_NS)
        self.ring = Lockstep(car, RunEnd(self.node.params.stop, car.now))
        self.monitor = health.Monitor(self.ring)
        self.repeat()
        self.repeating = self.node.every(REPEAT_S, self.repeat)

    def repeat(self):
        """Publish the present state."""
        self.node.send(self.ring.car.now)
        self.clock_pub.publish(encode.clock(self.ring.car.stamp_ns))

    def command(self, command):
        """Advance a tick if this is the command for the present instant."""
        if self.ring and self.ring.answers(command.stamp_ns):
            self.tick(self.ring.tick(command))
            self.keep_watch()

    def unreadable(self, stamp_ns, reason):
        """Advance a tick under the last good command."""
        if self.ring and self.ring.answers(stamp_ns):
            self.ring.car.gate.refuse(reason)
            self.tick(self.ring.tick(None))
            self.keep_watch()

    def tick(self, track):
        """Publish a burst and the boundary that it ends at."""
        self.node.send(track)
        self.clock_pub.publish(encode.clock(self.ring.car.stamp_ns))
        self.node.follow_up(self.ring, self.monitor, track)

    def keep_watch(self):
        """Wait for the next command anew."""
        self.asked_again = False
        if self.watch:
            self.watch.reset()
            return
        self.repeating.cancel()
        self.watch = self.node.every(self.node.params.lockstep_timeout_s / 2, self.on_silence)

    def on_silence(self):
        """Ask again: a node that was started again has not heard it; then go on alone."""
        if not self.asked_again:
            self.asked_again = True
            self.node.get_logger().warning('no command comes: sending the present state again')
            self.repeat()
            return
        self.node.get_logger().error('no command comes: braking straight')
        self.watch.cancel()
        self.watch = self.node.every(ALONE_S, self.on_alone)

    def on_alone(self):
        """Advance a tick without a command."""
        if self.ring.outcome is None:
            self.tick(self.ring.tick_alone())


class RealtimeDrive:
    """The plant follows the wall clock: a step per millisecond."""

    def __init__(self, node: PlantNode):
        self.node = node
        self.ring = self.monitor = None
        self.timer = None
        self.hold = Hold()
        # so that a correction of the system's clock is no jump of the car
        self.wall = Wall()
        self.told_ns = 0

    def now_ns(self) -> int:
        """Return the present wall time, whole steps."""
        return self.wall.now_ns() // STEP_NS * STEP_NS

    def wait(self, told):
        """Tell once a second what is waited for."""
        now_ns = self.now_ns()
        if now_ns - self.told_ns >= HEALTH_NS:
            self.told_ns = now_ns
            self.node.tell(health.waiting(now_ns, told))

    def begin(self):
        """Hold the car at its start until the first command comes."""
        # the first steps of all are slow: code and data have to be brought into memory
        self.node.car_at(self.now_ns()).advance(None, TICK_STEPS)
        realtime.settle()
        self.node.get_logger().info('holding the car at its start until a command answers it')
        self.timer = self.node.every(HELD_S, self.on_held)

    def on_held(self):
        """Publish the state at the start with the present time."""
        now_ns = self.now_ns()
        self.hold.sent(now_ns)
        self.node.send(self.node.car_at(now_ns).now)
        self.wait('waiting for a command that answers the start')

    def command(self, command):
        """Follow a command; the first one that answers the start and passes lets the car go."""
        if self.ring:
            self.ring.command(command)
        elif self.hold.is_answer(command):
            self.let_go(command)

    def let_go(self, command):
        """Begin the run under its first command."""
        now_ns, params = self.now_ns(), self.node.params
        car = self.node.car_at(now_ns)
        ring = Realtime(car, RunEnd(params.stop, car.now), params.command_age_s)
        ring.command(command._replace(stamp_ns=now_ns))
        if car.gate.rejected:
            told = f'held at the start: {car.gate.last_reason}'
            self.node.get_logger().error(told, throttle_duration_sec=REPEAT_S)
            return
        self.ring, self.monitor = ring, health.Monitor(ring)
        self.node.tell(self.monitor.health(now_ns))
        self.node.destroy_timer(self.timer)
        self.timer = self.node.every(STEP_NS / 1e9, self.on_step)

    def unreadable(self, _, reason):
        """Count a command that breaks the contract; the last good one stands."""
        if self.ring:
            self.ring.refuse(reason)

    def on_step(self):
        """Advance by what is due."""
        track = self.ring.advance_to(self.now_ns()) if not self.ring.outcome else None
        if track:
            self.node.send(track)
            self.node.follow_up(self.ring, self.monitor, track)
            if self.ring.outcome:
                # the last messages are on their way for a second: nobody is to brake meanwhile
                self.node.destroy_publisher(self.node.odometry_pub.publisher)


def main() -> int:
    """Run the node."""
    return ros.spin(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
