"""Writes the model cards of the shipped predictors, from their weights and from evaluations.

    python recipes/model_cards.py runs/eval_*/evaluation.json

The evaluations are those of ``recipes/evaluate.sh``.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from evaluations import FIGURES, Row, iou_text, read_rows

import perception
from bev_driving_env.files import write_text
from bev_driving_env.markdown import markdown
from perception.shipped import shipped_path
from perception.starting import distinct_frames, predecessors
from perception.weights import load_predictor, predictor_card

ABOUT = {
    "cvt_kde": "Cross-View Transformer (preset `fast`), six channels, samples weighted by the "
    "density of the expert's actions: the paper's *CVT 6ch. KDE*",
    "cvt": "Cross-View Transformer (preset `fast`), six channels, all samples alike: the paper's "
    "*CVT 6ch.*",
    "cvt_no_noise": "Cross-View Transformer (preset `fast`), six channels, trained on few drives "
    "that nobody disturbed: the paper's *CVT 6ch. No Noise*",
    "cvt_3ch": "Cross-View Transformer (preset `fast`), road, route and lane only: the paper's "
    "*CVT 3ch.*",
    "unet": "images and route map in, BEV out, no geometry: the U-Net of the paper's authors' "
    "earlier study",
    "blind": "the route map alone, no cameras: the floor that every predictor is measured against",
    "ipm_unet": "images projected to flat ground, and the route map, into a U-Net over the BEV; "
    "all samples alike",
    "ipm_unet_kde": "images projected to flat ground, and the route map, into a U-Net over the "
    "BEV; samples weighted by the density of the expert's actions, in the actors' channels by "
    "that of actors, too",
}


def card_text(name: str, measured: Sequence[Row]) -> str:
    """The model card of a shipped predictor as Markdown, with the rows of its evaluations."""
    path = shipped_path(name)
    card, predictor = predictor_card(path), load_predictor(path)
    parameters = sum(each.numel() for each in predictor.model.parameters())
    before = list(predecessors(card))
    rows = [
        ["Command", f"`{card['command']}`"],
        ["Commit", card["git_commit"][:12]],
        ["Seed", ", ".join(map(str, card["seeds"]))],
        ["Data", f"Town01: {', '.join(map(_folder, card['data']))} (`recipes/predictors.sh`)"],
        [
            "Frames",
            f"{card['samples']:,} in {card['steps']:,} steps of {card['batch_size']}; "
            f"the weights are those after step {card['best_step']:,}; {distinct_frames(card):,} "
            f"different ones, each with a look of its own"
            + (", with those of what it goes on from" if before else ""),
        ],
        ["Loss", f"{card['loss']}, weighting {_weighting(card)}"],
        ["Time", f"{60 * card['hours']:.0f} minutes on one shared core, {card['precision']}"],
        ["Machine", card["machine"]],
        ["Size", f"{parameters:,} parameters, {path.stat().st_size / 1e6:.1f} MB in fp16"],
        ["Thresholds", _by_channel(predictor.channels, predictor.thresholds, "{:.2f}")],
        ["Validation IoU", _named(card["validation"]["iou"]) + " (route 0 of the same logs)"],
    ]
    for k, start in enumerate(before):
        told = (
            f"a predictor trained by `{start['command']}` at {start['git_commit'][:12]}, "
            f"{start['samples']:,} frames"
        )
        rows.insert(1 + k, ["which started from" if k else "Started from", told])
    mine = [row for row in measured if (row.source, row.leaks) == (name, False)]
    header = ["Frames of", "Looks", *FIGURES]
    return (
        f"# Model card: `{name}`\n\n{ABOUT[name][0].upper()}{ABOUT[name][1:]}. Trained on drives "
        "of the privileged expert in **Town01 only**.\n\n"
        f"{markdown(['', ''], rows, text_columns=2)}\n\n"
        "IoU on frames that it was not trained on (dataset-level, thresholds as above). No weight "
        "was trained, no threshold tuned and no checkpoint chosen on Town02 or on the looks `test` "
        "and `hard`; that looks are randomised in training was decided on seeing how much "
        "predictors lost from one look to another there.\n\n"
        f"{markdown(header, list(map(_cells, mine)), text_columns=2)}\n"
    )


def _cells(row: Row) -> list[str]:
    split = "" if row.split == "all" else f", split {row.split}"
    return [f"`{row.log}`{split}", row.appearance, *row.figures]


def _weighting(card: Mapping[str, Any]) -> str:
    if card["weighting"] == "none":
        return "none"
    settings = card["weighting_settings"]
    told = f"temper {settings['temper']}, clip {settings['clip']}, h {settings['bandwidth']}"
    sizes = {f"{size:,.0f}" for size in card["effective_sample_size"].values()}
    return f"{card['weighting']} ({told}); effective sample size {' to '.join(sorted(sizes))}"


def _folder(path: str) -> str:
    return f"`{PurePath(path).name}`"


def _by_channel(channels: Sequence[str], values: Sequence[float], form: str) -> str:
    pairs = zip(channels, values, strict=True)
    return ", ".join(f"{channel} {form.format(value)}" for channel, value in pairs)


def _named(iou: Mapping[str, float | None]) -> str:
    return ", ".join(f"{channel} {iou_text(value)}" for channel, value in iou.items())


def main() -> None:
    """Write one card a predictor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("evaluations", nargs="+", type=Path, metavar="evaluation.json")
    measured = read_rows(parser.parse_args().evaluations)
    for name in perception.SHIPPED:
        path = shipped_path(name).with_suffix(".md")
        write_text(path, card_text(name, measured))
        print(path)


if __name__ == "__main__":
    main()
