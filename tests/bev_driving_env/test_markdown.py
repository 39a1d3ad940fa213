"""Markdown tables."""

from bev_driving_env.markdown import markdown


def test_text_goes_to_the_left_and_figures_to_the_right():
    table = markdown(["Name", "IoU"], [["a", "0.5"], ["longer", "-"]], text_columns=1)
    assert table.splitlines() == [
        "| Name   | IoU |",
        "| ------ | --: |",
        "| a      | 0.5 |",
        "| longer |   - |",
    ]
