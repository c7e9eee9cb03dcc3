"""What the tests of the export begin with."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from train.config import load_config
from train.learn.trainer import Trainer


@pytest.fixture(scope="package")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained run whose answers are large enough to slide the object; nobody writes into it."""
    folder = tmp_path_factory.mktemp("run")
    trainer = Trainer(load_config("smoke"), folder)
    with torch.no_grad():
        trainer.evaluated_model().output.weight *= 20
    trainer.save()
    return folder
