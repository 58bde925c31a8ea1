"""The plant on ROS 2: commands in; odometry, actuators, imu, wheels and the clock out."""

import sys
from pathlib import Path

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msgs_yaml import decode, encode, ros, stamp
from msgs_yaml.checked import DecodeError
from msgs_yaml.parameters import ParameterError
from vehicle_plant import health, parameters, road, starts, stepper
from vehicle_plant.ring import Lockstep, Realtime
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, Simulator

LOOK_S = 0.1  # how often the start is tried
REPEAT_S = 1.0  # the first state, until somebody answers it
FROZEN_S = 0.05  # the same in realtime
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
        self.reference = decode.reference(msg)

    def on_look(self):
        """Start once all are there; say who is missing."""
        missing = self.missing()
        if missing:
            text = f'waiting for {", ".join(missing)}'
            self.get_logger().info(text, throttle_duration_sec=REPEAT_S)
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

    def follow_up(self, ring, track):
        """Report health once a second, and end the run when it is over."""
        for stamp_ns in track.stamp_ns[track.stamp_ns % HEALTH_NS == 0].tolist():
            self.health_pub.publish(encode.health(health.health(ring, stamp_ns)))
        if ring.outcome:
            self.health_pub.publish(encode.health(health.health(ring, ring.car.stamp_ns)))
            self.get_logger().info(ring.outcome.message)
            ros.finish(self, ring.outcome.exit_code)


class LockstepDrive:
    """The plant owns time: a tick per command."""

    def __init__(self, node: PlantNode):
        self.node = node
        self.clock_pub = ros.publisher(node, '/clock')
        self.ring = None
        self.repeating = None
        self.watch = None  # for a controller that is gone

    def begin(self):
        """Publish the first state until somebody answers it."""
        car = self.node.car_at(START_NS)
        self.ring = Lockstep(car, RunEnd(self.node.params.stop, car.now))
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
        self.node.follow_up(self.ring, track)

    def keep_watch(self):
        """Wait for the next command anew."""
        if self.watch:
            self.watch.reset()
            return
        self.repeating.cancel()
        self.watch = self.node.every(self.node.params.lockstep_timeout_s, self.on_silence)

    def on_silence(self):
        """Go on without the controller."""
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
        self.ring = None
        self.timer = None
        # steady, so that a correction of the system's clock is no jump of the car
        self.offset_ns = node.get_clock().now().nanoseconds - node.wall.now().nanoseconds

    def now_ns(self) -> int:
        """Return the present wall time, whole steps."""
        return (self.node.wall.now().nanoseconds + self.offset_ns) // STEP_NS * STEP_NS

    def begin(self):
        """Hold the car at its start until the first command comes."""
        self.timer = self.node.every(FROZEN_S, self.on_frozen)

    def on_frozen(self):
        """Publish the state at the start with the present time."""
        self.node.send(self.node.car_at(self.now_ns()).now)

    def command(self, command):
        """Follow a command; the first one lets the car go."""
        if self.ring:
            self.ring.command(command)
        elif self.timer:
            now_ns = self.now_ns()
            car = self.node.car_at(now_ns)
            self.ring = Realtime(car, RunEnd(self.node.params.stop, car.now))
            self.ring.command(command._replace(stamp_ns=now_ns))
            self.node.destroy_timer(self.timer)
            self.timer = self.node.every(STEP_NS / 1e9, self.on_step)

    def unreadable(self, _, reason):
        """Count a command that breaks the contract; the last good one stands."""
        if self.ring:
            self.ring.car.gate.refuse(reason)

    def on_step(self):
        """Advance by what is due."""
        track = self.ring.advance_to(self.now_ns()) if not self.ring.outcome else None
        if track:
            self.node.send(track)
            self.node.follow_up(self.ring, track)


def main() -> int:
    """Run the node."""
    return ros.spin(PlantNode)


if __name__ == '__main__':
    sys.exit(main())
