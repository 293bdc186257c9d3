"""A program that moves a guarded robot, for tests that end it from outside. Writes what the robot sees to a file.

    python guarded_script.py HOW FILE

HOW: "with" (a guard as it should be used), "without" (no `with`), "exit" (no `with`, and it exits in the middle), "thinking"
(all is done, and it waits), "error" (no `with`, and an error of its own).
"""

import json
import sys
import time
from pathlib import Path

from guarded import Seen, is_damped, lift, simulated

from equipoise import load_robot, nominal_stance
from equipoise.guard.footing import feet_are_lifted
from equipoise.guard.guard import Guard


class Told(Seen):
    """A robot that writes down what it is made to do, whenever that changes."""

    def __init__(self, platform, robot, path):
        super().__init__(platform)
        self._robot, self._path, self._said = robot, Path(path), None

    def step(self, command):
        lifted = feet_are_lifted(self._robot, nominal_stance(self._robot), command.position)
        limp = is_damped(command)
        self._say("damped" if limp else "on two feet" if lifted else "on four feet")
        return super().step(command)

    def close(self):
        super().close()
        self._say("released")

    def _say(self, what):
        if what != self._said:
            self._said = what
            with self._path.open("a", encoding="utf-8") as file:
                print(json.dumps(what), file=file)


def main(how, path):
    robot = load_robot("unitree_a1")
    guard = Guard(Told(simulated(robot)[0], robot, path), robot)
    if how in ("with", "thinking"):
        with guard:
            lift(guard, robot, watch=0.1 if how == "thinking" else 60.0)
            time.sleep(60.0)
    lift(guard, robot, watch=60.0 if how == "without" else 0.1)
    if how == "exit":
        sys.exit(3)
    raise ValueError("an error of the program")


if __name__ == "__main__":
    main(*sys.argv[1:])
