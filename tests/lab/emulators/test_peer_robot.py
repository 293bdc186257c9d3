"""The simulated robot in real time, without a wire."""

import json

from equipoise.lab.emulators.emulated_robot import PeerRobot, PeerSettings


class Log(list):
    """What is written, piece by piece."""

    write = list.append

    def flush(self): ...


def test_a_line_of_the_log_is_written_at_one_go(a1):
    """Ctrl-C came between a line and its end, where Python buffers nothing, and two objects stood on one line."""
    log = Log()
    robot = PeerRobot(a1, PeerSettings(sim_preset="ideal"), log)
    robot.say(ready=True)
    robot.step()
    assert all(piece.endswith("}\n") for piece in log)
    assert json.loads(log[0]) == {"time": 0.0, "ready": True}
    assert len(log) == 2
