"""How a car was handled: for how long it braked, steered against its turn, what grip it used."""

import numpy as np

GRAVITY = 9.81  # m/s^2
SAMPLE_NS = 10_000_000
NS = 1e-9  # s
# below these a steering angle and a turn have no side: 1 deg at the road wheel, 3 deg/s
STEERED_RAD = np.radians(1.0)
TURNING_RADPS = np.radians(3.0)


def braking_time(drive, force_n):
    """Return for how long [s] the actuated force was at or below `force_n`; None without any."""
    if not drive.inputs.stamp_ns.size:
        return None
    stamps = _stamps(drive.inputs.stamp_ns)
    force = np.interp(stamps, drive.inputs.stamp_ns, drive.inputs.force)
    return float(np.count_nonzero(force <= force_n) * SAMPLE_NS * NS)


def counter_steer(drive):
    """Return how long [s] and how far [deg] the wheels were steered against the turn of the car.

    The steering angle and the yaw rate have unlike signs, both beyond what is noise. Every change
    of direction has a little of it, because the steering leads; a rear axle that slides has much.
    None each where no steering angle is known.
    """
    if not drive.inputs.stamp_ns.size:
        return {'counter_steer_s': None, 'peak_counter_steer_deg': None}
    stamps = _stamps(drive.motion.stamp_ns)
    steer = np.interp(stamps, drive.inputs.stamp_ns, drive.inputs.steer)
    yaw = np.interp(stamps, drive.motion.stamp_ns, np.unwrap(drive.motion.yaw))
    # two samples have one difference; a drive of one has none
    turn = np.gradient(yaw, SAMPLE_NS * NS) if len(yaw) > 1 else np.zeros(len(yaw))
    against = (steer * turn < 0) & (np.abs(turn) > TURNING_RADPS) & (np.abs(steer) > STEERED_RAD)
    return {
        'counter_steer_s': float(np.count_nonzero(against) * SAMPLE_NS * NS),
        'peak_counter_steer_deg': float(
            np.degrees(np.max(np.abs(steer), where=against, initial=0))
        ),
    }


def shares(drive):
    """Return the peak accelerations as shares of what the friction of the road allows.

    None each where no acceleration was measured.
    """
    limit = drive.facts.friction * GRAVITY
    acc = drive.accelerations
    if not acc.stamp_ns.size:
        return {'peak_lat_acc_share': None, 'peak_brake_share': None}
    return {
        'peak_lat_acc_share': float(np.max(np.abs(acc.ay)) / limit),
        'peak_brake_share': max(0.0, -float(np.min(acc.ax)) / limit),
    }


def _stamps(stamp_ns):
    return np.arange(stamp_ns.min(), stamp_ns.max() + 1, SAMPLE_NS)
