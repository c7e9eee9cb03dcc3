"""What a run is told that trains the paper's own network."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from train.paper.curriculum import Model
from train.run_config import Count, NonNegative, Positive, Range, RunConfig, check_ranges


class PaperConfig(RunConfig):
    """The network of Section IV-A by the curriculum of Table I; SI units, lengths in samples of 1 ms."""

    network: Literal["paper"] = "paper"
    model: Model = Field("A", description="model A, B or C of Section V-B")
    chunk: Count = Field(100, description="samples per encoder and decoder iteration, C")

    alpha: Positive = Field(1.0, description="weight of the tracking loss, Eq. 22")
    beta: NonNegative = Field(10.0, description="weight of the pan limit, Eq. 23")
    gamma: NonNegative = Field(1.0, description="weight of the change of acceleration, Eq. 24")
    pan_limit: Positive = Field(0.2, description="limit of the pan's motion (m)")

    samples: tuple[Count, Count] = Field((500, 1500), description="lengths of the trajectories")
    reach: Range = Field((0.03, 0.15), description="largest distance of a command from its start (m)")
    speed: Positive = Field(0.7, description="bound on the speed of a command (m/s)")
    static: Positive = Field(1.0, description="static friction")
    kinetic: Positive = Field(0.5, description="kinetic friction")

    @model_validator(mode="after")
    def _consistent(self) -> PaperConfig:
        check_ranges(self, "samples", "reach")
        if self.samples[0] < self.chunk:
            raise ValueError(f"samples: {self.samples[0]} is shorter than a chunk of {self.chunk}")
        if self.kinetic > self.static:
            raise ValueError(f"kinetic: {self.kinetic:g} exceeds static, {self.static:g}")
        return self
