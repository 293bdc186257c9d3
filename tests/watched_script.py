"""A program that holds a robot up with a guard and a watchdog, for tests in which it goes wrong.

    python watched_script.py HOW LOG PLATFORM KEY=VALUE...

The robot is an A1 that speaks as the platform does, with these settings. Says "hangs" when it stands, and then: "loop" runs in
circles, "grip" does so without letting other threads run, "stop" is stopped as by Ctrl-Z, "kill" is killed, "motion" is killed
in a motion, "legs up" while the robot lies and swings its legs, "think" thinks for three seconds and ends in good order.
"""

import os
import re
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np

from equipoise import calibrate, load_robot
from equipoise.alive import alive
from equipoise.drivers.catalog import given_settings
from equipoise.guard.connection import open_guarded
from equipoise.guard.limits import Limits
from equipoise.motors.method import Motors
from equipoise.platform.platform import Trajectory
from equipoise.recording.phases import Phase

BUSY = Limits(silence=1.0, stall=1.0, missing_torque=50.0)  # for a machine that has other things to do, too


def kill(number):
    os.kill(os.getpid(), number)


def loop():
    while True:
        pass


def think():
    until = time.monotonic() + 3.0
    while time.monotonic() < until:
        time.sleep(0.5)
        alive()


def stand(guard, robot, duration):
    """Where it stands, or lies."""
    here = np.clip(guard.read().joint_position, robot.lower_limit, robot.upper_limit)
    guard.play(Trajectory(np.repeat(here[None], round(duration / guard.control_period), axis=0)))


def killed_in_motion(guard, robot):
    threading.Timer(0.5, kill, [signal.SIGKILL]).start()
    stand(guard, robot, 5.0)


def killed_with_legs_up(guard, robot):
    """While the robot lies and swings them."""

    def watch():
        while guard.phase != Phase.SWING:
            time.sleep(0.01)
        print("hangs", flush=True)
        kill(signal.SIGKILL)

    threading.Thread(target=watch, daemon=True).start()
    calibrate(guard, robot, Motors(motor_time=10.0))


def main(how, log, name, *settings):
    robot, given = load_robot("unitree_a1"), given_settings(settings, None)
    with open_guarded(name, robot, given, told=Path(log), limits=BUSY) as guard:
        if how == "legs up":
            killed_with_legs_up(guard, robot)
        stand(guard, robot, 0.3)
        print("hangs", flush=True)
        if how == "motion":
            killed_in_motion(guard, robot)
        {
            "loop": loop,
            "grip": lambda: re.match("(a+)+$", 60 * "a" + "b"),
            "stop": lambda: kill(signal.SIGSTOP),
            "kill": lambda: kill(signal.SIGKILL),
            "think": think,
        }[how]()


if __name__ == "__main__":
    main(*sys.argv[1:])
