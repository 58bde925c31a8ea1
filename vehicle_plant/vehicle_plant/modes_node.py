"""Both modes of the plant node: lockstep, a tick per command; realtime, a step per millisecond."""

from collections import deque

from msgs_yaml import contract, encode
from node_runtime import ros, scheduling, spin_node
from node_runtime.clocks import SteadyClock
from node_runtime.log_filters import ChangeFilter
from node_runtime.managed_node import ManagedNode
from vehicle_plant import health
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import START_NS, STEP_NS, TICK_STEPS
from vehicle_plant.stepping import LockstepStepper, RealtimeStepper

RUN_START = '/vehicle/run_start'
REPEAT_S = 1.0  # between two publications of the first state, until a command answers it
NO_CONTROLLER_S = 0.001  # between ticks without a controller
HOLD_S = 0.02  # between two states of the car that is held at its start until one is answered
ANSWERABLE_STATES = 100  # the last of them: 2 s
SHUTDOWN_S = 0.02  # between the last state and the end
WAITING_NS = 1_000_000_000  # between two messages about what is missing
THROTTLE_S = 1.0


class LockstepMode:
    """The plant owns time: a tick per command."""

    def __init__(self, node: ManagedNode):
        self.node = node
        self.clock_pub = ros.publisher(node, '/clock')
        self.repeat_timer = self.silence_timer = None
        self.reset()

    def reset(self):
        """Give up the run, if there is one."""
        for timer in (self.repeat_timer, self.silence_timer):
            if timer:
                self.node.destroy_timer(timer)
        self.stepper = self.monitor = None
        self.repeat_timer = self.silence_timer = None
        self.has_repeated, self.silence_log = False, ChangeFilter()

    def report_waiting(self, message):
        """Publish nothing: simulated time has not begun."""

    def begin(self):
        """Publish the first state until a command answers it."""
        car = self.node.simulator_at(START_NS)
        self.stepper = LockstepStepper(car, RunEnd(self.node.params.stop, car.now))
        self.monitor = health.HealthMonitor(self.stepper)
        self.publish_state()
        self.repeat_timer = ros.steady_timer(self.node, REPEAT_S, self.publish_state)

    def publish_state(self, trajectory=None):
        """Publish the rows of a tick, or the present state, and the present instant."""
        car = self.stepper.car
        self.node.publish(car.now if trajectory is None else trajectory)
        self.clock_pub.publish(encode.clock(car.stamp_ns))

    def on_command(self, stamp_ns, command, reason):
        """Advance a tick if this answers the present instant; end once the last one is answered.

        An unreadable command is None: the last valid one stands, for this reason.
        """
        if self.stepper and self.stepper.is_due(stamp_ns):
            if command is None:
                self.stepper.car.gate.reject(reason)
            self.publish_tick(self.stepper.tick(command))
            self.restart_silence_timer()
        elif self.stepper and stamp_ns == self.stepper.car.stamp_ns:
            self.finish()

    def publish_tick(self, trajectory):
        """Publish a tick, and the health when it is due."""
        self.publish_state(trajectory)
        self.node.publish_health(self.stepper, self.monitor, trajectory)
        if self.stepper.controller_gone:
            self.finish()

    def finish(self):
        """End the node if its run has ended.

        The last state is answered, too, before nodes are stopped: so the same run always has the
        same messages.
        """
        if self.stepper.outcome:
            spin_node.finish(self.node, self.stepper.outcome.exit_code)

    def restart_silence_timer(self):
        """Wait for the next command."""
        self.has_repeated = False
        if self.silence_timer:
            self.silence_timer.reset()
            return
        self.repeat_timer.cancel()
        timeout_s = self.node.params.lockstep_timeout_s / 2
        self.silence_timer = ros.steady_timer(self.node, timeout_s, self.on_silence)

    def on_silence(self):
        """Repeat the state once, for a controller that was restarted; then go on without it."""
        if not self.stepper:  # a call that was already queued; so below
            return
        if self.stepper.outcome:
            self.finish()
            return
        if not self.has_repeated:
            self.has_repeated = True
            self.node.get_logger().warning('no command comes: sending the present state again')
            self.publish_state()
            return
        self.silence_timer.cancel()
        self.silence_timer = ros.steady_timer(self.node, NO_CONTROLLER_S, self.on_no_controller)

    def on_no_controller(self):
        """Advance a tick without a command."""
        if self.stepper and self.stepper.outcome is None:
            trajectory = self.stepper.tick_without_controller()
            if self.silence_log.has_changed(self.stepper.stop.message):
                self.node.get_logger().error(self.stepper.stop.message)
            self.publish_tick(trajectory)


class RealtimeMode:
    """The plant follows the wall clock: a step per millisecond."""

    def __init__(self, node: ManagedNode):
        self.node = node
        self.timer = None
        self.reset()
        # a correction of the system's clock must not make the car jump
        self.wall = SteadyClock()
        self.reported_ns = 0
        self.run_start_pub = ros.publisher(node, RUN_START)
        period_s = 1.0 / contract.load().topics[RUN_START].rate_hz[ros.mode(node)]
        ros.steady_timer(node, period_s, self.publish_run_start)

    def publish_run_start(self):
        """Publish when the run began, 0 before: a scenario that starts later hears it, too."""
        self.run_start_pub.publish(encode.run_start(self.stepper.start_ns if self.stepper else 0))

    def reset(self):
        """Give up the run, if there is one."""
        if self.timer:
            self.node.destroy_timer(self.timer)
        self.stepper = self.monitor = self.timer = None
        self.held_ns, self.silence_log = deque(maxlen=ANSWERABLE_STATES), ChangeFilter()

    def now_ns(self) -> int:
        """Return the present wall time, whole steps."""
        return self.wall.now_ns() // STEP_NS * STEP_NS

    def report_waiting(self, message):
        """Publish once a second what is missing."""
        now_ns = self.now_ns()
        if now_ns - self.reported_ns >= WAITING_NS:
            self.reported_ns = now_ns
            self.node.send_health(health.waiting(now_ns, message))

    def begin(self):
        """Hold the car at its start until the first command comes."""
        # the first steps of all are slow: code and data are loaded
        self.node.simulator_at(self.now_ns()).advance(None, TICK_STEPS)
        scheduling.freeze_garbage()
        self.node.get_logger().info('holding the car at its start until a command answers it')
        self.publish_run_start()  # an estimator knows it before the first messages of the sensors
        self.timer = ros.steady_timer(self.node, HOLD_S, self.on_hold)

    def on_hold(self):
        """Publish the state at the start with the present time."""
        if self.stepper or not self.node.is_active:  # a call that was already queued
            return
        now_ns = self.now_ns()
        self.held_ns.append(now_ns)
        self.node.publish(self.node.simulator_at(now_ns).now)
        self.report_waiting('waiting for a command that answers the start')

    def on_command(self, _, command, reason):
        """Follow a command; the first accepted answer to the start begins the run.

        An unreadable command is None: it is counted with its reason, the last valid one stands.
        """
        if self.stepper and command is None:
            self.stepper.reject(reason)
        elif self.stepper:
            self.stepper.command(command)
        elif command and self.timer and command.stamp_ns in self.held_ns:
            self.start_run(command)

    def start_run(self, command):
        """Begin the run under its first command."""
        now_ns, params = self.now_ns(), self.node.params
        car = self.node.simulator_at(now_ns)
        stepper = RealtimeStepper(car, RunEnd(params.stop, car.now), params.command_age_s)
        stepper.start(command)
        if car.gate.rejected:
            message = f'held at the start: {car.gate.last_reason}'
            self.node.get_logger().error(message, throttle_duration_sec=THROTTLE_S)
            return
        self.stepper, self.monitor = stepper, health.HealthMonitor(stepper)
        self.publish_run_start()
        self.node.publish_sensors(car.now)  # an estimator begins anew
        self.node.send_health(self.monitor.health(now_ns))
        self.node.destroy_timer(self.timer)
        self.timer = ros.steady_timer(self.node, STEP_NS / 1e9, self.on_step)

    def on_step(self):
        """Advance by all due steps."""
        if not self.stepper or self.stepper.outcome:  # a call that was already queued
            return
        trajectory = self.stepper.advance_to(self.now_ns())
        fault = self.stepper.stop.message if self.stepper.controller_gone else ''
        if self.silence_log.has_changed(fault):
            if fault:
                self.node.get_logger().error(fault)
            else:
                self.node.get_logger().warning('commands are back, the car follows them')
        if trajectory:
            self.node.publish(trajectory)
            self.node.publish_health(self.stepper, self.monitor, trajectory)
        if self.stepper.outcome:
            self.end()

    def end(self):
        """Withdraw the odometry before shutdown: a controller that still had it would brake.

        The sensors, too: their estimator withdraws its odometry then.
        """
        self.node.destroy_timer(self.timer)
        for pub in (self.node.odometry_pub, *self.node.sensor_pubs.values()):
            self.node.destroy_lifecycle_publisher(pub.publisher)
        # the executor has to release the publisher first, which it does while it spins
        code = self.stepper.outcome.exit_code
        self.timer = ros.steady_timer(
            self.node, SHUTDOWN_S, lambda: spin_node.finish(self.node, code)
        )
