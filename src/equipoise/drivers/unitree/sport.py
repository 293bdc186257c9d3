"""Release of a Go2's motors by the robot's own controller."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from equipoise.drivers.checkup import CheckupFinding
from equipoise.drivers.dds.domain import DdsDomain
from equipoise.drivers.unitree.dds_types import Request, RequestHeader, RequestIdentity, Response
from equipoise.errors import CommunicationError

CHECK_MODE, RELEASE_MODE = 1001, 1003  # functions of the service
REQUESTS, RESPONSES = "rt/api/motion_switcher/request", "rt/api/motion_switcher/response"

_FOUND = 3.0  # [s] in which the service must be found
_ANSWER = 1.0  # [s] in which it must answer
_TRIES = 3  # a request or a response may get lost
_RELEASED = 10.0  # [s] in which the mode must end
_POLL, _AGAIN = 2e-3, 0.5  # [s] between checks for responses, and between requests to release the motors


class MotionSwitcher:
    """Client of the service that starts and ends the robot's own controllers ("normal", "ai", ... : sport mode).

    Args:
        domain: domain of the robot.
        robot: name of the robot, for messages.
    """

    def __init__(self, domain: DdsDomain, robot: str) -> None:
        self._robot = robot
        self._requests = domain.outbox(REQUESTS, Request)
        self._responses = domain.inbox(RESPONSES, Response)
        self._number = time.monotonic_ns()

    def mode(self) -> str:
        """Return the name of the controller that holds the motors; empty if none does.

        Raises:
            CommunicationError: the service does not exist, or its answer is invalid.
        """
        answer = self._call(CHECK_MODE)
        try:
            return str(json.loads(answer)["name"])
        except (ValueError, TypeError, KeyError):
            raise self._failure(f"answers {answer[:80]!r} to a request for the mode") from None

    def release(self) -> None:
        """Have the robot's own controller release the motors. They become limp: the robot must lie or hang.

        Raises:
            CommunicationError: the controller does not release them.
        """
        until = time.monotonic() + _RELEASED
        while mode := self.mode():
            if time.monotonic() > until:
                raise self._failure(
                    f"still reports that {mode!r} holds the motors, {_RELEASED:g} s after the request to end it"
                )
            self._call(RELEASE_MODE)
            time.sleep(_AGAIN)

    def _call(self, function: int) -> str:
        """Return the data of the response to a request without parameters."""
        if not _wait_for(lambda: self._requests.readers and self._responses.writers, _FOUND):
            raise self._failure(
                f"was not found within {_FOUND:g} s; a simulator without it needs release_sport_mode=false; for robot "
                "firmware without it, see docs/hardware/unitree-go2-b2.md"
            )
        if (robots := self._responses.writers) > 1:
            raise self._failure(
                f"exists {robots} times ({', '.join(self._responses.names_of_writers().values())}): several robots would "
                "execute the request. Disconnect the others, or give this robot its own DDS domain and set domain"
            )
        for _ in range(_TRIES):
            self._number += 1
            self._requests.send(Request(RequestHeader(RequestIdentity(self._number, function)), "{}"))
            response = _wait_for(lambda number=self._number: self._response(number), _ANSWER)
            if response is not None:
                if response.header.status.code != 0:
                    raise self._failure(f"refuses function {function} with code {response.header.status.code}")
                return str(response.data)
        raise self._failure(f"has not answered {_TRIES} requests, each within {_ANSWER:g} s")

    def _response(self, number: int) -> Any | None:
        for _, response in self._responses.take():
            if response.header.identity.id == number:
                return response
        return None

    def _failure(self, failure: str) -> CommunicationError:
        return CommunicationError(f"the motion_switcher service of {self._robot} {failure}")


def takeover_finding(switcher: MotionSwitcher, releases: bool, may_release: bool) -> CheckupFinding:
    """Return the finding about the controller that holds the motors; nothing is released.

    Args:
        switcher: mode switcher of the robot; only its mode is requested.
        releases: whether `calibrate` will have the robot's own controller release the motors (release_sport_mode).
        may_release: whether the robot lies or hangs, so that it would not fall.
    """
    name = "robot's own controller"
    try:
        mode = switcher.mode()
    except CommunicationError as error:
        if not releases:
            return CheckupFinding(name, "not known; calibrate will not request it (release_sport_mode=false)", None)
        return CheckupFinding(
            name, f"{error}. calibrate will fail", False,
            "on a robot: is this its interface? A simulator without the service needs release_sport_mode=false",
        )  # fmt: skip
    if not mode:
        return CheckupFinding(name, "none holds the motors; calibrate will command them at once", True)
    if not releases:
        value = f"{mode!r} holds the motors, and calibrate will not have it release them: both would command them"
        return CheckupFinding(name, value, False, "leave out release_sport_mode=false", serious=True)
    if not may_release:
        value = f"{mode!r} holds the motors, and the robot does not lie: calibrate will fail, as the robot would fall"
        return CheckupFinding(
            name, value, False, "have it lie down with its remote control; if it hangs in a frame, set hanging=true",
            serious=True,
        )  # fmt: skip
    return CheckupFinding(
        name, f"{mode!r} holds the motors; calibrate will have it release them, and the legs become limp", True
    )


def _wait_for(look: Callable[[], Any], patience: float) -> Any | None:
    """Return the first true result of a function; None after a time [s]."""
    until = time.monotonic() + patience
    while not (found := look()):
        if time.monotonic() > until:
            return None
        time.sleep(_POLL)
    return found
