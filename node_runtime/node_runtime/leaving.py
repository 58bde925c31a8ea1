"""How a process takes leave of the middleware: without a deadlock, and in bounded time. No ROS.

Fast DDS waits for the callbacks of a participant before it destroys it. With a C++ library older
than GCC 10, that of the wheels, the instant that stands for "without end" overflows. The wait then
returns at once, again and again (https://github.com/eProsima/Fast-DDS/issues/6513), here with an
instant that the C library refuses before it gives the lock back: a callback under way, which needs
the lock to end, and the process are held for ever. Of 1,500 ends of ten processes that left, and
told each other so, at the same time 17 were held (bench/leaving.py).

So a process hears nothing any more when it leaves, which makes that rare; and if it is held all the
same, a timer ends it.
"""

import contextlib
import ctypes
import faulthandler
import fcntl
import os
import socket
import struct
import sys
import termios
import time
from collections.abc import Iterator
from functools import partial

DESCRIPTORS = '/proc/self/fd'
INTERNET = (socket.AF_INET, socket.AF_INET6)
SO_ATTACH_FILTER = 26  # asm-generic/socket.h
BPF_RET = 0x06  # linux/filter.h: return a constant, how many bytes of a packet to keep
NOTHING = struct.pack('HBBI', BPF_RET, 0, 0, 0)  # struct sock_filter
LONGEST_S = 0.5  # until what is queued has been heard
LOOK_S = 0.002
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
    """Drop the UDP packets that come to this process from now on; return how many sockets do.

    Discovery tells of others by UDP. What is queued is still heard: that is waited for, half a
    second at most. What this process says goes out as before.
    """
    drop = ctypes.create_string_buffer(NOTHING)
    program = struct.pack('@HP', 1, ctypes.addressof(drop))  # struct sock_fprog
    deaf = []
    with contextlib.suppress(OSError):  # no descriptor is left to look with
        deaf = [int(name) for name in os.listdir(DESCRIPTORS) if _deafened(int(name), program)]
    end = time.monotonic() + LONGEST_S
    while any(map(_queued, deaf)) and time.monotonic() < end:
        time.sleep(LOOK_S)
    return len(deaf)


@contextlib.contextmanager
def within(seconds: float, exit_code: int) -> Iterator[None]:
    """End this process with an exit code unless the body has ended in so many seconds.

    By a timer of the C library: a destructor that does not return holds the interpreter, and no
    thread of Python gets its turn. Shortly before, the process says on stderr where it is held.
    This thread gives up its priority, so that the timer gets its turn on the same core. Where the
    system has no timer left the body takes its time.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    with contextlib.suppress(OSError):  # a thread of less priority than any has none to give up
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.ExitStack() as timers:
        with contextlib.suppress(OSError):
            timers.callback(_start_timer(seconds, exit_code))
        with contextlib.suppress(RuntimeError):
            faulthandler.dump_traceback_later(max(seconds - SAID_S, seconds / 2), file=STDERR)
            timers.callback(faulthandler.cancel_dump_traceback_later)
        yield


def _deafened(descriptor, program):
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


def _queued(descriptor):
    """Return the size of the packet that waits at a socket, 0 for none."""
    with contextlib.suppress(OSError):
        size = fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4))
        return int.from_bytes(size, sys.byteorder)
    return 0


def _start_timer(seconds, exit_code):
    """Return what stops it; OSError."""
    # glibc before 2.34 has timers in a library of its own; the later one leads to them, too
    libc = ctypes.CDLL('librt.so.1')
    end = ctypes.cast(libc._exit, ctypes.c_void_p)
    event, timer = _Event(exit_code, 0, SIGEV_THREAD, end), ctypes.c_void_p()
    if libc.timer_create(CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError('timer_create')
    whole, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
    after = (ctypes.c_long * 4)(0, 0, whole, nanoseconds)  # struct itimerspec: once
    libc.timer_settime(timer, 0, ctypes.byref(after), None)
    return partial(libc.timer_delete, timer)
