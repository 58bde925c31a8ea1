"""Shutdown of a node process: signals, and an end in bounded time without a deadlock. No ROS.

Fast DDS waits for the callbacks of a participant before it destroys it. Built with a C++ library
older than GCC 10, as in the wheels, the time point that stands for "without end" overflows
(https://github.com/eProsima/Fast-DDS/issues/6513): the wait returns at once, again and again, and
the C library refuses that time point before it releases the lock. A running callback that needs the
lock, and with it the process, then hangs for ever. Of 1,500 shutdowns of ten processes that left at
the same time, and discovered that of each other, 17 hung.

`drop_incoming` makes that rare: the process receives nothing while it shuts down. `exit_after` ends
a process that hangs all the same.
"""

import contextlib
import ctypes
import faulthandler
import fcntl
import os
import signal
import socket
import struct
import sys
import termios
import time
from collections.abc import Callable, Iterator
from functools import partial

SIGNALS = (signal.SIGINT, signal.SIGTERM)
DESCRIPTORS = '/proc/self/fd'
INTERNET = (socket.AF_INET, socket.AF_INET6)
SO_ATTACH_FILTER = 26  # asm-generic/socket.h
BPF_RET = 0x06  # linux/filter.h: return a constant, the number of bytes of a packet to keep
DROP_ALL = struct.pack('HBBI', BPF_RET, 0, 0, 0)  # struct sock_filter
DRAIN_S = 0.5  # longest wait for queued packets
POLL_S = 0.002
SIGEV_THREAD = 2  # asm-generic/siginfo.h
CLOCK_MONOTONIC = 1  # linux/time.h
STDERR = 2
TRACEBACK_S = 0.2  # before the forced exit
TRACEBACK_START = 'Timeout ('  # its first words, from faulthandler


@contextlib.contextmanager
def signals_as_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGINT and SIGTERM in the body; ignore both from its end on.

    This holds also for a signal that was ignored before: shells ignore SIGINT for background jobs,
    but scripts that start nodes end them with SIGINT. After the body a signal must not turn the
    exit code of the process into that of a kill.
    """
    for number in SIGNALS:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        # the interpreter restores the system's handlers before the process has ended
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def call_on_signal(request: Callable[[], None]) -> None:
    """Call `request` for both signals from now on, instead of an interrupt.

    It runs between two instructions of the main thread and must take no lock: an interrupt in the
    middle of a callback would leave half a message or half a record. Handlers that a node has
    installed itself stay.
    """
    for number in SIGNALS:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, lambda *_: request())


def _interrupt(number, frame):
    raise KeyboardInterrupt


def drop_incoming() -> int:
    """Drop the UDP packets that arrive from now on; return the number of sockets that do.

    DDS discovery uses UDP. Packets that are queued are still received: the call waits for that,
    half a second at most. Sending is not affected.
    """
    drop = ctypes.create_string_buffer(DROP_ALL)
    program = struct.pack('@HP', 1, ctypes.addressof(drop))  # struct sock_fprog
    dropping = []
    with contextlib.suppress(OSError):  # no descriptor is left to list them with
        for descriptor in map(int, os.listdir(DESCRIPTORS)):
            # no socket, closed meanwhile, or a kernel without filters
            with contextlib.suppress(OSError):
                udp = socket.socket(fileno=descriptor)
                try:
                    if udp.type == socket.SOCK_DGRAM and udp.family in INTERNET:
                        udp.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, program)
                        dropping.append(descriptor)
                finally:
                    udp.detach()
    end = time.monotonic() + DRAIN_S
    while any(map(_queued_bytes, dropping)) and time.monotonic() < end:
        time.sleep(POLL_S)
    return len(dropping)


@contextlib.contextmanager
def exit_after(seconds: float, exit_code: int) -> Iterator[None]:
    """End this process with an exit code unless the body has ended after so many seconds.

    A timer of the C library does it: a destructor that hangs holds the interpreter, so no Python
    thread could. Shortly before, the traceback goes to stderr. This thread gives up its real-time
    priority so that the timer thread can run on the same core. If the system has no timer left, the
    body has no time limit.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    with contextlib.suppress(OSError):  # SCHED_IDLE may not be raised
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with contextlib.ExitStack() as timers:
        with contextlib.suppress(OSError):
            timers.callback(_start_timer(seconds, exit_code))
        with contextlib.suppress(RuntimeError):
            faulthandler.dump_traceback_later(max(seconds - TRACEBACK_S, seconds / 2), file=STDERR)
            timers.callback(faulthandler.cancel_dump_traceback_later)
        yield


def _queued_bytes(descriptor):
    """Return the size of the packet that is queued at a socket, 0 for none."""
    with contextlib.suppress(OSError):
        size = fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4))
        return int.from_bytes(size, sys.byteorder)
    return 0


class _Event(ctypes.Structure):
    """`struct sigevent`, 64 bytes: call a function in a thread of its own."""

    _fields_ = (
        ('argument', ctypes.c_size_t),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_byte * 32),
    )


def _start_timer(seconds, exit_code):
    """Start a timer that ends the process; return what stops it. Raises OSError."""
    # glibc before 2.34 has timers in librt; later ones keep it as an alias
    libc = ctypes.CDLL('librt.so.1')
    end = ctypes.cast(libc._exit, ctypes.c_void_p)
    event, timer = _Event(exit_code, 0, SIGEV_THREAD, end), ctypes.c_void_p()
    if libc.timer_create(CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError('timer_create')
    whole, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
    once = (ctypes.c_long * 4)(0, 0, whole, nanoseconds)  # struct itimerspec
    libc.timer_settime(timer, 0, ctypes.byref(once), None)
    return partial(libc.timer_delete, timer)
