import numpy as np
import pytest
from scipy import stats

from bev_driving_env.kernels.noise import mix, normal, uniform

COUNT = 20_000
TWO_64 = 1 << 64


def splitmix64(seed, counter):
    """The generator of Steele et al. 2014, with Python's unbounded integers."""
    z = (seed + 0x9E3779B97F4A7C15 * (counter + 1)) % TWO_64
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % TWO_64
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB % TWO_64
    return z ^ (z >> 31)


def draws(function, seed, start=0, count=COUNT):
    return np.array([function(seed, k) for k in range(start, start + count)])


@pytest.fixture(scope="module")
def uniforms():
    return draws(uniform, 7)


@pytest.fixture(scope="module")
def normals():
    return draws(normal, 7)


def test_mixing_gives_the_published_first_numbers_of_splitmix64():
    # the reference implementation's first outputs for the seed 1234567
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [int(mix(1234567, k)) for k in range(3)] == published


@pytest.mark.parametrize("seed", [0, 1, 2**31, 2**62 + 12345])
def test_mixing_is_splitmix64_for_any_seed_and_counter(seed):
    for counter in (0, 1, 77, 2**20, 2**40 + 3):
        assert int(mix(seed, counter)) == splitmix64(seed, counter)


def test_uniform_numbers_are_the_upper_53_bits_everywhere():
    for counter in range(50):
        assert uniform(3, counter) == (splitmix64(3, counter) >> 11) / 2.0**53


def test_uniform_numbers_lie_from_zero_to_below_one(uniforms):
    assert uniforms.min() >= 0.0
    assert uniforms.max() < 1.0
    assert len(np.unique(uniforms)) == COUNT


def test_uniform_numbers_have_mean_a_half_and_variance_a_twelfth(uniforms):
    assert uniforms.mean() == pytest.approx(0.5, abs=4.0 * (1.0 / 12.0 / COUNT) ** 0.5)
    # the variance of (u - 1/2)^2 is 1/180
    assert uniforms.var() == pytest.approx(1.0 / 12.0, abs=4.0 * (1.0 / 180.0 / COUNT) ** 0.5)


def test_uniform_numbers_are_uniform(uniforms):
    assert stats.kstest(uniforms, "uniform").pvalue > 0.01


def test_normal_numbers_have_the_moments_of_the_standard_normal(normals):
    assert np.isfinite(normals).all()
    assert normals.mean() == pytest.approx(0.0, abs=4.0 / COUNT**0.5)
    assert normals.var() == pytest.approx(1.0, abs=4.0 * (2.0 / COUNT) ** 0.5)
    assert stats.skew(normals) == pytest.approx(0.0, abs=4.0 * (6.0 / COUNT) ** 0.5)
    assert stats.kurtosis(normals) == pytest.approx(0.0, abs=4.0 * (24.0 / COUNT) ** 0.5)


def test_normal_numbers_are_normal(normals):
    assert stats.kstest(normals, "norm").pvalue > 0.01


@pytest.mark.parametrize("function", [uniform, normal])
@pytest.mark.parametrize("lag", [1, 2, 10])
def test_neighbouring_counters_do_not_follow_one_another(function, lag, uniforms, normals):
    numbers = uniforms if function is uniform else normals
    assert abs(np.corrcoef(numbers[:-lag], numbers[lag:])[0, 1]) < 4.0 / COUNT**0.5


@pytest.mark.parametrize("function", [uniform, normal])
def test_neighbouring_seeds_do_not_follow_one_another(function):
    count = 4000
    one, two = draws(function, 40, count=count), draws(function, 41, count=count)
    assert not (one == two).any()
    assert abs(np.corrcoef(one, two)[0, 1]) < 4.0 / count**0.5


@pytest.mark.parametrize("function", [mix, uniform, normal])
def test_a_seed_and_a_counter_give_the_same_number_however_often_and_in_whatever_order(function):
    forward = [function(5, k) for k in range(20)]
    assert [function(5, k) for k in reversed(range(20))] == forward[::-1]
    assert len(set(forward)) == 20


def test_numpys_integers_draw_the_same_numbers():
    seed, counter = np.int64(5), np.int64(9)
    assert mix(seed, counter) == mix(5, 9)
    assert uniform(seed, counter) == uniform(5, 9)
    assert normal(seed, counter) == normal(5, 9)
