"""How the plant node keeps simulated time: a tick per command.

How the plant node keeps wall time: a step per millisecond.
"""

from rclpy.node import Node

from msgs_yaml import encode
from node_runtime import ros, scheduling, spin_node
from node_runtime.clocks import SteadyClock
from vehicle_plant import health
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_STEPS
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper, StartHold

REPEAT_S = 1.0  # the first state, until somebody answers it
ALONE_S = 0.001  # between ticks without a controller


class LockstepMode:
    """The plant owns time: a tick per command."""

    def __init__(self, node: Node):
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
        self.ring = LockstepStepper(car, RunEnd(self.node.params.stop, car.now))
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
        if self.ring.outcome:
            spin_node.finish(self.node, self.ring.outcome.exit_code)

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


HELD_S = 0.02  # between two states of the car that is held at its start
LEAVE_S = 0.02  # between the last state and the end
TOLD_NS = 1_000_000_000  # between two words on what is waited for
THROTTLE_S = 1.0


class RealtimeMode:
    """The plant follows the wall clock: a step per millisecond."""

    def __init__(self, node: Node):
        self.node = node
        self.ring = self.monitor = None
        self.timer = None
        self.hold = StartHold()
        # so that a correction of the system's clock is no jump of the car
        self.wall = SteadyClock()
        self.told_ns = 0

    def now_ns(self) -> int:
        """Return the present wall time, whole steps."""
        return self.wall.now_ns() // STEP_NS * STEP_NS

    def wait(self, told):
        """Tell once a second what is waited for."""
        now_ns = self.now_ns()
        if now_ns - self.told_ns >= TOLD_NS:
            self.told_ns = now_ns
            self.node.tell(health.waiting(now_ns, told))

    def begin(self):
        """Hold the car at its start until the first command comes."""
        # the first steps of all are slow: code and data have to be brought into memory
        self.node.car_at(self.now_ns()).advance(None, TICK_STEPS)
        scheduling.freeze_garbage()
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
        ring = RealtimeStepper(car, RunEnd(params.stop, car.now), params.command_age_s)
        ring.command(command._replace(stamp_ns=now_ns))
        if car.gate.rejected:
            told = f'held at the start: {car.gate.last_reason}'
            self.node.get_logger().error(told, throttle_duration_sec=THROTTLE_S)
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
        if self.ring.outcome:  # a call that was on its way
            return
        track = self.ring.advance_to(self.now_ns())
        if track:
            self.node.send(track)
            self.node.follow_up(self.ring, self.monitor, track)
        if self.ring.outcome:
            self.end()

    def end(self):
        """Leave without a vehicle: a controller that still had one would brake it."""
        self.node.destroy_timer(self.timer)
        self.node.destroy_publisher(self.node.odometry_pub.publisher)
        # the executor has to let go of the publisher first, which it does while it spins
        self.timer = self.node.every(LEAVE_S, self.leave)

    def leave(self):
        """End the node."""
        spin_node.finish(self.node, self.ring.outcome.exit_code)
