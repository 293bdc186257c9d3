"""Settings of the paper's method, also read as command-line flags."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from equipoise.errors import SettingsError
from equipoise.experiments.excitation_settings import ExcitationSettings

if TYPE_CHECKING:
    from equipoise.experiments.lift import LiftSettings
    from equipoise.paper.bracket import Bracket
    from equipoise.robot.stance import Stance

_BOUND = 0.06  # [m] on an A1
_LIFT_RATIO = 0.05
_SMALLEST_LIFT_RATIO, _LARGEST_LIFT_RATIO = 0.01, 0.3
_ALLOWED = (
    ("lower", -2.0, 2.0),
    ("upper", -2.0, 2.0),
    ("tolerance", 1e-4, 1.0),
    ("lift_height", 1e-3, 1.0),
    ("t_thres", 0.2, 10.0),  # a robot needs at least the lower limit to tip measurably
    ("speed", 0.1, 3.0),
)


@dataclass(frozen=True)
class ComSearchSettings:
    """Settings of the CoM search. None stands for a default that scales with the robot.

    Attributes:
        lower: lower search bound x_l of the offset along the base's x axis [m]; default -6 cm on an A1.
        upper: upper search bound x_u of the offset [m]; default 6 cm on an A1.
        tolerance: width of the bracket at which the search ends [m].
        lift_height: height of the first lift [m]; default 5 % of the hip height.
        t_thres: observation time with two feet up [s]; default 0.8 s on an A1.
        speed: factor on the robot's speed between trials.
    """

    lower: float | None = None
    upper: float | None = None
    tolerance: float = 0.005
    lift_height: float | None = None
    t_thres: float | None = None
    speed: float = 1.0

    def __post_init__(self) -> None:
        for name, least, most in _ALLOWED:
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise SettingsError(f"{name} is {value}; it must be from {least} to {most}")
        if self.lower is not None and self.upper is not None:
            _check_order(self.lower, self.upper)

    def bounds(self, stance: Stance) -> tuple[float, float]:
        """Return x_l and x_u for a robot of this size [m]; raises SettingsError if there is nothing to search between them."""
        default = _BOUND * stance.scale.length
        lower = -default if self.lower is None else self.lower
        upper = default if self.upper is None else self.upper
        _check_order(lower, upper)
        if not self.tolerance < (upper - lower) / 2:
            raise SettingsError(
                f"the tolerance of {self.tolerance} m leaves nothing to search between {lower:.4f} and {upper:.4f} m"
            )
        return lower, upper

    def halvings(self, stance: Stance) -> int:
        """Return the number of halvings until the bracket is as narrow as the tolerance: at least one."""
        lower, upper = self.bounds(stance)
        return math.ceil(math.log2((upper - lower) / self.tolerance))

    def bracket(self, stance: Stance) -> Bracket:
        """Return the bracket that a search on a robot of this size begins with; raises SettingsError as `bounds` does."""
        from equipoise.paper.bracket import Bracket  # noqa: PLC0415
        from equipoise.paper.trial_runner import lift_heights  # noqa: PLC0415

        return Bracket(*self.bounds(stance), self.tolerance, lift_heights(self.lift(stance))[-1])

    def lift(self, stance: Stance) -> LiftSettings:
        """Return the settings of a lift trial for a robot of this size."""
        from equipoise.experiments.lift import LiftSettings  # noqa: PLC0415

        height = self.lift_height or _LIFT_RATIO * stance.hip_height
        if not _SMALLEST_LIFT_RATIO <= height / stance.hip_height <= _LARGEST_LIFT_RATIO:
            raise SettingsError(
                f"lift_height is {height} m; for hips {stance.hip_height:.3f} m high it must be from "
                f"{_SMALLEST_LIFT_RATIO * stance.hip_height:.4f} to {_LARGEST_LIFT_RATIO * stance.hip_height:.3f} m"
            )
        usual = LiftSettings.of(stance, height)
        return replace(
            usual,
            move_time=usual.move_time / self.speed,
            settle_time=usual.settle_time / self.speed,
            watch_time=self.t_thres or usual.watch_time,
            lower_time=usual.lower_time / self.speed,
        )


@dataclass(frozen=True)
class PaperSettings:
    """Settings of the paper's method.

    Attributes:
        feet: foot positions for the support lines: "measured" by encoders and accelerometer at rest, or "commanded", as in
            the paper.
        com_search: step 1.
        excitation: step 2.
    """

    summary: ClassVar[str] = (
        "bisection determines the planar centre of mass (Algorithms 1 and 2), excitations determine moments of inertia "
        "(equations 2 to 5)"
    )
    estimate_only: ClassVar[tuple[str, ...]] = ("feet",)

    feet: Literal["measured", "commanded"] = "measured"
    com_search: ComSearchSettings = field(default_factory=ComSearchSettings, metadata={"prefix": ""})
    excitation: ExcitationSettings = field(default_factory=ExcitationSettings, metadata={"prefix": "excitation_"})

    def __post_init__(self) -> None:
        if self.feet not in ("measured", "commanded"):
            raise SettingsError(f"feet is {self.feet!r}; it must be 'measured' or 'commanded'")


def _check_order(lower: float, upper: float) -> None:
    if not upper > lower:
        raise SettingsError(f"the search bounds are the wrong way round: upper {upper} m is not above lower {lower} m")
