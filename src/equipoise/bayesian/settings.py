"""Settings of the Bayesian method, and the priors that follow from them."""

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

_BUDGET, _BUDGET_AFTER = 120.0, 30.0  # [s] on an A1: without and with a prior run
_LONGEST = 3600.0  # [s]
_FINEST, _COARSEST = 1e-4, 500.0  # [kg]
# Factors on the priors of `_OF_CABLE`: external force, hanging load, tether stiffness.
_CABLES = {"none": (0.0, 0.0, 0.0), "light": (1.0, 1.0, 1.0), "heavy": (5.0, 10.0, 2.0)}
_END_OF_TRUNK = 0.4  # hip heights ahead of the base's origin, or behind
_SURFACES = {"hard": 1.0, "carpet": 3.0}  # factors on the priors of `_OF_SURFACE`
_OF_CABLE = ("external_force", "hanging_load", "tether_stiffness")
_OF_SURFACE = ("rolling_resistance", "foot_compliance", "floor_warp", "foothold_change")
_OF_LEGS = (
    "leg_mass_common", "link_com", "link_com_common", "link_length", "link_length_common", "hip_position", "foot_radius_each",
)  # fmt: skip
_NARROW_LEG_MASS = 0.03  # std as a fraction
_WIDER_LENGTHS = 2.0  # factor on the prior of estimated leg lengths: 1.5 mm on an A1


@dataclass(frozen=True)
class BayesianSettings:
    """Settings of the Bayesian method, and the priors that follow from them.

    Attributes:
        duration: robot time [s], as 60s or 2min; default 120 s on an A1, 30 s with a prior run, more on larger robots.
        mass: mass of the whole robot, from a scale [kg]; default: estimated from joint torques.
        mass_std: standard deviation of that mass [kg]; default 0.5 %.
        confirm_mass: accept a mass that disagrees with the joint torques by more than 15 %, or 5 % with the torque
            constants of a prior run; by default the command asks before it lifts a foot. The result is doubtful.
        excitation: excitation about all axes at the end, which improves friction and Izz.
        rotate_halfway: pause half-way with damped joints, for you to turn the robot by 180 deg; this separates external
            forces, an uneven floor and the accelerometer bias from the planar CoM.
        surface: floor; `carpet` widens the priors of rolling resistance, foot compliance and unevenness three times.
        goals: standard deviations at which the calibration may stop early.
        cable: cable on the robot, `light` as an Ethernet cable; `none` reduces the uncertainty of the planar CoM.
        leg_prior: prior of the legs; `narrow` takes masses within 3 % and CoMs and lengths exactly from the model file,
            which reduces the uncertainty of the CoM's height and the inertia.
        priors: priors of the parameters; a TOML file of standard deviations by name.
        prior_run: run folder of an earlier run of the same robot, whose sensors, legs and friction are reused. The CoM
            then takes half a minute (30 s on an A1); parameters that changed since are reported.
        relative_mass: the mass is known relative to that of the prior run, whose error it shares; set by `payload --bare-log`.
        swings: lifts in which the two lifted feet swing, which determine masses, CoMs and lengths of the legs and
            improve the CoM's height and the inertia.
    """

    summary: ClassVar[str] = (
        "the robot lifts two diagonal feet in many postures, at rest and rotating its body, and measures how it tips; mass, "
        "3-D centre of mass and inertia with intervals; sensors are calibrated too"
    )
    estimate_only: ClassVar[tuple[str, ...]] = (
        "mass", "mass_std", "cable", "leg_prior", "surface", "priors", "prior_run",
    )  # fmt: skip

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
    relative_mass: bool = field(default=False, metadata={"flag": False})
    swings: bool = field(default=False, metadata={"flag": False})  # set by `--parameters legs`
    confirm_mass: bool = False

    def __post_init__(self) -> None:
        if self.duration is not None and not 0.0 < self.duration <= _LONGEST:  # the minimum depends on the robot's plan
            raise SettingsError(f"duration is {self.duration:g} s; it must be above zero, up to {_LONGEST:g} s")
        if self.mass_std is not None and not _FINEST <= self.mass_std <= _COARSEST:
            raise SettingsError(
                f"the standard deviation of the scale's mass is {self.mass_std:g} kg; it must be from {_FINEST:g} to "
                f"{_COARSEST:g} kg"
            )
        if self.mass is not None:
            check_mass(self.mass, self.mass_std)
        if self.mass_std is not None and self.mass is None:
            raise SettingsError("mass_std is given without a mass; give both or neither")
        if self.confirm_mass and self.mass is None:
            raise SettingsError("confirm_mass is given without a mass; give a mass, or omit confirm_mass")
        for name, allowed in (("cable", _CABLES), ("leg_prior", ("wide", "narrow")), ("surface", _SURFACES)):
            if getattr(self, name) not in allowed:
                raise SettingsError(f"{name} is {getattr(self, name)!r}; it must be {' or '.join(allowed)}")
        if self.prior_run is not None and self.rotate_halfway:
            raise SettingsError("rotate_halfway cannot be combined with a prior run; omit one of them")
        if self.swings and (self.prior_run is not None or self.leg_prior == "narrow"):
            other = "a prior run" if self.prior_run is not None else "leg_prior 'narrow'"
            raise SettingsError(f"legs cannot be estimated with {other}; omit one of them")
        if self.prior_run is not None and self.leg_prior not in ("wide", self.prior_run.leg_prior):
            raise SettingsError(
                f"leg_prior is {self.leg_prior!r}, but {self.prior_run.leg_prior!r} in the prior run, whose legs are used"
            )

    @property
    def combined_priors(self) -> Priors:
        """Priors for the chosen cable, surface, rotation and legs, with those that a prior run determines."""
        chosen = self._chosen_priors
        return chosen if self.prior_run is None else self.prior_run.priors_of(chosen, self._same_scale)

    @property
    def _same_scale(self) -> bool:
        """True if the scale is assumed to be that of the prior run; a given `mass_std` means another scale."""
        if self.prior_run is None:
            return False
        return self.relative_mass or (None not in (self.prior_run.weighed, self.mass) and self.mass_std is None)

    @property
    def _chosen_priors(self) -> Priors:
        """Priors for the chosen cable, surface, rotation and legs."""
        wider = dict.fromkeys(_OF_SURFACE, _SURFACES[self.surface]) | dict(
            zip(_OF_CABLE, _CABLES[self.cable], strict=True)
        )
        priors = replace(self.priors, **{name: factor * getattr(self.priors, name) for name, factor in wider.items()})
        if not self.rotate_halfway:
            priors = priors.holding("foothold_change")
        if self.swings:  # estimated legs may differ more from the model file
            priors = replace(priors, link_length=_WIDER_LENGTHS * priors.link_length)
        if self.leg_prior == "wide":
            return priors
        return replace(priors.holding(*_OF_LEGS), leg_mass=min(_NARROW_LEG_MASS, priors.leg_mass))

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions on cable, legs and sensors that no motion of a run can test."""
        priors = self._chosen_priors
        sideways, down = priors.external_force, priors.hanging_load / _END_OF_TRUNK
        cable = (
            f"a cable may pull with {sideways:g} N sideways and {down:g} N down at an end of the trunk (standard deviations, "
            "included in the intervals)"
        )
        assumed = (cable if sideways or down else "no cable is attached to the robot",)
        if (self.leg_prior if self.prior_run is None else self.prior_run.leg_prior) == "narrow":
            narrow = (
                f"masses of the legs are within {_NARROW_LEG_MASS:.0%} of the model file, their CoMs and lengths exact"
            )
            assumed = (*assumed, narrow)
        if self.prior_run is None:
            return assumed
        return (*assumed, f"sensors, legs and friction are those of {self.prior_run.name}")

    def duration_for(self, stance: Stance) -> float:
        """Return the given duration, or the default for the stance's size [s]."""
        return self.duration or (_BUDGET if self.prior_run is None else _BUDGET_AFTER) * stance.scale.time

    @property
    def scale(self) -> tuple[float, float] | None:
        """Mass from the scale and its standard deviation [kg], or None."""
        if self.mass is None:
            return None
        return self.mass, self.mass_std or (SCALE_NOISE if self._same_scale else SCALE_GAIN) * self.mass
