"""The network: what the fast decoding computes is what `nn.LSTM` would, and the bound holds."""

from __future__ import annotations

import pytest
import torch

from train.network.model import DecoderState, Seq2Seq, bound_acceleration, command_ahead
from train.physics.closed_loop import at_rest, decode
from train.physics.rollout import rollout


def coefficients(batch):
    ones = torch.ones(batch, dtype=torch.float64)
    return 1.0 * ones, 0.5 * ones


@pytest.mark.parametrize("ahead", [0, 2])
def test_fast_encoder_and_decoder_equal_nn_lstm(ahead):
    torch.manual_seed(0)
    model = Seq2Seq(units=12, chunk=10, command_ahead=ahead, acceleration_bound=30.0)
    command, motion = torch.randn(3, 5, 40) * 0.05, torch.randn(3, 10, 8) * 0.05
    state = model.encode(command)
    _, (hidden, cell) = model.encoder_lstm(command * model.command_scale)
    torch.testing.assert_close(state, DecoderState(hidden, cell))

    output, after = model.decoder(command).step(4, motion, state)
    seen = [motion.flatten(1)] + ([command_ahead(command, ahead)[:, 4]] if ahead else [])
    top, (hidden, cell) = model.decoder_lstm((torch.cat(seen, -1) * model.observation_scale)[None], (hidden, cell))
    torch.testing.assert_close(after, DecoderState(hidden, cell))
    torch.testing.assert_close(output.acceleration, model.read_out(top[0]).acceleration)


def test_command_ahead_holds_the_last_position_at_rest():
    command = torch.arange(2 * 3 * 8, dtype=torch.float32).reshape(2, 3, 8)  # chunks of two rows
    ahead = command_ahead(command, 2)
    assert torch.equal(ahead[:, 0], torch.cat([command[:, 0], command[:, 1]], -1))
    assert torch.equal(ahead[:, 2, :8], command[:, 2])
    last = command[:, 2, 4:6]
    rest = torch.zeros_like(last)
    assert torch.equal(ahead[:, 2, 8:], torch.cat([last, rest, last, rest], -1))


def test_bound_holds_keeps_the_direction_and_has_a_gradient_at_zero():
    u = (torch.randn(1000, 2) * 50).requires_grad_()
    bounded = bound_acceleration(u, 30.0)
    assert torch.linalg.vector_norm(bounded, dim=-1).max() <= 30.0 * (1 + 1e-6)
    cosine = torch.nn.functional.cosine_similarity(u, bounded)
    assert cosine.min() > 0.9999
    small = torch.zeros(1, 2, requires_grad=True)
    bound_acceleration(small, 30.0).sum().backward()
    torch.testing.assert_close(small.grad, torch.ones(1, 2))


def test_covariances_are_positive_definite():
    model = Seq2Seq(units=8, chunk=10)
    covariance = model.read_out(torch.randn(20, 8) * 10).covariance
    assert (covariance[..., 0] * covariance[..., 2] - covariance[..., 1] ** 2).min() > 0


def test_gradient_of_the_pan_does_not_pass_the_law_of_friction_when_told_so():
    """Friction decides where the object goes; with the contact cut, the pan's gradient must not know of it."""
    torch.manual_seed(0)
    model = Seq2Seq(units=8, chunk=10, command_ahead=2)
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
        state, decoder, pan = model.encode(chunks), model.decoder(chunks), 0.0
        for n in range(4):
            output, state = decoder.step(n, seen, state)
            seen = rollout(seen[:, -1], output.acceleration.double(), *coefficients(2))
            seen = torch.cat([seen[..., :4], seen[..., 4:].detach()], dim=-1)
            pan = pan + seen[..., :2].sum()
        pan.backward()
        return model.decoder_lstm.weight_ih_l0.grad.clone()

    cut = gradient(False)
    torch.testing.assert_close(cut, gradient_with_the_object_hidden())
    assert not torch.allclose(cut, gradient(True))
