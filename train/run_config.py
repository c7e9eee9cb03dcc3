"""What every training run is told, whatever it trains."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

# These stand here, and not where they are put to use, so that a configuration is judged without loading torch.
Precision = Literal["auto", "float32", "bfloat16"]
OptimizerKind = Literal["adam", "muon"]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(gt=0)]
Workers = Annotated[int, Field(gt=0, le=64)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Range = tuple[Positive, Positive]


class RunConfig(BaseModel):
    """The network's size, how long it is trained, and by what steps.

    Equal configurations and threads give equal weights.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", description="name of the configuration and of the bundle")
    seed: int = Field(0, ge=0)

    units: Count = Field(256, description="LSTM units per layer")
    layers: Count = 2

    epochs: Count = 50
    trajectories: Count = Field(16384, description="trajectories per epoch")
    batch: Count = 128
    optimizer: OptimizerKind = Field("adam", description="adam, as in the paper, or muon for the matrices")
    learning_rate: Positive = 1e-3
    final_learning_rate: NonNegative = 1e-5
    gradient_clip: Positive = Field(1.0, description="bound on the gradient's norm")
    average: float = Field(0.998, ge=0, lt=1, description="decay of the weights' moving average per step; 0: none")
    precision: Precision = Field("auto", description="of the network's matrix products; auto: what is faster here")
    threads: Count = Field(2, description="CPU threads of each process; resuming bit for bit needs the same number")

    workers: Workers = Field(1, description="processes beside each that draw its batches; on a GPU, several keep up")

    @model_validator(mode="after")
    def _batch_fits(self) -> Self:
        if self.batch > self.trajectories:
            raise ValueError(f"batch: {self.batch} exceeds the {self.trajectories} trajectories of an epoch")
        return self


def check_ranges(config: RunConfig, *names: str) -> None:
    """Check pairs of which the first is the lowest and the second the highest.

    Raises:
        ValueError: a lowest exceeds its highest.
    """
    for name in names:
        low, high = getattr(config, name)
        if low > high:
            raise ValueError(f"{name}: the lowest, {low:g}, exceeds the highest, {high:g}")
