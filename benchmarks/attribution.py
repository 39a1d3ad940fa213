"""Which channel cost how many metres: drives with every subset of channels set to the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from bev_driving_env.sources.expressions import TRUTH, with_truth

from .drive import EpisodeResult
from .shapley import Coalition, coalitions, shapley_values
from .suites import Job


@dataclass(frozen=True)
class Attribution:
    """What one drive lost, and by which channels.

    Attributes:
        job: The drive with all channels predicted.
        result: What came of it.
        worth_m: Metres driven cleanly with each subset of channels replaced by the truth.
        cost_m: Metres that each channel's errors cost: Shapley values, which add up to what the
            drive with true channels has more than that with predicted ones. One that helps by
            accident has a negative one.
    """

    job: Job
    result: EpisodeResult
    worth_m: Mapping[Coalition, float]
    cost_m: Mapping[str, float]

    @property
    def lost_m(self) -> float:
        """Clean metres with all channels true, less those with all predicted."""
        return self.worth_m[frozenset(self.cost_m)] - self.worth_m[frozenset()]

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready fields; subsets are named by their channels."""
        return {
            "job": self.job.as_dict(),
            "clean": self.result.clean,
            "infraction": self.result.infraction,
            "lost_m": self.lost_m,
            "cost_m": dict(self.cost_m),
            "worth_m": {"+".join(sorted(true)): worth for true, worth in self.worth_m.items()},
        }


def clean_metres(result: EpisodeResult) -> float:
    """Route metres up to the first infraction; to the end if there is none."""
    return result.driven_m if result.infraction_m is None else result.infraction_m


def substituted(job: Job, channels: Sequence[str], true: Coalition) -> Job:
    """The same drive with some channels replaced by the truth.

    With all that the attribution is about replaced, it is the ground truth itself, so that it
    equals a run on that bit for bit and is driven once for all sources.
    """
    if true == frozenset(channels):
        return replace(job, bev=TRUTH)
    return replace(job, bev=with_truth(job.bev, sorted(true)))


def substitutions(jobs: Sequence[Job], channels: Sequence[str]) -> list[Job]:
    """All drives that an attribution needs, each once."""
    made = [substituted(job, channels, true) for job in jobs for true in coalitions(channels)]
    return list(dict.fromkeys(made))


def attribute(
    job: Job, channels: Sequence[str], results: Mapping[Job, EpisodeResult]
) -> Attribution:
    """Share what a drive lost among channels.

    Args:
        job: The drive with all channels predicted.
        channels: Those that are replaced.
        results: Of all of ``substitutions([job], channels)``.

    Raises:
        ValueError: A result is missing.
    """
    worth = {}
    for true in coalitions(channels):
        drive = substituted(job, channels, true)
        if drive not in results:
            raise ValueError(f"the drive with true {sorted(true)} is missing: {drive}")
        worth[true] = clean_metres(results[drive])
    return Attribution(job, results[job], worth, shapley_values(worth))
