#!/usr/bin/env bash
# Trains the predictors that come with BEVTown, from nothing: six hours on one core, less on more.
# Whatever is finished is left alone, and what was interrupted goes on. What is given to this
# script is given to every training, after its own options: --workers 4 --device cuda, say.
set -euo pipefail
data=data runs=runs
given=("$@")

collect() {  # collect NAME OPTIONS...
    local name=$1; shift
    bev-agents collect --town Town01 --out "$data/$name" "$@"
}

train() {  # train NAME OPTIONS...
    local name=$1; shift
    bev-perception train --out "$runs/$name" --seed 0 --patience 1000 "$@" "${given[@]}"
}

collect town01 --collections 5
collect town01_dense --collections 5 --traffic dense --lights
collect town01_smooth --levels 0 --traffic dense --lights  # nobody disturbs the expert
perturbed=(--data "$data/town01" "$data/town01_dense")
smooth=(--data "$data/town01_smooth")
kde=(--temper 0.5 --clip 5)

# given the geometry; two that go on from one and the same beginning
ipm=(--preset ipm_unet --loss bce_dice --looks wild "${perturbed[@]}")
train ipm_start "${ipm[@]}" --steps 4000 --validate-every 500
ipm+=(--start "$runs/ipm_start/predictor.safetensors")
ipm+=(--steps 3600 --validate-every 450 --learning-rate 1e-3)
train ipm_unet_kde "${ipm[@]}" --weighting kde+actors "${kde[@]}"
train ipm_unet "${ipm[@]}"

# the paper's systems: four Cross-View Transformers that go on from one and the same beginning
train cvt_start --preset fast --loss bce_dice --steps 1600 --validate-every 400 "${smooth[@]}"
cvt=(--preset fast --loss bce_dice --looks wild --start "$runs/cvt_start/predictor.safetensors")
cvt+=(--steps 900 --validate-every 300 --learning-rate 1e-3)
train cvt_kde "${cvt[@]}" "${perturbed[@]}" --weighting kde "${kde[@]}"
train cvt "${cvt[@]}" "${perturbed[@]}"
train cvt_no_noise "${cvt[@]}" "${smooth[@]}"
train cvt_3ch "${cvt[@]}" "${perturbed[@]}" --channels road route lane

# those that are not given it, and the floor
train unet --preset unet --loss bce_dice --looks wild --steps 1200 --validate-every 300 "${perturbed[@]}"
train blind --preset blind --loss bce_dice --steps 800 --validate-every 200 "${perturbed[@]}"
