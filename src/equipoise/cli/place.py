"""Platform that a run happens on, as flags name it: a simulated robot or a real one. Reading the flags loads neither."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Suppress
from tyro.constructors import StructConstructorSpec

from equipoise.cli import flags
from equipoise.cli.parsing import ChosenFlags
from equipoise.cli.setting_flags import fields_of, spec_of
from equipoise.cli.words import chosen
from equipoise.drivers.platforms import find_platform, given_settings
from equipoise.errors import RecordingError, SettingsError

if TYPE_CHECKING:
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.robot.model import RobotModel
    from equipoise.simulation.simulation import Simulation

_NAMES = {"effects": "with"}  # flags of fields with another name


@dataclass(frozen=True)
class Place:
    """Platform that a run happens on.

    Attributes:
        platform: name of a simulator or a robot's platform, or MODULE:CLASS.
    """

    platform: flags.PlatformName = flags.DEFAULT_PLATFORM

    @property
    def simulated(self) -> bool:
        """Whether the robot is simulated."""
        return isinstance(self, SimulatedPlace)

    def facts(self) -> Mapping[str, Any]:
        """Return provenance of a run, enough to resume it."""
        raise NotImplementedError

    def again(self, number: int) -> Place:
        """Return the place of a repetition: a simulated robot has the same errors and other noise."""
        del number
        return self

    @staticmethod
    def of(folder: RunFolder) -> Place:
        """Return the place of a run.

        Raises:
            RecordingError: its provenance is not enough to resume it.
        """
        facts = folder.provenance
        if "platform_settings" in facts:
            return RealPlace(str(facts["platform"]), given=dict(facts["platform_settings"]))
        names = ("platform", "noise", "payload", "seed", "start")
        if missing := [name for name in names if name not in facts]:
            raise RecordingError(
                f"the run {str(folder.path)!r} does not say its {missing[0]}; runs of 'equipoise calibrate' can be resumed"
            )
        effects = facts.get("effects", {}).items()
        return SimulatedPlace(
            **{name: facts[name] for name in names}, noise_seed=facts.get("noise_seed"),
            effects=tuple(name if size is None else f"{name}={size!r}" for name, size in effects),
            without=tuple(facts.get("without", ())), contacts=facts.get("contacts", "own"),
        )  # fmt: skip


@dataclass(frozen=True)
class SimulatedPlace(Place):
    """The simulated robot. 'equipoise calibrate --platform NAME --help' shows the flags of a real one.

    Attributes:
        start: How the simulated robot begins (and ends).
        seed: Of everything drawn.
        noise_seed: Of the noise alone, for several runs of one robot; default as --seed.
    """

    noise: flags.NoiseName = "realistic"
    effects: flags.WithEffects = ()
    without: flags.WithoutEffects = ()
    contacts: flags.ContactsName = "own"
    payload: flags.PayloadGiven = None
    start: Literal["standing", "lying"] = "standing"
    seed: int = 0
    noise_seed: flags.Count = None

    def __post_init__(self) -> None:
        from equipoise.robot.scale import Scale
        from equipoise.simulation.effects import read_names, sizes_of

        # Before anything takes long: what there is not, and what the engine cannot have.
        without = read_names(self.without)
        sizes_of(self.noise, Scale(1.0, 1.0), self.sizes, without).refuse_what_lacks(self.platform)
        object.__setattr__(self, "without", without)
        if self.payload is not None:
            from equipoise.simulation.payload import Payload

            Payload.parse(self.payload)

    @property
    def sizes(self) -> dict[str, float | None]:
        """Size of each effect that the preset has not, or has in another size."""
        from equipoise.simulation.effects import read_effects

        return read_effects(self.effects)

    @property
    def world(self) -> str:
        """The simulated robot's effects in words."""
        others = [name if size is None else f"{name} {size:g}" for name, size in self.sizes.items()]
        words = [f"noise {self.noise}", *(f"with {other}" for other in others), *(f"without {n}" for n in self.without)]
        return ", ".join(words + ["contacts of the file"] * (self.contacts == "file"))

    def facts(self) -> Mapping[str, Any]:
        names = ("platform", "noise", "payload", "seed", "start", "noise_seed")
        facts = {name: getattr(self, name) for name in names}
        other = {"effects": self.sizes, "without": list(self.without), "contacts": self.contacts}
        usual: dict[str, Any] = {"effects": {}, "without": [], "contacts": "own"}
        return facts | {name: value for name, value in other.items() if value != usual[name]}

    def again(self, number: int) -> SimulatedPlace:
        seed = self.seed if self.noise_seed is None else self.noise_seed
        return dataclasses.replace(self, noise_seed=seed + number) if number else self

    def simulate(self, robot: RobotModel) -> Simulation:
        """Return the simulated robot."""
        from equipoise.simulation.simulation import simulate

        return simulate(
            robot, self.noise, self.payload, self.seed, self.start, engine=self.platform,  # pyright: ignore
            noise_seed=self.noise_seed, effects=self.sizes, without=self.without, contacts=self.contacts,
        )  # fmt: skip


@dataclass(frozen=True)
class RealPlace(Place):
    """The real robot.

    Attributes:
        set: A setting of the platform, as interface=eth0; may be given again.
        settings: TOML file with settings of the platform.
        yes: Do not ask before the first motion.
    """

    set: flags.SettingsGiven = ()
    settings: flags.SettingsFile = None
    yes: flags.Flag = False
    given: Suppress[Mapping[str, Any]] = field(default_factory=dict[str, Any])

    def __post_init__(self) -> None:
        find_platform(self.platform)  # before anything is made for it
        object.__setattr__(self, "given", {**self.given, **given_settings(self.set, self.settings)})

    def facts(self) -> Mapping[str, Any]:
        return {"platform": self.platform, "platform_settings": dict(self.given)}


def place_flags(arguments: Sequence[str]) -> StructConstructorSpec:
    """Return the flags of a simulated robot or of a real one; raises SettingsError for an unknown platform."""
    platform = chosen(arguments, "--platform", flags.DEFAULT_PLATFORM)
    find_platform(platform)
    kind = SimulatedPlace if flags.is_simulated(platform) else RealPlace
    return spec_of(kind.__doc__ or "", fields_of(kind), lambda values: kind(**values))


def refuse_other_place(flag: str, arguments: Sequence[str]) -> None:
    """Raise SettingsError for a flag of simulators on a real robot, or the other way round."""
    platform = chosen(arguments, "--platform", flags.DEFAULT_PLATFORM)
    kind, other = ("real robots", RealPlace) if flags.is_simulated(platform) else ("simulators", SimulatedPlace)
    if flag in {_NAMES.get(setting.name, setting.name) for setting in fields_of(other)}:
        raise SettingsError(f"--{flag.replace('_', '-')} is for {kind}; {platform} is none")


PLACE_FLAGS: ChosenFlags = (place_flags, refuse_other_place)
"""Flags of a parameter of the type `Place`, which `--platform` chooses."""
