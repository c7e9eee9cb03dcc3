"""What a run is told that trains the network."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator

from runtime.network.units import ENCODER_CHUNK
from train.commands.families import FAMILIES
from train.run_config import Count, NonNegative, Positive, Range, RunConfig, Share, check_ranges

GROUPS = 8
"""Parts of a batch that are drawn by themselves: a process draws those that are its own, whoever draws the others."""

RANGES = ("samples", "reach", "far", "speed", "pan_reach", "acceleration", "strength", "jerk", "pan_speed", "height",
          "static", "kinetic", "noise")  # fmt: skip
"""Pairs of which the first is the lowest and the second the highest."""


class Restart(BaseModel):
    """A later part of a run: the learning rate rises and falls once more, at other prices."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    after: Share = Field(description="share of the run after which it begins")
    learning_rate: Positive
    gamma: NonNegative
    robust: NonNegative


class TrainConfig(RunConfig):
    """The network in the law's units, told the limits of each pan.

    What pans and their objects are is in SI: reach, acceleration, jerk, speed, height, friction. All else is in the
    network's units, in which every pan has a reach of 0.2 and an acceleration limit of 25 (`runtime.network.units`), so
    that it reads as metres and seconds of a usual pan. Ranges are (lowest, highest).
    """

    features: Count = Field(384, description="units of the decoder's tanh layer")

    warm_up: Count = Field(50, description="steps in which the learning rate comes to its own")
    restarts: tuple[Restart, ...] = Field((), description="parts of the run after the first, in their order")
    eased: Share = Field(0.08, description="share of the run in which friction grows from a twentieth to all of it")
    disturbed_from: Share = Field(0.3, description="share of the run after which trajectories are disturbed")
    asked_from: Share = Field(0.5, description="share of the run after which decoders are asked early")

    beta: NonNegative = Field(2000.0, description="price of being out of reach, height or speed (a metre or 10 m/s)")
    gamma: NonNegative = Field(0.25, description="price of the mean change of acceleration (a m/s^2)")
    jerk_price: NonNegative = Field(4.0, description="price of its change beyond the jerk limit (a m/s^2)")
    robust: NonNegative = Field(0.25, description="price of the error under other friction, over that of the error")
    off: Share = Field(0.1, description="share by which that friction is off")
    braking: Positive = Field(15.0, description="what the pan must be able to stop in reach with")

    samples: tuple[Count, Count] = Field((256, 1536), description="lengths of the trajectories")
    families: dict[str, NonNegative] = Field(description="weights of the families of free commands")
    reach: Range = Field((0.015, 0.16), description="largest distance of a command from its start")
    far: Range = Field((0.1, 0.3), description="the same of those that go far")
    far_share: Share = 0.15
    speed: Range = Field((0.12, 1.1), description="bounds on the speed of a command")

    level: Share = Field(0.4, description="share of pans that do not lift")
    pan_reach: Range = Field((0.02, 0.4), description="of pans (m)")
    usual_reach: Share = Field(0.4, description="share of those with 0.2 m")
    acceleration: Range = Field((2.0, 40.0), description="of pans (m/s^2)")
    strength: Range = Field((6.0, 36.0), description="of most pans (m/s^2)")
    most: Share = Field(0.75, description="how many these are")
    jerk: Range = Field((500.0, 20_000.0), description="of pans (m/s^3)")
    rise: Range = Field((100.0, 1_200.0), description="jerk over acceleration (1/s)")
    pan_speed: Range = Field((0.5, 3.0), description="of pans that have a limit (m/s)")
    any_speed: Share = Field(0.5, description="share of those that have none")
    height: Range = Field((0.01, 0.2), description="of pans that lift (m)")
    usual_height: Share = Field(0.6, description="share of those with 0.1 m")

    static: Range = Field((0.05, 1.5), description="static friction")
    kinetic: Range = Field((0.4, 1.0), description="kinetic over static friction")
    nominal: Share = Field(0.25, description="share of objects with 1.0/0.5, where the pan is strong enough")
    drive: Share = Field(0.88, description="largest share of its acceleration that a pan needs to break an object away")
    told: Share = Field(0.75, description="share of trajectories whose friction the network is told")

    displaced: Share = Field(0.15, description="share of trajectories that begin elsewhere than at rest on their mark")
    start_reach: Positive = Field(0.16, description="how far from the centre their pan is at most")
    start_speed: NonNegative = Field(0.2, description="standard deviation of its velocity")
    pushed: Share = Field(0.2, description="share of trajectories whose object is pushed once")
    push: NonNegative = Field(0.012, description="standard deviation of how far")
    push_speed: NonNegative = Field(0.1, description="and of its velocity, if it then slides")
    noisy: Share = Field(0.12, description="share of trajectories whose states are seen with noise")
    noise: Range = Field((1e-3, 1e-2), description="its standard deviation: of positions, of velocities")
    asked: Share = Field(0.35, description="share of steps in which the decoder is asked before its chunk has ended")
    reread: Share = Field(0.3, description="share of steps in which the encoder reads anew on the way")

    def at(self, progress: float) -> TrainConfig:
        """Return the configuration in force after this share of the run."""
        begun = [restart for restart in self.restarts if restart.after <= progress]
        return self.model_copy(update=begun[-1].model_dump(exclude={"after"})) if begun else self

    @model_validator(mode="after")
    def _consistent(self) -> TrainConfig:
        check_ranges(self, *RANGES)
        if any(samples % ENCODER_CHUNK for samples in self.samples):
            raise ValueError(f"samples: {self.samples[0]}, {self.samples[1]} must be multiples of {ENCODER_CHUNK}")
        if self.kinetic[1] > 1.0:
            raise ValueError(f"kinetic: {self.kinetic[1]:g} times the static friction exceeds it")
        if self.batch % GROUPS:
            raise ValueError(f"batch: {self.batch} trajectories are not {GROUPS} equal parts")
        after = [restart.after for restart in self.restarts]
        if after != sorted(set(after)):
            raise ValueError(
                f"restarts: each must be after the one before, got {', '.join(f'{each:g}' for each in after)}"
            )
        unknown = sorted(set(self.families) - set(FAMILIES))
        if unknown:
            raise ValueError(f"families: unknown {', '.join(unknown)}; known are {', '.join(FAMILIES)}")
        if sum(self.families.values()) <= 0:
            raise ValueError("families: at least one weight must be positive")
        return self
