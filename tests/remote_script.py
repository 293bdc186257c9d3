"""A program that moves a robot through the robot process, for tests that end one of the two processes.

    python remote_script.py HOW FOLDER PLATFORM KEY=VALUE...

The robot is an A1 emulator of the platform. It stands up, lifts two feet, prints {"lifted": true, "robot": PID} and
then, by HOW: "hold" keeps them up, "kill" is killed, "grip" lets no other thread run, "exit" exits, "error" raises an error of
its own.
"""

import json
import os
import re
import signal
import sys
from pathlib import Path

from guarded import lift

from equipoise import load_robot, nominal_stance
from equipoise.drivers.platforms import given_settings
from equipoise.experiments.stand import stand_up
from equipoise.guard.remote_robot import RemoteRobot


def main(how, folder, platform, *settings):
    robot = load_robot("unitree_a1")
    remote = RemoteRobot(platform, robot, given_settings(settings, None), None, Path(folder) / "ending.txt")
    with remote:
        stand_up(remote, robot, nominal_stance(robot))
        lift(remote, robot, watch=0.1)
        print(json.dumps({"lifted": True, "robot": remote._process.pid}), flush=True)
        if how == "hold":
            lift(remote, robot, watch=60.0)
        if how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if how == "grip":
            re.match("(a+)+$", 60 * "a" + "b")
        if how == "exit":
            sys.exit(3)
        raise ValueError("an error of the program")


if __name__ == "__main__":
    main(*sys.argv[1:])
