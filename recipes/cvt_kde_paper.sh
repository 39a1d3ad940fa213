#!/usr/bin/env bash
# Trains the published Cross-View Transformer (EfficientNet-B4, four images of 224 x 480, all six
# channels) with KDE weights. Sized for 25 minutes of one H200 at some 130 frames a second, which
# is an estimate: nobody has run it yet. It resumes when it is interrupted. What is given to this
# script is given to the training, after its own options.
set -euo pipefail
bev-agents collect --town Town01 --collections 5 --out data/town01
bev-agents collect --town Town01 --collections 5 --traffic dense --lights --out data/town01_dense
bev-perception train --preset paper --weighting kde --temper 0.5 --clip 5 \
    --data data/town01 data/town01_dense --out runs/cvt_kde_paper --seed 0 \
    --looks wild --batch-size 32 --steps 6000 --validate-every 1000 --patience 1000 \
    --learning-rate 1e-3 --device cuda --precision bf16 --workers 14 "$@"
