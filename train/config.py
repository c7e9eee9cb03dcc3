"""What a training run is told: one model, checked when it is built, and the configurations that have a name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, TypeAdapter, ValidationError, model_validator

from runtime.errors import InputError
from train.commands.families import FAMILIES
from train.curriculum import CURRICULA, Model
from train.general.config import GeneralConfig
from train.run_config import Count, NonNegative, Positive, Range, RunConfig, Share

Tracking = Literal["likelihood", "distance", "rms"]

RANGES = ("samples", "lead_in_chunks", "reach", "physics_reach", "physics_knots", "static_range", "kinetic_range")
"""Pairs of which the first is the lowest and the second the highest."""


class TrainConfig(RunConfig):
    """A network in SI units for one pan, the paper's or one like it; lengths are in samples of 1 ms."""

    network: Literal["one-pan"] = "one-pan"
    model: Model = Field("A", description="model A, B or C of Section V-B")
    curriculum: Literal["table-1", "gradual", "mid-course"] = "gradual"
    chunk: Count = Field(100, description="samples per encoder and decoder iteration, C")
    command_ahead: int = Field(2, ge=0, description="command chunks in the decoder's input; 0 in the paper")
    acceleration_bound: Positive | None = Field(30.0, description="bound on |u| inside the network (m/s^2)")

    tracking: Tracking = Field(
        "distance", description="of L: Eq. 22, distance in mm, or its root mean square over each trajectory"
    )
    alpha: Positive = Field(1.0, description="weight of the tracking loss, Eq. 22")
    beta: NonNegative = Field(2000.0, description="weight of the pan limit, Eq. 23")
    gamma: NonNegative = Field(0.1, description="weight of the change of acceleration, Eq. 24")
    late_gamma: NonNegative | None = Field(None, description="gamma in the late stages; None: the same")
    jerk: NonNegative = Field(0.0, description="weight of jerk beyond jerk_limit, on top of gamma")
    jerk_limit: Positive = Field(8_000.0, description="jerk that is free of that (m/s^3)")
    pan_limit: Positive = Field(0.2, description="limit of the pan's motion (m)")
    pan_margin: NonNegative = Field(0.01, description="distance from the limit at which the penalty begins (m)")
    braking: NonNegative = Field(0.0, description="what it must be able to stop there with (m/s^2); 0: be there at all")

    samples: tuple[Count, Count] = Field((300, 1500), description="lengths of the trajectories")
    shorten: bool = Field(True, description="let half of the free commands end within their last chunk")
    families: dict[str, NonNegative] = Field(description="weights of the families of free commands")
    reach: Range = Field((0.01, 0.15), description="largest distance of a free command from its start (m)")
    speed: Positive = Field(0.7, description="bound on the speed of a free command (m/s)")
    physics_reach: Range = Field((0.03, 0.15), description="the same for physics-generated commands (m)")
    physics_knots: Range = Field((0.15, 0.4), description="spacing of their knots (s)")
    lead_in: Share = Field(0.0, description="share of disturbed batches that begin in mid-course")
    lead_in_chunks: tuple[Count, Count] = Field((1, 8), description="how far into the command that is")
    displaced: Share = Field(0.0, description="share of disturbed trajectories that begin off their mark")
    start_reach: Positive = Field(0.15, description="how far from the centre their pan is at most (m)")
    start_speed: Positive = Field(0.2, description="standard deviation of its velocity (m/s)")
    push: Positive = Field(0.01, description="standard deviation of the object's distance from its mark (m)")
    push_speed: Positive = Field(0.1, description="and of its velocity, if it slides (m/s)")
    noisy: Share = Field(0.0, description="share of disturbed trajectories whose states are seen with noise")
    noise: Range = Field((1e-3, 1e-2), description="its standard deviation: of positions (m), of velocities (m/s)")
    static: Positive = Field(1.0, description="nominal static friction")
    kinetic: Positive = Field(0.5, description="nominal kinetic friction")
    static_range: Range = Field((0.4, 1.5), description="of stages that vary friction")
    kinetic_range: Range = Field((0.2, 0.8), description="of stages that vary friction, up to the static one")
    nominal: Share = Field(0.0, description="share of trajectories that have the nominal friction all the same")

    @property
    def disturbs(self) -> bool:
        """Whether there is anything that the curriculum's disturbed stages would disturb trajectories by."""
        return self.lead_in > 0.0 or self.displaced > 0.0 or self.noisy > 0.0

    @model_validator(mode="after")
    def _consistent(self) -> TrainConfig:
        for key in RANGES:
            low, high = getattr(self, key)
            if low > high:
                raise ValueError(f"{key}: the lowest, {low:g}, exceeds the highest, {high:g}")
        if self.samples[0] < self.chunk:
            raise ValueError(f"samples: {self.samples[0]} is shorter than a chunk of {self.chunk}")
        if self.model != "A" and not trains_from_scratch(self):
            raise ValueError(f"model: {self.model} is trained from scratch, which curriculum {self.curriculum} is not")
        if self.pan_margin >= self.pan_limit:
            raise ValueError(
                f"pan_margin: {self.pan_margin:g} m leaves nothing of the pan_limit of {self.pan_limit:g} m"
            )
        if self.kinetic > self.static:
            raise ValueError(f"kinetic: {self.kinetic:g} exceeds static, {self.static:g}")
        if self.kinetic_range[0] > self.static_range[0]:
            raise ValueError(f"kinetic_range: its lowest, {self.kinetic_range[0]:g}, exceeds that of static_range")
        unknown = sorted(set(self.families) - set(FAMILIES))
        if unknown:
            raise ValueError(f"families: unknown {', '.join(unknown)}; known are {', '.join(FAMILIES)}")
        if sum(self.families.values()) <= 0:
            raise ValueError("families: at least one weight must be positive")
        if self.batch > self.trajectories:
            raise ValueError(f"batch: {self.batch} exceeds the {self.trajectories} trajectories of an epoch")
        assert self.curriculum in CURRICULA
        return self


AnyConfig = TrainConfig | GeneralConfig
"""A configuration of either kind."""

BROAD = {
    "spline_acceleration": 0.3,
    "spline_position": 0.15,
    "moves": 0.15,
    "strokes": 0.05,
    "creeps": 0.05,
    "loops": 0.15,
    "drawings": 0.15,
}
"""The mix of commands that people give."""

FASTER = {
    "spline_acceleration": 0.32,
    "spline_position": 0.1,
    "moves": 0.12,
    "strokes": 0.1,
    "creeps": 0.03,
    "loops": 0.15,
    "drawings": 0.18,
}
"""The same with more of what is fast and has corners, as letters have."""

ONE_PAN: dict[str, TrainConfig] = {
    "base": TrainConfig(
        name="base",
        families=BROAD,
        optimizer="muon",
        learning_rate=1.5e-3,
        tracking="rms",
        gamma=0.12,
        pan_margin=0.005,
        braking=20.0,
        jerk=1.0,
        speed=1.0,
        nominal=0.2,
    ),
    "default": TrainConfig(
        name="default",
        families=FASTER,
        units=384,
        curriculum="mid-course",
        epochs=150,
        optimizer="muon",
        learning_rate=1.2e-3,
        final_learning_rate=5e-6,
        tracking="rms",
        gamma=0.2,
        late_gamma=0.5,
        pan_margin=0.005,
        braking=20.0,
        jerk=1.5,
        jerk_limit=5_000.0,
        speed=1.1,
        lead_in=0.3,
        lead_in_chunks=(1, 12),
        displaced=0.15,
        start_reach=0.17,
        noisy=0.15,
        nominal=0.35,
        threads=1,
    ),
    "smoke": TrainConfig(
        name="smoke",
        families=BROAD,
        units=16,
        epochs=10,
        trajectories=16,
        batch=8,
        samples=(200, 400),
        threads=1,
        average=0.9,
        precision="float32",
    ),
    "paper": TrainConfig(
        name="paper",
        families={"spline_acceleration": 1.0},
        curriculum="table-1",
        tracking="likelihood",
        units=1024,
        command_ahead=0,
        acceleration_bound=None,
        trajectories=8192,
        batch=64,
        final_learning_rate=1e-3,
        average=0.0,
        beta=10.0,
        gamma=1.0,
        pan_margin=0.0,
        samples=(500, 1500),
        reach=(0.03, 0.15),
        shorten=False,
        static_range=(1.0, 1.0),
        kinetic_range=(0.5, 0.5),
    ),
}
"""Configurations of networks for one pan, by name."""

GENERAL: dict[str, GeneralConfig] = {
    "general": GeneralConfig(
        name="general",
        families=FASTER | {"loops": 0.2, "strokes": 0.12},
        level=0.45,
        units=384,
        epochs=100,
        trajectories=16_384,
        batch=128,
        optimizer="muon",
        learning_rate=2e-3,
        final_learning_rate=5e-6,
        threads=1,
    ),
    "general_smoke": GeneralConfig(
        name="general_smoke",
        families=BROAD,
        units=16,
        epochs=10,
        trajectories=32,
        batch=16,
        samples=(256, 384),
        optimizer="muon",
        threads=1,
        average=0.9,
        precision="float32",
    ),
}
"""Those of networks for every pan."""

CONFIGURATIONS: dict[str, AnyConfig] = {**ONE_PAN, **GENERAL}
"""Configurations by name; any other comes from a JSON file."""


def trains_from_scratch(config: AnyConfig) -> bool:
    """Return whether the configuration's curriculum begins with stage 1, or goes on from a network that is trained."""
    return isinstance(config, GeneralConfig) or CURRICULA[config.curriculum][0].number == 1


def read_config(values: object) -> AnyConfig:
    """Return the configuration with these values, of the kind that its `network` names: one-pan if it names none.

    Raises:
        ValidationError: they are not those of a configuration.
    """
    general = isinstance(values, dict) and values.get("network") == "general"
    return (GeneralConfig if general else TrainConfig).model_validate(values)


def load_config(source: str, **changes: object) -> AnyConfig:
    """Return the configuration named `source`, or that of the JSON file `source`, with `changes` applied.

    Raises:
        InputError: no such name or file, not JSON, an unknown key, or a value out of its range; the key is named.
    """
    try:
        if source in CONFIGURATIONS:
            values = CONFIGURATIONS[source].model_dump()
        elif source.endswith(".json"):
            values = read_config(TypeAdapter(Any).validate_json(Path(source).read_bytes())).model_dump()
        else:
            raise InputError(
                f"unknown configuration {source!r}: known are {', '.join(CONFIGURATIONS)}, or a .json file"
            )
        return read_config(values | {k: v for k, v in changes.items() if v is not None})
    except ValidationError as error:
        raise InputError(f"configuration {source}: {_first_problem(error)}") from None
    except OSError as error:
        raise InputError(f"configuration {source}: {os.strerror(error.errno or 0)}") from None


def load_one_pan(source: str, **changes: object) -> TrainConfig:
    """Return a configuration of a network for one pan, as `load_config` does.

    Raises:
        InputError: as `load_config`, or it is one of a network for every pan.
    """
    config = load_config(source, **changes)
    if not isinstance(config, TrainConfig):
        raise InputError(f"configuration {source}: it is of a network for every pan; give one for one pan")
    return config


def _first_problem(error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    return f"{where}: {message}, got {problem['input']!r}" if where else message
