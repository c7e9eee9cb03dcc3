"""The graphs of a network for every pan do what the network does."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
import torch

from export.general_graphs import OBSERVED, general_decoder_step_graph, general_encoder_graph
from runtime.network.onnx_check import check_graph
from runtime.network.units import AHEAD, AHEAD_ROWS, CHUNK, ENCODER_CHUNK, ENCODER_ROWS, SEEN_ROWS, Situation
from train.general.network import GeneralNetwork, Told, observe


@pytest.mark.parametrize("height", [0.0, 0.1])
def test_graphs_do_what_the_network_does(height):
    torch.manual_seed(0)
    network, rng, batch = GeneralNetwork(24, features=20), np.random.default_rng(0), 3
    with torch.no_grad():
        network.output.weight *= 20.0  # so that the bounds are met
    graphs = general_encoder_graph(network), general_decoder_step_graph(network)
    for graph in graphs:
        check_graph(graph)
    encoder, decoder = (onnxruntime.InferenceSession(graph) for graph in graphs)
    situation = Situation(*(np.full(batch, part) for part in (15.0, 5_000.0, 2.0, height, 0.5, 0.3, 1.0)))
    told = Told.of(situation)

    command = rng.normal(0, 0.05, (batch, 2 * ENCODER_CHUNK, 4))
    rows = command.reshape(batch, 2, ENCODER_CHUNK, 4)[:, :, list(ENCODER_ROWS)].reshape(batch, 2, -1)
    conditions = situation.conditions()
    fed = np.concatenate([rows, np.repeat(conditions[:, None], 2, axis=1)], axis=2).astype(np.float32)
    hidden, cell = encoder.run(None, {"command": fed})
    with torch.no_grad():
        state = network.encode(torch.from_numpy(command), told)
    np.testing.assert_allclose(hidden, state.hidden, atol=1e-5)
    np.testing.assert_allclose(cell, state.cell, atol=1e-5)

    states, ahead, last = (rng.normal(0, 0.1, (batch, *shape)) for shape in ((CHUNK, 10), (AHEAD, 4), (3,)))
    here = np.concatenate([ahead[:, :1, :2], np.zeros((batch, 1, 2))], axis=2)
    seen = states[:, list(SEEN_ROWS)] - np.concatenate([np.zeros((batch, 1, 6)), here], axis=2)
    later = ahead[:, list(AHEAD_ROWS)] - here
    parts = [seen.reshape(batch, -1), last, later.reshape(batch, -1), conditions, np.full((batch, 1), 0.5)]
    observation = np.concatenate(parts, axis=1).astype(np.float32)
    assert observation.shape == (batch, OBSERVED)
    bounds = np.stack([situation.floor, situation.lift], axis=1).astype(np.float32)
    found = decoder.run(None, {"observation": observation, "bounds": bounds, "hidden": hidden, "cell": cell})
    with torch.no_grad():
        tensors = [torch.from_numpy(part) for part in (states, ahead, last)]
        wanted, after = network.step(observe(tensors[0], tensors[1], tensors[2], told, 0.5), told, state)
    np.testing.assert_allclose(found[0], wanted, atol=2e-4)
    np.testing.assert_allclose(found[1], after.hidden, atol=1e-5)
    np.testing.assert_allclose(found[2], after.cell, atol=1e-5)
    assert np.linalg.norm(found[0], axis=-1).max() > 20.0
    assert bool(found[0][..., 2].any()) == (height > 0.0)
