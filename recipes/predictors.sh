#!/usr/bin/env bash
# Trains the predictors that come with BEVTown, from nothing: twelve hours on one core, less on more.
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

# given the geometry, each going on from the one before
ipm=(--preset ipm_unet --loss bce_dice --looks wild "${perturbed[@]}")
train ipm_start "${ipm[@]}" --steps 4000 --validate-every 500
train ipm_half "${ipm[@]}" --start "$runs/ipm_start/predictor.safetensors" \
    --steps 3600 --validate-every 450 --learning-rate 1e-3
train ipm_unet "${ipm[@]}" --start "$runs/ipm_half/predictor.safetensors" \
    --steps 5000 --validate-every 500 --learning-rate 8e-4
train ipm_unet_kde "${ipm[@]}" --start "$runs/ipm_unet/predictor.safetensors" \
    --steps 2400 --validate-every 400 --learning-rate 5e-4 --weighting kde+actors "${kde[@]}"

# the paper's systems: Cross-View Transformers that go on from one and the same beginning
train cvt_start --preset fast --loss bce_dice --steps 1600 --validate-every 400 "${smooth[@]}"
cvt=(--preset fast --loss bce_dice --looks wild)
short=("${cvt[@]}" --start "$runs/cvt_start/predictor.safetensors")
short+=(--steps 900 --validate-every 300 --learning-rate 1e-3)
train cvt_no_noise "${short[@]}" "${smooth[@]}"
train cvt_3ch "${short[@]}" "${perturbed[@]}" --channels road route lane
train cvt_short "${short[@]}" "${perturbed[@]}"

# two of them for longer: cvt_kde leaves the way of cvt half-way
long=("${cvt[@]}" "${perturbed[@]}" --start "$runs/cvt_short/predictor.safetensors")
long+=(--steps 8000 --validate-every 800 --learning-rate 8e-4)
train cvt "${long[@]}" --until 4000
if [ ! -d "$runs/cvt_half" ]; then
    rm -rf "$runs/cvt_half.part"
    cp -r "$runs/cvt" "$runs/cvt_half.part"
    mv "$runs/cvt_half.part" "$runs/cvt_half"
fi
train cvt_kde "${cvt[@]}" "${perturbed[@]}" --start "$runs/cvt_half/predictor.safetensors" \
    --steps 2600 --validate-every 400 --learning-rate 7e-4 --weighting kde "${kde[@]}"
train cvt "${long[@]}" --until 5600

# those that are not given it, and the floor
train unet --preset unet --loss bce_dice --looks wild --steps 1200 --validate-every 300 "${perturbed[@]}"
train blind --preset blind --loss bce_dice --steps 800 --validate-every 200 "${perturbed[@]}"
