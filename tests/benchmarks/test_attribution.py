"""Sharing lost metres among channels."""

import json

import pytest

from benchmarks.attribute_command import report
from benchmarks.attribution import attribute, clean_metres, substituted, substitutions
from benchmarks.cli import main
from benchmarks.drive import EpisodeResult
from benchmarks.shapley import coalitions
from benchmarks.suites import Job

CHANNELS = ("road", "route", "lane")
JOB = Job("Town02", "episode", 1, "cvt_kde", "bc", 0, "test")
STRAIGHTENED = "ground_truth~straightening=1,latency=0.5@route"


def test_with_all_channels_true_it_is_the_ground_truth_itself():
    assert substituted(JOB, CHANNELS, frozenset(CHANNELS)).bev == "ground_truth"
    assert substituted(JOB, CHANNELS, frozenset()) == JOB
    true = frozenset({"route", "lane"})
    assert substituted(JOB, CHANNELS, true).bev == "cvt_kde|lane=ground_truth,route=ground_truth"


def test_each_drive_is_needed_once():
    other = Job("Town02", "episode", 1, "unet", "bc", 0, "test")
    drives = substitutions([JOB, other], CHANNELS)
    assert len(drives) == len(set(drives)) == 8 + 7


def test_costs_add_up_to_what_was_lost(make_result):
    worth = {
        true: 40.0 + 60.0 * ("route" in true) + 15.0 * (len(true) == 3)
        for true in coalitions(CHANNELS)
    }
    results = {}
    for true, driven in worth.items():
        job = substituted(JOB, CHANNELS, true)
        row = make_result(driven_m=driven).as_dict()
        results[job] = EpisodeResult.from_dict({**row, "job": job.as_dict()})
    found = attribute(JOB, CHANNELS, results)
    assert found.lost_m == pytest.approx(75.0)
    assert sum(found.cost_m.values()) == pytest.approx(75.0)
    assert found.cost_m == pytest.approx({"lane": 5.0, "road": 5.0, "route": 65.0})
    del results[JOB]
    with pytest.raises(ValueError, match="is missing"):
        attribute(JOB, CHANNELS, results)


def test_metres_after_an_infraction_do_not_count(make_result):
    assert clean_metres(make_result(driven_m=80.0)) == 80.0
    assert (
        clean_metres(make_result(driven_m=80.0, infraction="off_road", infraction_m=30.0)) == 30.0
    )


@pytest.mark.slow
def test_a_planted_fault_is_found_and_a_second_run_adds_nothing(tmp_path, capsys):
    arguments = ["attribute", "--bev", STRAIGHTENED, "--town", "Town02", "--workers", "2"]
    arguments += ["--out", str(tmp_path)]
    assert main(arguments) == 0
    kept = json.loads((tmp_path / "attribution.json").read_text(encoding="utf-8"))
    for each in kept["attributions"]:
        cost, lost = each["cost_m"], each["lost_m"]
        assert sum(cost.values()) == pytest.approx(lost)
        assert cost["route"] == pytest.approx(lost)
    assert sum(each["lost_m"] for each in kept["attributions"]) > 100.0
    for rescue in kept["rescues"]:
        saving = [attempt for attempt in rescue["attempts"] if attempt["saved_by"]]
        assert [attempt["saved_by"] for attempt in saving] == [["route"]]
    first = capsys.readouterr().out
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "episodes").iterdir()}
    assert main(arguments) == 0
    assert capsys.readouterr().out == first
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_less_than_half_a_metre_is_written_without_a_sign(make_result):
    job = make_result(bev="cvt", driven_m=99.0).job
    results = {}
    for true in coalitions(CHANNELS):
        each = substituted(job, CHANNELS, true)
        row = make_result(driven_m=99.0 if len(true) < 3 else 98.8).as_dict()
        results[each] = EpisodeResult.from_dict({**row, "job": each.as_dict()})
    text = report([attribute(job, CHANNELS, results)], {}, CHANNELS)
    assert "-0" not in text
