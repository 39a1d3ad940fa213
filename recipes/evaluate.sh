#!/usr/bin/env bash
# Measures the shipped predictors on drives of Town02, which nothing was trained on, and on Town01's
# validation route: half an hour on two cores. Wants data/town01_dense of recipes/predictors.sh.
# What is given to this script is given to every evaluation, after its own options. Then
# recipes/predictor_tables.py and recipes/model_cards.py write the figures where they are read.
set -euo pipefail
data=data runs=runs
given=("$@")
all=(cvt_kde cvt cvt_no_noise cvt_3ch unet ipm_unet ipm_unet_kde blind ipm)

collect() {  # collect NAME OPTIONS...
    local name=$1; shift
    bev-agents collect --town Town02 --levels 0 1 --lights --appearance test --out "$data/$name" "$@"
}

evaluate() {  # evaluate NAME OPTIONS...
    local name=$1; shift
    bev-perception evaluate --out "$runs/$name" "$@" "${given[@]}"
}

collect town02_light --traffic light
collect town02_dense --traffic dense
light=$data/town02_light dense=$data/town02_dense
evaluate eval_test --bev "${all[@]}" --samples 300 --data "$light" "$dense"
evaluate eval_hard --bev "${all[@]}" --samples 150 --data "$dense" --appearance hard
evaluate eval_town01 --bev "${all[@]}" --samples 150 --data "$data/town01_dense" --split val \
    --appearance train
evaluate eval_leaks --bev cvt_kde ipm_unet_kde blind --samples 150 --data "$dense" --leaks
