"""Emulated robot without a wire."""

import json

from equipoise.lab.emulators.emulated_robot import EmulatedRobot, EmulatorSettings


class Log(list):
    """List of the pieces that are written."""

    write = list.append

    def flush(self): ...


def test_a_line_of_the_log_is_one_write(a1):
    """Ctrl-C between a line and its end would put two objects on one line."""
    log = Log()
    robot = EmulatedRobot(a1, EmulatorSettings(sim_preset="ideal"), log)
    robot.log(ready=True)
    robot.step()
    assert all(piece.endswith("}\n") for piece in log)
    assert json.loads(log[0]) == {"time": 0.0, "ready": True}
    assert len(log) == 2
