#!/usr/bin/env bash
# What the parts of the Cross-View Transformer `fast` are worth: the same few frames for each, from
# random weights. Wants the logs of recipes/predictors.sh. What is given to this script is given to
# every training, after its own options.
set -euo pipefail
given=("$@")

train() {  # train NAME CHANGES...
    local name=$1; shift
    bev-perception train --preset fast --loss bce_dice --data data/town01 data/town01_dense \
        --steps 160 --validate-every 80 --seed 0 --out "runs/ablations/$name" \
        ${1:+--set "$@"} "${given[@]}"
}

train fast
train tied positions=tied                # the viewing direction itself, not its Fourier code
train independent positions=independent  # as published
train fake_camera route_map=camera       # the route map as one more image, as published
train ground_skip ground_skip=true       # images projected to the ground join in the BEV frame
