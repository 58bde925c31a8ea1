"""Keys arrive one by one, and the terminal is left as it was found."""

import fcntl
import os
import subprocess
import sys
import termios

PROGRAM = """
import sys
from bags.playback import Keyboard
from queue import SimpleQueue
keys = SimpleQueue()
keyboard = Keyboard(keys.put)
print('attached' if keyboard.attached else 'alone', flush=True)
while keyboard.attached and (key := keys.get(timeout=20)) != 'q':
    print(f'key {key!r}', flush=True)
keyboard.close()
"""
TIMEOUT_S = 30


def start(stdin, **options):
    return subprocess.Popen(
        [sys.executable, '-c', PROGRAM], stdin=stdin, stdout=subprocess.PIPE, text=True, **options
    )


def on_a_terminal(follower):
    """Start the program as a shell would in the foreground of this terminal."""
    return start(
        follower,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )


def test_keys_come_without_enter_and_the_terminal_is_restored():
    leader, follower = os.openpty()
    before = termios.tcgetattr(follower)
    program = on_a_terminal(follower)
    try:
        assert program.stdout.readline() == 'attached\n'
        assert not termios.tcgetattr(follower)[3] & termios.ICANON
        os.write(leader, b' s')
        assert program.stdout.readline() == "key ' '\n"
        assert program.stdout.readline() == "key 's'\n"
        os.write(leader, b'q')
        assert program.wait(TIMEOUT_S) == 0
        assert termios.tcgetattr(follower) == before
    finally:
        program.kill()
        os.close(leader)
        os.close(follower)


def test_what_is_no_terminal_is_left_alone():
    program = start(subprocess.DEVNULL)
    assert program.communicate(timeout=TIMEOUT_S)[0] == 'alone\n'


def test_terminal_of_others_is_left_alone():
    # a session of its own, but not this terminal's: a program in the background
    leader, follower = os.openpty()
    before = termios.tcgetattr(follower)
    program = start(follower, start_new_session=True)
    try:
        assert program.communicate(timeout=TIMEOUT_S)[0] == 'alone\n'
        assert termios.tcgetattr(follower) == before
    finally:
        os.close(leader)
        os.close(follower)
