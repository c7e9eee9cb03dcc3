"""Which recipe a configuration asks for."""

from __future__ import annotations

from train.config import AnyConfig
from train.general.config import GeneralConfig
from train.general.recipe import GeneralRecipe
from train.learn.one_pan import OnePanRecipe
from train.learn.recipe import Recipe


def recipe_of(config: AnyConfig) -> Recipe:
    """Return how a configuration is trained."""
    return GeneralRecipe(config) if isinstance(config, GeneralConfig) else OnePanRecipe(config)
