"""Platform of a run, from flags: a simulated robot or a real one. Parsing the flags loads neither."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Suppress
from tyro.constructors import StructConstructorSpec

from equipoise.cli import flags
from equipoise.cli.arguments import chosen
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import fields_of, spec_of
from equipoise.drivers.platforms import find_platform, given_settings
from equipoise.errors import RecordingError, SettingsError

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.robot.model import RobotModel
    from equipoise.simulation.simulation import Simulation

_FACTS = ("platform", "sim_preset", "payload", "seed", "start", "noise_seed", "contact_model")
"""Flags of a simulated robot that its provenance holds by name, besides the effects."""


@dataclass(frozen=True)
class RunTarget:
    """Platform of a run.

    Attributes:
        platform: name of a simulator or a robot's platform, or MODULE:CLASS.
    """

    platform: flags.PlatformName = flags.DEFAULT_PLATFORM

    @property
    def simulated(self) -> bool:
        """True if the robot is simulated."""
        return isinstance(self, SimulatedTarget)

    def facts(self) -> Mapping[str, Any]:
        """Return the provenance that is needed to resume a run."""
        raise NotImplementedError

    @staticmethod
    def of(folder: RunFolder) -> RunTarget:
        """Return the target of a run.

        Raises:
            RecordingError: the provenance is not sufficient to resume the run.
        """
        facts = folder.provenance
        if "platform_settings" in facts:
            return HardwareTarget(str(facts["platform"]), given=dict(facts["platform_settings"]))
        if missing := [name for name in (*_FACTS, "effects", "disabled_effects") if name not in facts]:
            raise RecordingError(
                f"the run {str(folder.path)!r} has no {missing[0]!r} in its provenance; only runs of "
                "'equipoise calibrate' can be resumed"
            )
        return SimulatedTarget(
            **{name: facts[name] for name in _FACTS},
            enable_effect=tuple(
                name if size is None else f"{name}={size!r}" for name, size in facts["effects"].items()
            ),
            disable_effect=tuple(facts["disabled_effects"]),
        )


@dataclass(frozen=True)
class SimulatedTarget(RunTarget):
    """Simulated robot. 'equipoise calibrate --platform NAME --help' shows the flags of a real robot.

    Attributes:
        start: Posture at the start and end of the run.
        seed: Seed of all random numbers.
        noise_seed: Seed of the noise only, for several runs of one robot; default --seed.
    """

    sim_preset: flags.PresetName = "realistic"
    enable_effect: flags.WithEffects = ()
    disable_effect: flags.WithoutEffects = ()
    contact_model: flags.ContactModelName = "default"
    payload: flags.PayloadGiven = None
    start: Literal["standing", "lying"] = "standing"
    seed: int = 0
    noise_seed: flags.Count = None

    def __post_init__(self) -> None:
        from equipoise.robot.scale import Scale
        from equipoise.simulation.effects import read_names, sizes_of

        # Raise early for unknown effects and for those that the engine lacks.
        disabled = read_names(self.disable_effect)
        sizes_of(self.sim_preset, Scale(1.0, 1.0), self.sizes, disabled).check_supported_by(self.platform)
        object.__setattr__(self, "disable_effect", disabled)
        if self.payload is not None:
            from equipoise.simulation.payload import Payload

            Payload.parse(self.payload)

    @property
    def sizes(self) -> dict[str, float | None]:
        """Size of each effect that is not in the preset, or has another size there."""
        from equipoise.simulation.effects import read_effects

        return read_effects(self.enable_effect)

    @property
    def world(self) -> str:
        """Description of the simulated robot's effects."""
        others = [name if size is None else f"{name} {size:g}" for name, size in self.sizes.items()]
        words = [f"preset {self.sim_preset}", *(f"with {other}" for other in others)]
        words += [f"without {name}" for name in self.disable_effect]
        return ", ".join(words + ["contact model of the file"] * (self.contact_model == "file"))

    def facts(self) -> Mapping[str, Any]:
        facts = {name: getattr(self, name) for name in _FACTS}
        return {**facts, "effects": self.sizes, "disabled_effects": list(self.disable_effect)}

    def simulate(self, robot: RobotModel) -> Simulation:
        """Return the simulation of a robot."""
        from equipoise.simulation.simulation import simulate

        return simulate(
            robot, self.sim_preset, self.payload, self.seed, self.start, engine=self.platform,  # pyright: ignore
            noise_seed=self.noise_seed, effects=self.sizes, disabled_effects=self.disable_effect,
            contact_model=self.contact_model,
        )  # fmt: skip


@dataclass(frozen=True)
class HardwareTarget(RunTarget):
    """Real robot.

    Attributes:
        set: Setting of the platform, for example interface=eth0. May be repeated.
        settings: TOML file with settings of the platform.
        yes: Start without confirmation.
    """

    set: flags.SettingsGiven = ()
    settings: flags.SettingsFile = None
    yes: flags.Flag = False
    given: Suppress[Mapping[str, Any]] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        find_platform(self.platform)  # raises for an unknown platform
        object.__setattr__(self, "given", {**self.given, **given_settings(self.set, self.settings)})

    def facts(self) -> Mapping[str, Any]:
        return {"platform": self.platform, "platform_settings": dict(self.given)}


def target_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of a simulated robot or of a real one; raises SettingsError for an unknown platform."""
    platform = chosen(arguments, "--platform", flags.DEFAULT_PLATFORM)
    find_platform(platform)
    kind = SimulatedTarget if flags.is_simulated(platform) else HardwareTarget
    return spec_of(kind.__doc__ or "", fields_of(kind), lambda values: kind(**values))


def refuse_other_target(flag: str, arguments: Sequence[str]) -> None:
    """Raise SettingsError for a simulator flag on a real robot, or a robot flag on a simulator."""
    platform = chosen(arguments, "--platform", flags.DEFAULT_PLATFORM)
    kind, other = ("real robots", HardwareTarget) if flags.is_simulated(platform) else ("simulators", SimulatedTarget)
    if flag in {setting.name for setting in fields_of(other)}:
        raise SettingsError(f"--{flag.replace('_', '-')} is for {kind}; {platform} is not")


TARGET_FLAGS: ChosenFlags = (target_flags, refuse_other_target)
"""Flags of a parameter of type `RunTarget`; they depend on `--platform`."""
