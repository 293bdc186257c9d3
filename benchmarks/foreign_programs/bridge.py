"""The public simulator of Unitree without its window, in a Python of its own; nothing of it is changed.

    PYTHONPATH=SDK2 PYTHON bridge.py UNITREE_MUJOCO SCENE --domain 5 --step 0.002 [--lockstep]

In lockstep, which it does not have, its world waits for commands and advances by one control period with each; before the
first it runs by the clock. A sample then says when it was taken (`tick`), which the simulator leaves empty.
"""

import argparse
import os
import runpy
import sys
import threading
import time
import types

import mujoco

PERIOD = 2e-3  # [s] between commands
LYING = (
    0.09,
    4 * (0.0, 1.3, -2.7),
)  # height [m] and joints [rad] of a Go2 on its belly; at zero its legs are stretched


class Window:
    """What stands in for MuJoCo's viewer."""

    def is_running(self):
        return True

    def sync(self):
        pass


class Idle:
    """What stands in for the threads that publish by the clock."""

    def __init__(self, **_):
        pass

    def Start(self):  # noqa: N802 - its name
        pass


def lying(make=mujoco.MjData):
    """What makes the data of a model, its robot on its belly, limp."""

    def made(model):
        data = make(model)
        data.qpos[2], data.qpos[7:19] = LYING
        return data

    return made


def lockstep(config):
    """Run the simulator's bridge, but step its world when a command has come."""
    import unitree_sdk2py_bridge as bridge  # noqa: PLC0415 - next to the checkout
    from unitree_sdk2py.core.channel import ChannelFactoryInitialize  # noqa: PLC0415

    came = threading.Semaphore(0)

    class Bridge(bridge.UnitreeSdk2Bridge):
        def LowCmdHandler(self, msg):  # noqa: N802 - its name
            super().LowCmdHandler(msg)
            came.release()

    bridge.RecurrentThread = Idle
    model = mujoco.MjModel.from_xml_path(config.ROBOT_SCENE)
    model.opt.timestep = config.SIMULATE_DT
    data = mujoco.MjData(model)
    ChannelFactoryInitialize(config.DOMAIN_ID, config.INTERFACE)
    robot, commanded = Bridge(model, data), False
    while True:
        commanded |= came.acquire(timeout=None if commanded else PERIOD)
        for _ in range(round(PERIOD / model.opt.timestep)):
            mujoco.mj_step(model, data)
        robot.low_state.tick = round(1e3 * data.time)
        robot.PublishLowState()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout")
    parser.add_argument("scene")
    parser.add_argument("--domain", type=int, default=1)
    parser.add_argument("--step", type=float, default=0.005)
    parser.add_argument("--lockstep", action="store_true")
    given = parser.parse_args()
    mujoco.viewer = types.SimpleNamespace(launch_passive=lambda *_, **__: Window())
    mujoco.MjData = lying()
    sys.modules["mujoco.viewer"] = mujoco.viewer
    folder = os.path.join(given.checkout, "simulate_python")
    sys.path.insert(0, folder)
    import config  # noqa: PLC0415 - the simulator's

    config.ROBOT_SCENE, config.DOMAIN_ID, config.SIMULATE_DT = os.path.abspath(given.scene), given.domain, given.step
    config.USE_JOYSTICK, config.PRINT_SCENE_INFORMATION = 0, False
    print('{"ready": true}', flush=True)
    if given.lockstep:
        lockstep(config)
    else:
        runpy.run_path(os.path.join(folder, "unitree_mujoco.py"), run_name="__main__")
        while True:
            time.sleep(1)


main()
