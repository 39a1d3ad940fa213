import inspect
import pickle
import re
import subprocess
import sys
import zlib

import numpy as np
import pytest

from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.sources.corrupted import CORRUPTIONS, CorruptedBEV
from bev_driving_env.sources.protocol import BEVSourceError, PrivilegedSource, SensorFrame

GEOMETRY = BEVGeometry(size=64, ego_row=50)
EVERYTHING = dict.fromkeys(CORRUPTIONS, 0.3)


class Toy:
    """A plain source: floats, the speed in all of its two channels."""

    channels = ("vehicles", "road")

    def reset(self):
        self.resets = getattr(self, "resets", 0) + 1

    def __call__(self, frame):
        return np.full((2, 64, 64), frame.measurements[0], np.float32)


class Counter(PrivilegedSource):
    """A source that remembers: its n-th BEV has n in all places. Keeps one buffer for all."""

    channels = ("road", "lane")
    needs_frame = False
    needs_truth = False

    def __init__(self):
        self.count, self.seeds = 0, []
        self.buffer = np.zeros((2, 64, 64), np.uint8)

    def seed(self, number):
        self.seeds.append(number)

    def reset(self):
        self.count = 0

    def perceive(self, frame, truth):
        self.count += 1
        self.buffer[:] = self.count
        return self.buffer

    def snapshot(self):
        return self.count

    def restore(self, state):
        self.count = state


def frame(speed=1.0):
    images = np.zeros((4, 2, 2, 3), np.uint8)
    matrices = np.zeros((4, 3, 3), np.float32), np.zeros((4, 4, 4), np.float32)
    measured = np.array([speed, 0.0, 0.0], np.float32)
    return SensorFrame(images, *matrices, np.zeros((64, 64), np.uint8), measured)


def truths(count=30):
    """Roads, and a route that turns right, with noise in the other channels."""
    planes = np.random.default_rng(7).integers(0, 256, (count, 6, 64, 64), dtype=np.uint8)
    planes[:, 1] = 0
    planes[:, 1, 20:51, 26:38] = planes[:, 1, 20:32, 26:] = 255
    return planes


def over_truth(**keywords):
    return CorruptedBEV("ground_truth", geometry=GEOMETRY, **keywords)


def episode(source, planes, seed=0):
    source.seed(seed)
    source.reset()
    return np.array([source.perceive(None, truth) for truth in planes])


def test_without_doses_the_source_is_unchanged_bit_for_bit():
    planes = truths()
    assert (episode(over_truth(seed=9), planes) == planes).all()


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_each_dose_reaches_its_error_model_and_the_larger_the_worse(name):
    planes = truths()
    if name == "latency":  # frames of noise would all be as far from each other
        planes = (np.arange(1, 31, dtype=np.uint8)[:, None, None, None]) * np.ones_like(planes)
    overlaps = []
    for dose in (0.0, 0.3, 1.0):
        result = episode(over_truth(**{name: dose}), planes)
        overlaps.append(np.minimum(result, planes).sum() / np.maximum(result, planes).sum())
    assert overlaps[0] == 1.0
    assert overlaps[0] > overlaps[1] > overlaps[2]


def test_every_dose_is_a_keyword_and_there_are_twelve():
    parameters = inspect.signature(CorruptedBEV).parameters
    doses = {name for name, item in parameters.items() if item.default == 0.0 and name != "seed"}
    assert set(CORRUPTIONS) == doses
    assert len(CORRUPTIONS) == 12


@pytest.mark.parametrize("seeds", [(0, 1, 1, 0), (5, 0, 6, 0)])
def test_either_seed_changes_the_errors(seeds):
    first, first_episode, second, second_episode = seeds
    one = episode(over_truth(pixel_dropout=0.5, seed=first), truths(), first_episode)
    again = episode(over_truth(pixel_dropout=0.5, seed=first), truths(), first_episode)
    other = episode(over_truth(pixel_dropout=0.5, seed=second), truths(), second_episode)
    assert (one == again).all()
    assert (one != other).any()


def test_an_episode_repeats_after_reset_and_seeds_last_until_the_next():
    source = over_truth(**EVERYTHING)
    first = episode(source, truths(), 3)
    source.reset()
    again = np.array([source.perceive(None, truth) for truth in truths()])
    assert (first == again).all()
    assert (first != episode(source, truths(), 4)).any()


def test_errors_do_not_depend_on_the_global_generator_or_the_process():
    np.random.seed(0)
    here = zlib.crc32(episode(over_truth(**EVERYTHING), truths(), 3).tobytes())
    np.random.seed(1)
    assert here == zlib.crc32(episode(over_truth(**EVERYTHING), truths(), 3).tobytes())
    program = (
        f"import sys, zlib; sys.path.insert(0, {str(__file__).rpartition('/')[0]!r}); "
        "from test_corrupted import *; "
        "print(zlib.crc32(episode(over_truth(**EVERYTHING), truths(), 3).tobytes()))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.split()[-1:] == [str(here)], run.stderr


@pytest.mark.parametrize(
    ("name", "frames"),
    [
        ("pixel_dropout", 1),
        ("channel_dropout", 1),
        ("flicker", 1),
        ("range_misses", 10),
        ("blob_dropout", 10),
        ("ghosts", 20),
        ("shift", 40),
        ("rotation", 40),
    ],
)
def test_random_numbers_stay_as_long_as_the_table_says(name, frames):
    truth = np.repeat(truths(1), 40, axis=0)
    # several seeds: two draws of a channel or a side may be equal by chance
    views = np.array([episode(over_truth(**{name: 0.5}), truth, seed) for seed in range(8)])
    changed = (views[:, 1:] != views[:, :-1]).any(axis=(0, 2, 3, 4))
    assert (np.flatnonzero(changed) + 1).tolist() == list(range(frames, 40, frames))


@pytest.mark.parametrize(("dose", "delay"), [(0.1, 1), (0.5, 5), (1.0, 10)])
def test_latency_shows_the_bev_of_some_frames_ago_and_the_oldest_at_the_start(dose, delay):
    source = CorruptedBEV(Counter(), latency=dose, geometry=GEOMETRY)
    source.reset()
    shown = [int(source.perceive(None, None).max()) for _ in range(25)]
    assert shown == [max(1, k - delay) for k in range(1, 26)]
    source.reset()
    assert source.perceive(None, None).max() == 1


def test_only_the_chosen_channels_are_corrupted():
    doses = {name: 0.5 for name in CORRUPTIONS if name != "straightening"}
    result = episode(over_truth(channels=["lane", "road"], **doses), truths())
    kept = [1, 3, 4, 5]
    assert (result[:, kept] == truths()[:, kept]).all()
    assert (result[:, 0] != truths()[:, 0]).any()
    assert (result[:, 2] != truths()[:, 2]).any()


def test_straightening_changes_the_route_only():
    result = episode(over_truth(straightening=1.0), truths())
    changed = (result != truths()).any(axis=(0, 2, 3))
    assert changed.tolist() == [name == "route" for name in CHANNELS]


def test_a_snapshot_repeats_the_same_bevs_bit_for_bit():
    source = CorruptedBEV(Counter(), latency=0.4, pixel_dropout=0.3, ghosts=0.5, geometry=GEOMETRY)
    source.seed(4)
    source.reset()
    for _ in range(7):
        source.perceive(None, None)
    moment = pickle.loads(pickle.dumps(source.snapshot()))
    first = np.array([source.perceive(None, None) for _ in range(25)])
    source.seed(5)
    source.reset()
    source.perceive(None, None)
    source.restore(moment)
    again = np.array([source.perceive(None, None) for _ in range(25)])
    np.testing.assert_array_equal(first, again)


def test_a_snapshot_does_not_change_with_later_frames():
    source = over_truth(latency=1.0)
    episode(source, truths(5))
    moment = source.snapshot()
    before = pickle.dumps(moment)
    source.perceive(None, truths(1)[0])[:] = 1
    assert pickle.dumps(moment) == before


def test_neither_the_truth_nor_what_was_returned_is_written_to():
    source, planes = over_truth(**EVERYTHING), truths()
    first = episode(source, planes)
    assert (planes == truths()).all()
    source.reset()
    for truth, expected in zip(planes, first, strict=True):
        given = truth.copy()
        result = source.perceive(None, given)
        np.testing.assert_array_equal(result, expected)
        given[:] = 0
        result[:] = 0


def test_a_source_that_reuses_its_buffer_is_delayed_correctly():
    source = CorruptedBEV(Counter(), latency=0.2, channels=("lane",), geometry=GEOMETRY)
    source.reset()
    shown = [source.perceive(None, None)[:, 0, 0].tolist() for _ in range(4)]
    assert shown == [[1, 1], [2, 1], [3, 1], [4, 2]]


def test_a_plain_source_is_called_with_the_frame_and_brought_to_uint8():
    toy = Toy()
    source = CorruptedBEV(toy, geometry=GEOMETRY)
    assert (source.channels, source.needs_frame, source.needs_truth) == (Toy.channels, True, False)
    source.seed(1)
    source.reset()
    assert toy.resets == 1
    result = source(frame(speed=0.2))
    assert (result.dtype, result.shape, set(result.flat)) == (np.uint8, (2, 64, 64), {51})
    np.testing.assert_array_equal(source.perceive(frame(speed=0.2), None), result)


def test_a_plain_source_without_a_frame_and_a_bad_bev_are_errors_of_the_source():
    source = CorruptedBEV(Toy(), erosion=0.5, geometry=GEOMETRY)
    with pytest.raises(BEVSourceError, match="'Toy' needs a sensor frame, got None"):
        source.perceive(None, None)
    with pytest.raises(BEVSourceError, match="'Toy' returned values from 7"):
        source(frame(speed=7.0))


def test_needs_and_seeds_are_those_of_the_source():
    source = over_truth()
    assert (source.channels, source.needs_frame, source.needs_truth) == (CHANNELS, False, True)
    counter = Counter()
    corrupted = CorruptedBEV(counter, geometry=GEOMETRY)
    assert not corrupted.needs_frame
    corrupted.seed(12)
    assert counter.seeds == [12]


def test_a_corrupted_source_can_be_corrupted_again():
    doubly = CorruptedBEV(over_truth(erosion=0.2), channel_dropout=1.0, geometry=GEOMETRY)
    assert doubly.needs_truth
    assert not episode(doubly, truths(3)).any()


def test_called_with_a_frame_alone_it_says_that_ground_truth_needs_an_environment():
    with pytest.raises(BEVSourceError, match="the true BEV, which only an environment has"):
        over_truth()(frame())


def test_a_bev_of_another_size_is_refused_with_the_cure():
    with pytest.raises(BEVSourceError, match=r"64 px, CorruptedBEV was made for 192.* geometry="):
        CorruptedBEV("ground_truth").perceive(None, truths(1)[0])


@pytest.mark.parametrize("name", CORRUPTIONS)
@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan"), "0.5", True, None])
def test_a_dose_that_is_none_is_refused_by_name_value_and_range(name, value):
    message = re.escape(f"{name} must be a dose from 0 to 1, got {value!r}")
    with pytest.raises(ValueError, match=message):
        over_truth(**{name: value})


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"channels": ["cars"]}, "'cars'; channels of the source: vehicles, road"),
        ({"channels": ["lane"]}, "'lane'; channels of the source: vehicles, road"),
        ({"straightening": 0.5}, "straightening changes the channel 'route'.*: vehicles, road"),
        ({"seed": -1}, "seed must be an int of at least 0, got -1"),
        ({"seed": 0.5}, "seed must be an int of at least 0, got 0.5"),
    ],
)
def test_other_wrong_keywords_are_refused(keywords, message):
    with pytest.raises(ValueError, match=message):
        CorruptedBEV(Toy(), **keywords)


def test_an_unknown_source_is_refused():
    with pytest.raises(ValueError, match="no_such_source"):
        CorruptedBEV("no_such_source")


def test_repr_shows_the_source_and_the_doses_that_are_not_zero():
    source = over_truth(erosion=0.5, latency=0.2, channels=["road"], seed=3)
    assert repr(source) == (
        "CorruptedBEV('ground_truth', latency=0.2, erosion=0.5, channels=('road',), seed=3)"
    )
    assert repr(CorruptedBEV(Toy())) == "CorruptedBEV('Toy', seed=0)"
