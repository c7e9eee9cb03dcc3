"""The configurations that have a name, and those of files: each is checked when it is built."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from runtime.errors import InputError
from train.network.config import Restart, TrainConfig
from train.paper.config import PaperConfig

AnyConfig = TrainConfig | PaperConfig
"""A configuration of the network, or of the paper's own."""

MIX = {
    "spline_acceleration": 0.31,
    "spline_position": 0.08,
    "moves": 0.11,
    "strokes": 0.11,
    "creeps": 0.03,
    "loops": 0.25,
    "drawings": 0.18,
}
"""The mix of commands that people give, with much of what is fast, curved, and has corners, as letters have."""

CONFIGURATIONS: dict[str, AnyConfig] = {
    "default": TrainConfig(
        name="default",
        families=MIX,
        level=0.47,
        units=384,
        epochs=290,
        eased=0.035,
        disturbed_from=0.14,
        asked_from=0.23,
        restarts=(
            Restart(after=0.48, learning_rate=1.2e-3, gamma=0.1, robust=0.07),
            Restart(after=0.72, learning_rate=8e-4, gamma=0.06, robust=0.035),
        ),
        trajectories=16_384,
        batch=128,
        optimizer="muon",
        learning_rate=2e-3,
        final_learning_rate=4e-6,
        threads=1,
    ),
    "smoke": TrainConfig(
        name="smoke",
        families=MIX,
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
    "paper": PaperConfig(
        name="paper",
        units=1024,
        trajectories=8192,
        batch=64,
        final_learning_rate=1e-3,
        average=0.0,
    ),
}
"""Configurations by name; any other comes from a JSON file."""


def read_config(values: object) -> AnyConfig:
    """Return the configuration with these values: of the paper's network if they say so.

    Raises:
        ValidationError: they are not those of a configuration.
    """
    paper = isinstance(values, dict) and values.get("network") == "paper"
    return (PaperConfig if paper else TrainConfig).model_validate(values)


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


def _first_problem(error: ValidationError) -> str:
    problem = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    return f"{where}: {message}, got {problem['input']!r}" if where else message
