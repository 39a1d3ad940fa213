"""``PolicyView``: channels put together from sources, which cannot get at each other."""

import numpy as np
import pytest

from bev_driving_env.frames import CHANNELS, BEVGeometry
from bev_driving_env.sources.corrupted import CorruptedBEV
from bev_driving_env.sources.policy_view import PolicyView, channel_specs
from bev_driving_env.sources.protocol import BEVSourceError, SensorFrame

SIZE = 16
GEOMETRY = BEVGeometry(size=SIZE, ego_row=12)
TWICE = BEVGeometry(size=2 * SIZE, ego_row=24)


class Flat:
    """Predicts one value everywhere and notes what happens to it."""

    def __init__(self, value=7, channels=CHANNELS):
        self.value = value
        self.channels = channels
        self.calls = []
        self.frames = []

    def reset(self):
        self.calls.append("reset")

    def __call__(self, frame):
        self.calls.append("call")
        self.frames.append(frame)
        return np.full((len(self.channels), SIZE, SIZE), self.value, np.uint8)


class Counter(Flat):
    """Predicts how often it was asked in this episode, and can be rewound."""

    def reset(self):
        self.value = 0

    def __call__(self, frame):
        self.value += 1
        return super().__call__(frame)

    def snapshot(self):
        return self.value

    def restore(self, state):
        self.value = state


class Batch(Flat):
    """Predicts each frame's speed, for any number of frames."""

    def predict_batch(self, frames):
        self.calls.append(len(frames))
        planes = np.zeros((len(frames), len(self.channels), SIZE, SIZE), np.uint8)
        for plane, frame in zip(planes, frames, strict=True):
            plane[:] = frame.measurements[0]
        return planes


class Vandal(Flat):
    """Paints over all that it is given."""

    def __call__(self, frame):
        for array in vars(frame).values():
            array[:] = 99
        return super().__call__(frame)


def frame_of(n):
    """A frame that shows ``n`` everywhere."""
    return SensorFrame(
        images=np.full((4, 8, 8, 3), n, np.uint8),
        intrinsics=np.full((4, 3, 3), n, np.float32),
        extrinsics=np.full((4, 4, 4), n, np.float32),
        route_map=np.full((SIZE, SIZE), n, np.uint8),
        measurements=np.full(3, n, np.float32),
    )


def truth_of(worlds):
    return np.arange(worlds * 6, dtype=np.uint8).reshape(worlds, 6, 1, 1) + np.zeros(
        (worlds, 6, SIZE, SIZE), np.uint8
    )


def started(spec, worlds=1):
    view = PolicyView(spec, worlds, GEOMETRY)
    for n in range(worlds):
        view.reset(n, 100 + n)
    return view


def values(bev):
    """The one value of each channel."""
    assert (bev == bev[..., :1, :1]).all()
    return bev[..., 0, 0].tolist()


@pytest.mark.parametrize(
    "spec",
    [
        "ground_truth",
        {"default": "ground_truth"},
        {"route": "ground_truth", "default": "ground_truth"},
        dict.fromkeys(CHANNELS, "ground_truth"),
    ],
)
def test_every_way_to_say_ground_truth_is_known_to_be_the_truth_and_needs_no_frame(spec):
    view = started(spec, 2)
    assert view.is_truth
    assert not view.needs_frame
    assert not started({"road": Flat(), "default": "ground_truth"}).is_truth


def test_each_channel_comes_from_the_source_that_was_named_for_it():
    view = started({"lane": Flat(50), "lights": Flat(60), "default": "ground_truth"})
    assert not view.is_truth
    assert values(view.observe([0], frame_of, truth_of(1))) == [[0, 1, 50, 3, 4, 60]]


def test_channels_that_a_source_does_not_predict_are_zero_whatever_its_order():
    class TwoLayers(Flat):
        def __call__(self, frame):
            planes = super().__call__(frame)
            planes[1] += 1
            return planes

    view = started(TwoLayers(20, ("lane", "road")))
    assert values(view.observe([0], frame_of, None)) == [[21, 0, 20, 0, 0, 0]]


def test_a_source_for_one_channel_may_predict_more_of_which_nothing_is_used():
    view = started({"road": Flat(30), "default": Flat(40, ("road", "route"))})
    assert values(view.observe([0], frame_of, None)) == [[30, 40, 0, 0, 0, 0]]


def test_one_source_named_for_several_channels_is_asked_once():
    source = Flat(9)
    view = started({"road": source, "lane": source, "default": "ground_truth"})
    view.observe([0], frame_of, truth_of(1))
    assert source.calls == ["reset", "call"]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"route": Flat(1, ("road",)), "default": "ground_truth"}, r"Flat.*'route'.*road"),
        ({"rood": "ground_truth", "default": "ground_truth"}, r"'rood'.*road.*default"),
        ({"road": "ground_truth"}, r"'route'.*default"),
        ({"default": "grond_truth"}, r"grond_truth.*did you mean 'ground_truth'"),
        ({"default": None}, r"NoneType"),
        (7, r"int without channels"),
    ],
)
def test_what_cannot_be_put_together_is_refused_with_its_name(spec, message):
    with pytest.raises(ValueError, match=message):
        PolicyView(spec, 1, GEOMETRY)


def test_the_specs_of_channels_are_those_named_and_else_the_default():
    specs = channel_specs({"route": "a", "default": "b"})
    assert specs == {**dict.fromkeys(CHANNELS, "b"), "route": "a"}


def test_a_source_object_is_copied_for_each_world_and_the_copies_count_for_themselves():
    view = started(Counter(), 3)
    assert values(view.observe([0, 1, 2], frame_of, None))[1] == [1] * 6
    assert values(view.observe([1], frame_of, None)) == [[1] * 6, [2] * 6, [1] * 6]
    view.reset(2, 0)
    assert values(view.observe([0, 1, 2], frame_of, None)) == [[2] * 6, [3] * 6, [1] * 6]


def test_worlds_that_are_not_asked_keep_what_they_saw_and_the_result_is_a_copy():
    view = started(Counter(), 2)
    first = view.observe([0, 1], frame_of, None)
    first[:] = 200
    assert values(view.observe([0], frame_of, None)) == [[2] * 6, [1] * 6]
    view.last()[:] = 200
    assert values(view.last()) == [[2] * 6, [1] * 6]


def test_a_batched_source_is_shared_and_asked_once_for_all_frames():
    source = Batch()
    view = started(source, 3)
    assert values(view.observe([0, 1, 2], frame_of, None)) == [[0] * 6, [1] * 6, [2] * 6]
    view.observe([2, 0], lambda n: frame_of(n + 10), None)
    assert values(view.last()) == [[10] * 6, [1] * 6, [12] * 6]
    view.observe([], pytest.fail, None)
    assert [call for call in source.calls if call != "reset"] == [3, 2]


def test_a_source_that_cannot_be_copied_is_refused_with_ways_out():
    source = Flat()
    source.lock = open(__file__)  # noqa: SIM115
    PolicyView(source, 1, GEOMETRY)
    with pytest.raises(ValueError, match=r"Flat.*cannot be copied.*register_bev_source.*batch"):
        PolicyView(source, 2, GEOMETRY)
    source.lock.close()


def test_a_source_that_changes_its_frame_cannot_reach_another_source():
    spec = {"road": Vandal(), "route": Flat(), "default": Vandal()}
    view = started(spec)
    for _ in range(2):
        view.observe([0], lambda n: frame_of(3), None)
    honest = spec["route"].frames
    assert len(honest) == 2
    for frame in honest:
        assert all((array == 3).all() for array in vars(frame).values())


def test_no_two_sources_and_no_two_moments_share_memory():
    spec = {"road": Flat(), "default": Flat()}
    view = started(spec)
    for _ in range(2):
        view.observe([0], frame_of, None)
    frames = spec["road"].frames + spec["default"].frames
    arrays = [array for frame in frames for array in vars(frame).values()]
    for i, one in enumerate(arrays):
        assert not any(np.shares_memory(one, other) for other in arrays[:i])


def test_frames_are_made_once_a_world_and_only_if_somebody_wants_them():
    made = []

    def make(n):
        made.append(n)
        return frame_of(n)

    view = started({"road": Flat(), "lane": Flat(), "default": "ground_truth"}, 2)
    view.observe([0, 1], make, truth_of(2))
    assert made == [0, 1]
    started(CorruptedBEV("ground_truth", geometry=GEOMETRY))
    assert not started(CorruptedBEV("ground_truth", geometry=GEOMETRY)).needs_frame


def test_the_seed_comes_before_the_reset_and_is_that_of_the_episode():
    class Seeded(Flat):
        def seed(self, number):
            self.calls.append(number)

    source = Seeded()
    view = PolicyView(source, 1, GEOMETRY)
    view.reset(0, 5)
    view.reset(0, 6)
    first, _, second, _ = source.calls
    assert source.calls[1::2] == ["reset", "reset"]
    # the same for the same episode, and telling nothing of its seed
    assert first != second
    assert not {first, second} & {5, 6}
    view.reset(0, 5)
    assert source.calls[4] == first


def test_a_snapshot_takes_the_sources_and_the_picture_back():
    view = started({"road": Counter(), "default": Flat(5)}, 2)
    view.observe([0, 1], frame_of, None)
    snapshot = view.snapshot()
    after = [view.observe([0, 1], frame_of, None) for _ in range(2)]
    assert view.restore(snapshot)
    assert values(view.last())[0][0] == 1
    for expected in after:
        np.testing.assert_array_equal(view.observe([0, 1], frame_of, None), expected)


def test_a_snapshot_of_other_sources_or_none_is_not_taken():
    view = started(Counter())
    snapshot = view.snapshot()
    assert not started({"road": Counter(), "default": Flat()}).restore(snapshot)
    assert not PolicyView(Counter(), 1, TWICE).restore(snapshot)
    assert not view.restore(None)


def raiser(kind, where):
    """A source that raises in one of its methods."""

    def fail(self, *_):
        raise kind("no idea\nat all")

    return type("Broken", (Flat,), {where: fail})()


@pytest.mark.parametrize("where", ["reset", "seed", "__call__", "predict_batch", "snapshot"])
@pytest.mark.parametrize("kind", [RuntimeError, KeyError, ZeroDivisionError])
def test_whatever_a_source_raises_is_chained_to_an_error_with_its_name(kind, where):
    view = PolicyView(raiser(kind, where), 1, GEOMETRY)

    def use():
        view.reset(0, 0)
        view.observe([0], frame_of, None)
        view.snapshot()

    with pytest.raises(BEVSourceError, match=rf"'Broken' raised {kind.__name__}") as caught:
        use()
    assert type(caught.value.__cause__) is kind
    assert caught.value.source == "Broken"


def test_errors_in_restoring_are_named_too():
    source = raiser(OSError, "restore")
    source.snapshot = lambda: 1
    view = started(source)
    snapshot = view.snapshot()
    with pytest.raises(BEVSourceError, match=r"'Broken' raised OSError.*restore") as caught:
        view.restore(snapshot)
    assert isinstance(caught.value.__cause__, OSError)


@pytest.mark.parametrize(
    ("planes", "came"),
    [
        (np.zeros((5, SIZE, SIZE), np.uint8), r"shape \(5, 16, 16\)"),
        (np.zeros((6, SIZE, SIZE), np.int32), "int32"),
        (np.full((6, SIZE, SIZE), np.nan, np.float32), "NaN"),
        (np.full((6, SIZE, SIZE), 1.5), r"1\.5"),
        (None, "None"),
        ([[0]], "list"),
    ],
)
def test_what_is_no_bev_is_refused_with_what_came_and_what_is_expected(planes, came):
    source = Flat()
    source.__class__ = type("Odd", (Flat,), {"__call__": lambda self, frame: planes})
    with pytest.raises(BEVSourceError, match=rf"'Odd' returned .*{came}.*\(6, 16, 16\)"):
        started(source).observe([0], frame_of, None)


def test_a_failed_moment_leaves_what_was_seen_before():
    class Moody(Counter):
        def __call__(self, frame):
            planes = super().__call__(frame)
            return planes if self.value != 2 else planes[:1]

    view = started(Moody())
    view.observe([0], frame_of, None)
    with pytest.raises(BEVSourceError):
        view.observe([0], frame_of, None)
    assert values(view.last()) == [[1] * 6]


def test_a_class_of_ones_own_is_not_given_the_truth_whatever_methods_it_has():
    class Curious(Flat):
        needs_truth, needs_frame = True, False

        def perceive(self, frame, truth):
            return truth

    view = started(Curious(7))
    assert not view.needs_truth
    assert view.needs_frame
    assert set(values(view.observe([0], frame_of, truth_of(1)))[0]) <= {0, 7}


def test_a_source_made_for_another_geometry_is_refused_with_both():
    with pytest.raises(ValueError, match=r"size=32.*environment has.*size=16.*geometry="):
        PolicyView(CorruptedBEV("ground_truth", geometry=TWICE), 1, GEOMETRY)


def test_ipm_by_name_predicts_the_environments_geometry():
    geometry = BEVGeometry(size=64, px_per_m=2.0, ego_row=40)
    assert PolicyView("ipm", 1, geometry)._feeds[0].of(0).geometry == geometry


def test_environments_given_one_corrupted_bev_do_not_share_what_it_remembers():
    late = CorruptedBEV("ground_truth", latency=1.0, geometry=GEOMETRY)
    one, other = started(late), started(late)
    one.observe([0], frame_of, truth_of(1))
    fresh = started(CorruptedBEV("ground_truth", latency=1.0, geometry=GEOMETRY))
    for _ in range(3):
        np.testing.assert_array_equal(
            other.observe([0], frame_of, truth_of(1)), fresh.observe([0], frame_of, truth_of(1))
        )
