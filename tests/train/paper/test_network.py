"""The paper's network: what the fast decoding computes is what `nn.LSTM` would."""

from __future__ import annotations

import torch

from train.network.lstm import DecoderState
from train.paper.closed_loop import at_rest, decode
from train.paper.network import PaperNetwork
from train.physics.rollout import rollout


def coefficients(batch):
    ones = torch.ones(batch, dtype=torch.float64)
    return 1.0 * ones, 0.5 * ones


def test_fast_encoder_and_decoder_equal_nn_lstm():
    torch.manual_seed(0)
    model = PaperNetwork(units=12, chunk=10)
    command, motion = torch.randn(3, 5, 40) * 0.05, torch.randn(3, 10, 8) * 0.05
    state = model.encode(command)
    _, (hidden, cell) = model.encoder_lstm(command * model.command_scale)
    torch.testing.assert_close(state, DecoderState(hidden, cell))

    output, after = model.step(motion, state)
    top, (hidden, cell) = model.decoder_lstm((motion.flatten(1) * model.observation_scale)[None], (hidden, cell))
    torch.testing.assert_close(after, DecoderState(hidden, cell))
    torch.testing.assert_close(output.acceleration, model.read_out(top[0]).acceleration)


def test_covariances_are_positive_definite():
    model = PaperNetwork(units=8, chunk=10)
    covariance = model.read_out(torch.randn(20, 8) * 10).covariance
    assert (covariance[..., 0] * covariance[..., 2] - covariance[..., 1] ** 2).min() > 0


def test_gradient_of_the_pan_does_not_pass_the_law_of_friction_when_told_so():
    """Friction decides where the object goes; with the contact cut, the pan's gradient must not know of it."""
    torch.manual_seed(0)
    model = PaperNetwork(units=8, chunk=10)
    with torch.no_grad():
        model.output.bias[:20] = 1.5  # 15 m/s^2: the object slides, so that there is something to pass
    command = torch.randn(2, 40, 4, dtype=torch.float64) * 0.05

    def gradient(through_contact):
        model.zero_grad()
        motion = decode(model, command, *coefficients(2), through_contact=through_contact)
        assert (motion.states[..., 6:] != 0).any()
        motion.states[..., :2].sum().backward()
        return model.decoder_lstm.weight_ih_l0.grad.clone()

    def gradient_with_the_object_hidden():
        model.zero_grad()
        chunks, seen = command.reshape(2, 4, 40).float(), at_rest(2, 10, command.device)
        state, pan = model.encode(chunks), 0.0
        for _ in range(4):
            output, state = model.step(seen, state)
            seen = rollout(seen[:, -1], output.acceleration.double(), *coefficients(2))
            seen = torch.cat([seen[..., :4], seen[..., 4:].detach()], dim=-1)
            pan = pan + seen[..., :2].sum()
        pan.backward()
        return model.decoder_lstm.weight_ih_l0.grad.clone()

    cut = gradient(False)
    torch.testing.assert_close(cut, gradient_with_the_object_hidden())
    assert not torch.allclose(cut, gradient(True), rtol=1e-5, atol=0.0)
