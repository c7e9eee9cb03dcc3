"""Which recipe a configuration asks for."""

from __future__ import annotations

from train.config import AnyConfig
from train.learn.recipe import Recipe
from train.network.recipe import NetworkRecipe
from train.paper.config import PaperConfig
from train.paper.recipe import PaperRecipe


def recipe_of(config: AnyConfig) -> Recipe:
    """Return how a configuration is trained."""
    return PaperRecipe(config) if isinstance(config, PaperConfig) else NetworkRecipe(config)
