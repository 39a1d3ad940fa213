"""``checked_planes``, ``checked_batch``, ``predict``: what a source may return, and what not."""

import re

import numpy as np
import pytest

from bev_driving_env.frames import CHANNELS
from bev_driving_env.sources.checked import (
    checked_batch,
    checked_channels,
    checked_planes,
    one_line,
    predict,
    predict_batch,
)
from bev_driving_env.sources.protocol import BEVSourceError, SensorFrame

SIZE = 16
TWO = ("road", "vehicles")
FLAT = np.full((2, SIZE, SIZE), 0.5, np.float32)
FRAME = SensorFrame(
    np.zeros((4, 2, 3, 3), np.uint8),
    np.zeros((4, 3, 3), np.float32),
    np.zeros((4, 4, 4), np.float32),
    np.zeros((SIZE, SIZE), np.uint8),
    np.zeros(3, np.float32),
)


class Source:
    """Returns what it was made with, or raises it."""

    channels = TWO

    def __init__(self, result):
        self.result = result

    def reset(self):
        pass

    def __call__(self, frame):
        if isinstance(self.result, Exception):
            raise self.result
        return self.result

    def predict_batch(self, frames):
        return self(None)


def with_value(value, channel=1, dtype=np.float32):
    planes = np.full((2, SIZE, SIZE), 0.5, dtype)
    planes[channel, 3, 4] = value
    return planes


def message_of(planes, channels=TWO):
    with pytest.raises(BEVSourceError) as error:
        checked_planes("mine", channels, planes, SIZE)
    assert error.value.source == "mine"
    message = str(error.value)
    assert message.startswith("BEV source 'mine' returned ")
    assert f"expected a NumPy array of shape {(len(channels), SIZE, SIZE)}" in message
    assert "uint8 in 0..255 or float in [0, 1]" in message
    return message


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.longdouble, ">f4"])
def test_floats_become_rounded_levels(dtype):
    planes = np.zeros((2, SIZE, SIZE), dtype)
    planes[0, 0, :5] = [0.0, 0.25, 0.5, 0.75, 1.0]
    planes[1, 2, 2] = 100.4 / 255.0
    levels = checked_planes("mine", TWO, planes, SIZE)
    assert levels.dtype == np.uint8
    assert levels[0, 0, :6].tolist() == [0, 64, 128, 191, 255, 0]
    assert levels[1, 2, 2] == 100


def test_every_uint8_level_survives_being_a_float32():
    levels = np.arange(256, dtype=np.uint8).reshape(1, 16, 16)
    returned = checked_planes("mine", ("road",), levels.astype(np.float32) / 255.0, 16)
    np.testing.assert_array_equal(returned, levels)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_the_result_is_never_the_buffer_of_the_source(dtype):
    planes = np.ones((2, SIZE, SIZE), dtype)
    returned = checked_planes("mine", TWO, planes, SIZE)
    assert not np.shares_memory(returned, planes)
    before = returned.copy()
    planes[:] = 0
    np.testing.assert_array_equal(returned, before)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_planes_in_any_layout_come_back_contiguous_and_in_place(dtype):
    rng = np.random.default_rng(0)
    channels_last = (rng.random((SIZE, SIZE, 2)) * (255 if dtype is np.uint8 else 1)).astype(dtype)
    planes = np.moveaxis(channels_last, -1, 0)
    returned = checked_planes("mine", TWO, planes, SIZE)
    assert returned.flags.c_contiguous
    expected = planes if dtype is np.uint8 else np.rint(planes * 255)
    np.testing.assert_array_equal(returned, expected)


def test_the_array_of_the_source_is_left_as_it_was_even_if_it_is_read_only():
    planes = FLAT.copy()
    planes.flags.writeable = False
    checked_planes("mine", TWO, planes, SIZE)
    np.testing.assert_array_equal(planes, FLAT)


@pytest.mark.parametrize(
    ("planes", "named"),
    [
        (None, "None (is there a return statement?)"),
        (FLAT.tolist(), "list"),
        ((FLAT, FLAT), "tuple"),
    ],
)
def test_what_is_no_array_is_refused_by_its_type(planes, named):
    assert f"returned {named}, expected" in message_of(planes)


def test_a_tensor_is_refused_with_the_way_to_make_an_array_of_it():
    torch = pytest.importorskip("torch")
    named = "torch.Tensor (take .detach().cpu().numpy())"
    assert f"returned {named}, expected" in message_of(torch.zeros(2, SIZE, SIZE))


@pytest.mark.parametrize(
    ("shape", "hint"),
    [
        ((SIZE, SIZE, 2), "; channels come first: np.moveaxis(planes, -1, -3)"),
        ((1, 2, SIZE, SIZE), "; without the batch axis: planes[0]"),
        ((3, SIZE, SIZE), "in [0, 1]"),
        ((2, SIZE, SIZE + 1), "in [0, 1]"),
        ((2, 0, SIZE), "in [0, 1]"),
        ((), "in [0, 1]"),
    ],
)
def test_a_wrong_shape_is_refused_with_a_hint_where_there_is_one(shape, hint):
    message = message_of(np.zeros(shape, np.uint8))
    assert f"returned shape {shape}, " in message
    assert message.endswith(hint)


def test_a_missing_channel_axis_is_named():
    message = message_of(np.zeros((SIZE, SIZE), np.uint8), ("road",))
    assert message.endswith("; with a channel axis: np.expand_dims(planes, -3)")


@pytest.mark.parametrize("dtype", [np.int64, np.int8, np.uint16, np.complex64, object, "U1"])
def test_a_wrong_dtype_is_refused(dtype):
    planes = np.zeros((2, SIZE, SIZE), dtype)
    assert f"returned dtype {planes.dtype}, " in message_of(planes)


def test_a_mask_is_refused_with_the_way_to_make_levels_of_it():
    message = message_of(np.zeros((2, SIZE, SIZE), bool))
    assert "returned dtype bool, " in message
    assert message.endswith(".astype(np.uint8) * 255")


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (np.nan, "NaN in 1 of 512 values (channel vehicles)"),
        (np.inf, "infinity in 1 of 512 values (channel vehicles)"),
        (-np.inf, "infinity in 1 of 512 values (channel vehicles)"),
        (1.5, "values from 0.5 to 1.5 (channel vehicles)"),
        (-0.25, "values from -0.25 to 0.5 (channel vehicles)"),
    ],
)
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
@pytest.mark.filterwarnings("error")
def test_one_bad_value_is_refused_with_what_it_is_and_its_channel(value, named, dtype):
    assert f"returned {named}, " in message_of(with_value(value, dtype=dtype))


def test_nan_is_found_among_values_out_of_range():
    planes = with_value(7.0, channel=0)
    planes[1, 5, 5] = np.nan
    assert "NaN in 1 of 512 values (channel vehicles)" in message_of(planes)


def test_several_bad_channels_are_all_named():
    planes = np.full((2, SIZE, SIZE), 255.0, np.float32)
    assert "values from 255.0 to 255.0 (channels road, vehicles)" in message_of(planes)


def test_an_overshoot_by_a_rounding_error_of_interpolation_is_taken_as_one():
    planes = with_value(np.nextafter(np.float32(1), np.float32(2)))
    assert checked_planes("mine", TWO, planes, SIZE).max() == 255
    assert "to 1.0001 (" in message_of(with_value(1.0001))


def test_values_hidden_by_a_mask_are_checked_too():
    planes = np.ma.masked_invalid(with_value(np.nan))
    assert "NaN in 1 of 512" in message_of(planes)


def test_a_batch_is_checked_like_its_frames():
    rng = np.random.default_rng(0)
    planes = rng.random((3, 2, SIZE, SIZE), np.float32)
    batch = checked_batch("mine", TWO, planes, SIZE, 3)
    singles = [checked_planes("mine", TWO, each, SIZE) for each in planes]
    np.testing.assert_array_equal(batch, singles)


@pytest.mark.parametrize(
    ("planes", "named"),
    [
        (np.zeros((2, 2, SIZE, SIZE)), r"returned shape \(2, 2, 16, 16\)"),
        (np.zeros((3, SIZE, SIZE, 2)), r"channels come first"),
        (np.full((3, 2, SIZE, SIZE), np.nan), r"NaN in 1536 of 1536 .*\(channels road, vehicles\)"),
        ([FLAT] * 3, r"returned list"),
    ],
)
def test_a_bad_batch_is_refused(planes, named):
    with pytest.raises(BEVSourceError, match=named) as error:
        checked_batch("mine", TWO, planes, SIZE, 3)
    assert "(3, 2, 16, 16) (frames, channels, rows, columns)" in str(error.value)


def test_a_bad_value_in_a_batch_is_traced_to_its_channel():
    planes = np.stack([FLAT, with_value(2.0), FLAT])
    with pytest.raises(BEVSourceError, match=r"\(channel vehicles\)"):
        checked_batch("mine", TWO, planes, SIZE, 3)


def test_predicting_asks_the_source_and_checks_the_answer():
    assert (predict("mine", Source(FLAT), FRAME, SIZE) == 128).all()
    assert predict_batch("mine", Source(np.stack([FLAT] * 3)), [FRAME] * 3, SIZE).shape[0] == 3
    with pytest.raises(BEVSourceError, match="'mine' returned None"):
        predict("mine", Source(None), FRAME, SIZE)
    with pytest.raises(BEVSourceError, match="'mine' returned shape"):
        predict_batch("mine", Source(np.stack([FLAT] * 3)), [FRAME] * 2, SIZE)


@pytest.mark.parametrize(("ask", "given"), [(predict, FRAME), (predict_batch, [FRAME])])
def test_an_error_inside_a_source_is_named_and_chained(ask, given):
    inner = ZeroDivisionError("in the source\nand more")
    with pytest.raises(BEVSourceError) as error:
        ask("mine", Source(inner), given, SIZE)
    assert str(error.value) == "BEV source 'mine' raised ZeroDivisionError: in the source"
    assert error.value.__cause__ is inner


@pytest.mark.parametrize(("ask", "given"), [(predict, FRAME), (predict_batch, [FRAME])])
def test_an_error_that_names_a_source_already_is_passed_on(ask, given):
    inner = BEVSourceError("inner", "has a reason of its own")
    with pytest.raises(BEVSourceError) as error:
        ask("mine", Source(inner), given, SIZE)
    assert error.value is inner


def test_an_interrupt_is_not_taken_for_an_error_of_the_source():
    class Interrupted(Source):
        def __call__(self, frame):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        predict("mine", Interrupted(None), FRAME, SIZE)


def test_channels_are_a_sequence_of_names_in_any_order():
    assert checked_channels("mine", ["lights", "road"]) == ("lights", "road")
    assert checked_channels("mine", CHANNELS) == CHANNELS


@pytest.mark.parametrize(
    ("channels", "named"),
    [
        ("road", "must have channels = a tuple of names, got 'road'"),
        (None, "must have channels = a tuple of names, got None"),
        (3, "must have channels = a tuple of names, got 3"),
        ((), "must have at least one channel"),
        (("road", "cars"), "has channel 'cars', which does not exist"),
        (("road", 1), "has channel 1, which does not exist"),
        (("road", "lane", "road"), "must have each channel once, got road, lane, road"),
    ],
)
def test_other_channels_are_refused(channels, named):
    with pytest.raises(ValueError, match=f"^mine {re.escape(named)}"):
        checked_channels("mine", channels)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ValueError("one\ntwo"), "ValueError: one"),
        (ValueError("\n  \nthree"), "ValueError: three"),
        (ValueError(), "ValueError"),
    ],
)
def test_an_error_in_one_line_is_its_type_and_first_line(error, line):
    assert one_line(error) == line
