#!/usr/bin/env bash
# Trains the loop's policies on a lent machine of several GPUs, one a GPU; run from the repository's root after
# `benchmarks/gpu_session.sh setup`. Into $OUT: NAME.onnx and NAME-metrics.jsonl for each.
#   loop_session.sh SECONDS NAME...      NAME: paper_identified, paper_oracle, harsher_identified, harsher_oracle
set -euo pipefail
SITE=${SITE:-/tmp/site}
OUT=${OUT:-out}
export PYTHONPATH="$SITE:$PWD" PYTHONUNBUFFERED=1 OMP_WAIT_POLICY=PASSIVE
mkdir -p "$OUT"
seconds=$1
shift

one() {
    local name=$1 gpu=$2 run=runs/loop_$1
    rm -rf "$run"
    timeout --signal=INT "$seconds" python3 -m trainer train --config "examples/loop/train_$name.yaml" \
        --device "cuda:$gpu" --out "$run" >"$OUT/$name.log" 2>&1 || true
    cp "$run/metrics.jsonl" "$OUT/$name-metrics.jsonl"
    CUDA_VISIBLE_DEVICES="" python3 -m trainer export "$run" --out "$OUT/$name.onnx" >>"$OUT/$name.log" 2>&1
}

gpu=0
for name in "$@"; do
    one "$name" "$gpu" &
    gpu=$((gpu + 1))
done
wait
ls -l "$OUT"
