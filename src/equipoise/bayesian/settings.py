"""What a user chooses of the Bayesian method, and which priors follow from it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from equipoise.bayesian.goals import Goals
from equipoise.errors import SettingsError
from equipoise.estimator.measurements.scale_reading import check_mass
from equipoise.estimator.prior_runs.prior_run import SCALE_GAIN, SCALE_NOISE, PriorRun
from equipoise.estimator.unknowns import Priors

if TYPE_CHECKING:
    from equipoise.robot.stance import Stance

_BUDGET, _BUDGET_AFTER = 120.0, 30.0  # [s] on an A1; where an earlier run is known
_LONGEST = 3600.0  # [s]
_FINEST, _COARSEST = 1e-4, 500.0  # [kg]
# Over the priors of what a cable may do: pull to a side, hang, hold back.
_CABLES = {"none": (0.0, 0.0, 0.0), "light": (1.0, 1.0, 1.0), "heavy": (5.0, 10.0, 2.0)}
_END_OF_TRUNK = 0.4  # hip heights ahead of the base's origin, or behind
_SURFACES = {"hard": 1.0, "carpet": 3.0}  # rolling resistance, sag and unevenness over their priors
_OF_CABLE = ("external_force", "hanging_load", "tether_stiffness")
_OF_SURFACE = ("rolling_resistance", "foot_compliance", "floor_warp", "foothold_change")
_OF_LEGS = (
    "leg_mass_common", "link_com", "link_com_common", "link_length", "link_length_common", "hip_position", "foot_radius_each",
)  # fmt: skip
_TRUSTED_MASS = 0.03
_LOOKED_FOR = 2.0  # times as much may lengths of legs be off that are looked for: 1.5 mm on an A1


@dataclass(frozen=True)
class BayesianSettings:
    """Settings of the Bayesian method, and what they say of the unknowns beforehand.

    Attributes:
        duration: robot time [s], as 60s or 2min; default 120 s on an A1, 30 s after an earlier run, more on larger robots.
        mass: mass of the whole robot, from a scale [kg]; without it the mass comes from joint torques.
        mass_std: standard deviation of that [kg]; default 0.5 %.
        confirm_mass: confirm a mass that disagrees with the joint torques by more than 15 %, or by more than 5 % with the
            torque constants of an earlier run; without it the command asks before it lifts a foot. The result is doubtful.
        excitation: the excitation about all axes at the end, which tells more about friction and Izz.
        rotate_halfway: turning the robot by 180 deg half-way, which somebody does while it lies limp: what pulls at it, an
            uneven floor and the accelerometer's bias are told from the planar CoM.
        surface: what the robot stands on; on a `carpet` feet may resist rolling, sag and stand uneven three times as much.
        goals: standard deviations at which a calibration is good enough to stop early.
        cable: what may pull at the robot, an Ethernet cable being light; `none` makes the planar CoM surer.
        leg_prior: whether masses, CoMs and lengths of the legs may be off the file's, as ever, or are `trusted` to be right
            to 3 % in mass; trusted legs make the CoM's height and the inertia surer.
        priors: what is believed before anything is measured; a TOML file of standard deviations by name.
        prior_run: an earlier run of the same robot, whose sensors, legs and friction are known then: the run's folder. Half a
            minute does (default budget 30 s on an A1) for the CoM; what changed since is named.
        swings: lifts in which the two lifted feet swing as well, which teach what the legs weigh, where their CoMs are and
            how long they are; the CoM's height and the inertia become surer with them.
    """

    judging: ClassVar[tuple[str, ...]] = ("mass", "mass_std", "cable", "leg_prior", "surface", "priors", "prior_run")

    duration: float | None = None
    mass: float | None = None
    mass_std: float | None = None
    excitation: bool = True
    rotate_halfway: bool = False
    cable: Literal["none", "light", "heavy"] = "light"
    leg_prior: Literal["wide", "narrow"] = "wide"
    surface: Literal["hard", "carpet"] = "hard"
    goals: Goals = field(default_factory=Goals, metadata={"prefix": None})
    priors: Priors = field(default_factory=Priors, metadata={"file": Priors.read})
    prior_run: PriorRun | None = field(default=None, metadata={"file": PriorRun.read, "metavar": "RUN"})
    swings: bool = field(default=False, metadata={"flag": False})  # `--parameters legs` says it
    confirm_mass: bool = False

    def __post_init__(self) -> None:
        if (
            self.duration is not None and not 0.0 < self.duration <= _LONGEST
        ):  # how long it must be, a robot's plan says
            raise SettingsError(f"duration is {self.duration:g} s; it must be above zero, up to {_LONGEST:g} s")
        if self.mass_std is not None and not _FINEST <= self.mass_std <= _COARSEST:
            raise SettingsError(
                f"the standard deviation of the scale's mass is {self.mass_std:g} kg; it must be from {_FINEST:g} to "
                f"{_COARSEST:g} kg"
            )
        if self.mass is not None:
            check_mass(self.mass, self.mass_std)
        if self.mass_std is not None and self.mass is None:
            raise SettingsError(
                "a standard deviation is given for the scale's mass, and no mass; give both, or neither"
            )
        if self.confirm_mass and self.mass is None:
            raise SettingsError("confirm_mass confirms a given mass, and there is none; give the mass, or leave it out")
        for name, known in (("cable", _CABLES), ("leg_prior", ("wide", "narrow")), ("surface", _SURFACES)):
            if getattr(self, name) not in known:
                raise SettingsError(f"{name} is {getattr(self, name)!r}; it must be {' or '.join(known)}")
        if self.prior_run is not None and self.rotate_halfway:
            raise SettingsError(
                "turn needs no earlier run, and a run after one does not turn; leave one of the two out"
            )
        if self.swings and (self.prior_run is not None or self.leg_prior == "narrow"):
            known = (
                "are known from an earlier run" if self.prior_run is not None else "are trusted to be as the file says"
            )
            raise SettingsError(f"legs that {known} are not looked for; leave one of the two out")
        if self.prior_run is not None and self.leg_prior not in ("wide", self.prior_run.leg_prior):
            raise SettingsError(
                f"leg_prior is {self.leg_prior!r}, but {self.prior_run.leg_prior!r} in the prior run, whose legs are used"
            )

    @property
    def combined_priors(self) -> Priors:
        """The priors, with what was said of cable, surface, turn and legs, and what an earlier run has of what is kept."""
        said = self._said
        return said if self.prior_run is None else self.prior_run.priors_of(said, self._same_scale)

    @property
    def _same_scale(self) -> bool:
        """Whether the scale is taken to be that of the earlier run: who says how sure a scale is has another one."""
        return self.prior_run is not None and None not in (self.prior_run.weighed, self.mass) and self.mass_std is None

    @property
    def _said(self) -> Priors:
        """The priors, with what was said of cable, surface, turn and legs."""
        wider = dict.fromkeys(_OF_SURFACE, _SURFACES[self.surface]) | dict(
            zip(_OF_CABLE, _CABLES[self.cable], strict=True)
        )
        priors = replace(self.priors, **{name: factor * getattr(self.priors, name) for name, factor in wider.items()})
        if not self.rotate_halfway:
            priors = priors.holding("foothold_change")
        if self.swings:  # who looks for legs does not trust the file's
            priors = replace(priors, link_length=_LOOKED_FOR * priors.link_length)
        if self.leg_prior == "wide":
            return priors
        return replace(priors.holding(*_OF_LEGS), leg_mass=min(_TRUSTED_MASS, priors.leg_mass))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions on cable, legs and sensors that no motion of a run can test."""
        combined_priors = self._said
        aside, down = combined_priors.external_force, combined_priors.hanging_load / _END_OF_TRUNK
        cable = (
            f"a cable may pull with {aside:g} N to a side and {down:g} N down at an end of the trunk (standard deviations, "
            "within the intervals)"
        )
        said = (cable if aside or down else "no cable pulls at the robot or hangs from it",)
        trusted = f"masses of the legs are the file's to {_TRUSTED_MASS:.0%}, their CoMs and lengths exactly"
        legs = self.leg_prior if self.prior_run is None else self.prior_run.leg_prior
        said = said if legs == "wide" else (*said, trusted)
        return (
            said
            if self.prior_run is None
            else (*said, f"sensors, legs and friction are those of {self.prior_run.name}")
        )

    def duration_for(self, stance: Stance) -> float:
        """[s]."""
        return self.duration or (_BUDGET if self.prior_run is None else _BUDGET_AFTER) * stance.scale.time

    @property
    def scale(self) -> tuple[float, float] | None:
        """The scale's mass and its standard deviation [kg], or None."""
        if self.mass is None:
            return None
        return self.mass, self.mass_std or (SCALE_NOISE if self._same_scale else SCALE_GAIN) * self.mass
