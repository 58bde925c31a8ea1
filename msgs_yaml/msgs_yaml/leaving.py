"""How a process takes leave of the middleware: without deadlock, and in bounded time. No ROS.

Fast DDS waits for the callbacks of a participant before it destroys it. In the wheels that wait
never gives its lock back: the instant that stands for "without end" overflows where the C++ library
is older than GCC 10 (https://github.com/eProsima/Fast-DDS/issues/6513), and the callback, which
needs the lock to end, and the process wait for each other for ever. It happens when the others
leave, and tell so, at the same time: some three of a thousand ends of a process. So a process hears
nothing any more before it leaves; and should it be held all the same, the kernel ends it.
"""

import contextlib
import ctypes
import faulthandler
import os
import socket
import struct
from collections.abc import Iterator

DESCRIPTORS = '/proc/self/fd'
INTERNET = (socket.AF_INET, socket.AF_INET6)
SO_ATTACH_FILTER = 26  # asm-generic/socket.h
BPF_RET = 0x06  # linux/filter.h: return a constant, how many bytes of a packet to keep
NOTHING = struct.pack('HBBI', BPF_RET, 0, 0, 0)  # struct sock_filter
SIGEV_THREAD = 2  # asm-generic/siginfo.h
CLOCK_MONOTONIC = 1  # linux/time.h
STDERR = 2
SAID_S = 0.2  # before the end it is said where the process is held
HELD = 'Timeout ('  # how that begins


class _Event(ctypes.Structure):
    """`struct sigevent`, 64 bytes: call a function in a thread of its own."""

    _fields_ = (
        ('argument', ctypes.c_size_t),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('rest', ctypes.c_byte * 32),
    )


def deafen() -> int:
    """Drop every UDP packet that comes to this process from now on; return of how many sockets.

    Discovery tells of others by UDP. What this process says still goes out.
    """
    drop = ctypes.create_string_buffer(NOTHING)
    program = struct.pack('@HP', 1, ctypes.addressof(drop))  # struct sock_fprog
    return sum(_is_deafened(int(name), program) for name in os.listdir(DESCRIPTORS))


def _is_deafened(descriptor, program):
    try:
        ear = socket.socket(fileno=descriptor)
    except OSError:  # no socket, or closed meanwhile
        return False
    try:
        if ear.type != socket.SOCK_DGRAM or ear.family not in INTERNET:
            return False
        ear.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, program)
        return True
    except OSError:  # a kernel without filters
        return False
    finally:
        ear.detach()


@contextlib.contextmanager
def within(seconds: float, exit_code: int) -> Iterator[None]:
    """End this process with an exit code unless the body has ended in so many seconds.

    By a timer of the C library: a destructor that hangs holds the interpreter, and no thread of
    Python gets its turn. Shortly before, the process says on stderr where it is held. This thread
    gives up its priority, so that the timer gets its turn on the same core. Where the system has
    no timer left the body takes its time.
    """
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    # glibc before 2.34 has timers in a library of its own; the later one leads to them, too
    libc = ctypes.CDLL('librt.so.1')
    end = ctypes.cast(libc._exit, ctypes.c_void_p)
    event, timer = _Event(exit_code, 0, SIGEV_THREAD, end), ctypes.c_void_p()
    if libc.timer_create(CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        yield
        return
    whole, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
    after = (ctypes.c_long * 4)(0, 0, whole, nanoseconds)  # struct itimerspec: once
    libc.timer_settime(timer, 0, ctypes.byref(after), None)
    faulthandler.dump_traceback_later(max(seconds - SAID_S, seconds / 2), file=STDERR)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        libc.timer_delete(timer)
