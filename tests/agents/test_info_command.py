"""Histograms in text."""

import numpy as np

from agents.info_command import histogram


def test_the_longest_bar_is_that_of_the_commonest_value():
    lines = histogram(np.array([0.0] * 30 + [1.0] * 15 + [-1.0] * 15, np.float32))
    lengths = [line.count("#") for line in lines]
    assert lengths == [20, 0, 0, 0, 0, 40, 0, 0, 0, 0, 20]
    assert lines[5].endswith(" 50.00 %")


def test_a_rare_value_leaves_a_mark():
    lines = histogram(np.array([0.0] * 1000 + [1.0], np.float32))
    assert "." in lines[-1].split(" to ")[1][6:20]
    assert lines[-2].split()[-2] == "0.00"


def test_no_values_give_no_bars():
    assert not any("#" in line for line in histogram(np.zeros(0, np.float32)))
