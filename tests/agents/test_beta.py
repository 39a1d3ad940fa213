"""Beta distributions over actions, against torch.distributions, SciPy and by hand."""

import itertools
import math

import numpy as np
import pytest
import scipy.stats
import torch
from torch.distributions import Beta, kl_divergence

import agents
from agents.beta import (
    EPSILON,
    beta_entropy,
    beta_kl,
    beta_mean,
    beta_mode,
    beta_nll,
    beta_sample,
)

CONCENTRATIONS = [1e-3, 0.3, 1.0, 2.5, 60.0, 1e4]


def grid(actions=(-0.999, -0.4, 0.0, 0.7, 0.9999)):
    """Every pair of concentrations with every action, each (N, 1) in double precision."""
    rows = list(itertools.product(CONCENTRATIONS, CONCENTRATIONS, actions))
    return [column.unsqueeze(1) for column in torch.tensor(rows, dtype=torch.float64).T]


def test_it_is_exported_by_the_package():
    assert agents.beta_nll is beta_nll


def test_likelihood_is_scipys_summed_over_the_dimensions():
    rng = np.random.default_rng(0)
    alpha, beta = np.exp(rng.uniform(np.log(1e-3), np.log(1e4), (2, 500, 2)))
    action = rng.uniform(-1.0, 1.0, (500, 2))
    expected = -scipy.stats.beta.logpdf((action + 1.0) / 2.0, alpha, beta).sum(axis=1)
    got = beta_nll(*map(torch.from_numpy, (alpha, beta, action)))
    assert got.shape == (500,)
    np.testing.assert_allclose(got.numpy(), expected, rtol=1e-9, atol=1e-6)


def test_likelihood_and_gradients_are_those_of_torch():
    alpha, beta, action = grid()
    ours = [alpha.clone().requires_grad_(), beta.clone().requires_grad_()]
    theirs = [alpha.clone().requires_grad_(), beta.clone().requires_grad_()]
    nll = beta_nll(*ours, action)
    reference = -Beta(*theirs).log_prob((action + 1.0) / 2.0).sum(dim=1)
    torch.testing.assert_close(nll, reference, rtol=1e-6, atol=1e-6)
    nll.sum().backward()
    reference.sum().backward()
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine.grad, other.grad, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_the_ends_count_as_points_a_millionth_inside(end):
    alpha, beta = torch.tensor([[2.0, 0.5]]).double(), torch.tensor([[3.0, 4.0]]).double()
    x = EPSILON if end < 0 else 1.0 - EPSILON
    expected = -scipy.stats.beta.logpdf(x, alpha.numpy(), beta.numpy()).sum()
    got = beta_nll(alpha, beta, torch.full((1, 2), end, dtype=torch.float64))
    assert got.item() == pytest.approx(expected, rel=1e-7)


def test_in_single_precision_it_is_finite_and_near_everywhere_up_to_the_ends():
    alpha, beta, action = grid(actions=(-1.0, -1.0 + 1e-7, 0.0, 1.0 - 1e-7, 1.0))
    singles = [alpha.float().requires_grad_(), beta.float().requires_grad_()]
    nll = beta_nll(*singles, action.float())
    assert nll.dtype == torch.float32
    torch.testing.assert_close(nll.double(), beta_nll(alpha, beta, action), rtol=1e-6, atol=1e-4)
    nll.sum().backward()
    for single in singles:
        assert torch.isfinite(single.grad).all()


@pytest.mark.parametrize("shapes", [((4, 2), (4, 2), (4,)), ((4, 2), (1, 2), (4, 2))])
def test_shapes_that_would_broadcast_are_refused(shapes):
    with pytest.raises(ValueError, match="one shape") as error:
        beta_nll(*(torch.ones(shape) for shape in shapes))
    assert all(str(shape) in str(error.value) for shape in shapes)


@pytest.mark.parametrize(
    ("alpha", "beta", "expected"),
    [
        (3.0, 2.0, 2 * (2 / 3) - 1),  # (3 - 1) / (3 + 2 - 2)
        (1.0001, 1.0001, 0.0),
        (1.0, 2.0, -1.0),
        (0.5, 1.5, -1.0),
        (2.0, 1.0, 1.0),
        (1.5, 0.5, 1.0),
        (1.0, 1.0, 0.0),
        (0.2, 0.6, 2 * 0.25 - 1),  # peaks at both ends: the mean
        (1.0, 0.5, 2 * (1 / 1.5) - 1),
    ],
)
def test_mode_follows_the_case_rules(alpha, beta, expected):
    got = beta_mode(torch.tensor([alpha]), torch.tensor([beta]))
    assert got.item() == pytest.approx(expected, abs=1e-5)


def test_mode_is_where_the_density_is_highest():
    action = torch.linspace(-1.0, 1.0, 4001).double().unsqueeze(1)
    for a, b in [(2.0, 5.0), (1.2, 1.1), (0.7, 3.0), (40.0, 8.0), (3.0, 1.0)]:
        alpha, beta = torch.full_like(action, a), torch.full_like(action, b)
        likeliest = action[beta_nll(alpha, beta, action).argmin()].item()
        assert beta_mode(alpha[:1], beta[:1]).item() == pytest.approx(likeliest, abs=1e-3)


def test_mean_and_samples_agree():
    torch.manual_seed(0)
    alpha, beta = torch.tensor([4.0, 0.5]), torch.tensor([1.5, 2.0])
    actions = beta_sample(alpha.expand(20000, 2), beta.expand(20000, 2))
    assert actions.min() >= -1.0
    assert actions.max() <= 1.0
    expected = [2 * 4 / 5.5 - 1, 2 * 0.5 / 2.5 - 1]
    assert beta_mean(alpha, beta).tolist() == pytest.approx(expected, abs=1e-6)
    assert actions.mean(dim=0).tolist() == pytest.approx(expected, abs=0.02)


def test_samples_of_extreme_concentrations_are_actions():
    torch.manual_seed(0)
    for a, b in itertools.product(CONCENTRATIONS, CONCENTRATIONS):
        actions = beta_sample(torch.full((1000,), a), torch.full((1000,), b))
        assert torch.isfinite(actions).all()
        assert actions.abs().max() <= 1.0


def test_entropy_is_that_of_the_action():
    alpha, beta, _ = grid(actions=(0.0,))
    expected = scipy.stats.beta.entropy(alpha.numpy(), beta.numpy(), loc=-1.0, scale=2.0)
    moderate = np.isfinite(expected[:, 0]) & (np.abs(expected[:, 0]) < 1e3)
    assert moderate.sum() > 20
    got = beta_entropy(alpha, beta).numpy()
    np.testing.assert_allclose(got[moderate], expected[moderate, 0], rtol=1e-6, atol=1e-6)
    assert beta_entropy(torch.ones(1, 2), torch.ones(1, 2)).item() == pytest.approx(
        2 * math.log(2.0)
    )


def test_divergence_is_that_of_torch_and_none_from_itself():
    rng = np.random.default_rng(1)
    four = torch.from_numpy(np.exp(rng.uniform(-3.0, 5.0, (4, 200, 2))))
    expected = kl_divergence(Beta(four[0], four[1]), Beta(four[2], four[3])).sum(dim=1)
    torch.testing.assert_close(beta_kl(*four), expected, rtol=1e-6, atol=1e-6)
    itself = beta_kl(four[0], four[1], four[0], four[1])
    torch.testing.assert_close(itself, torch.zeros(200, dtype=torch.float64), rtol=0, atol=1e-9)
    assert (beta_kl(*four) > 0).all()
