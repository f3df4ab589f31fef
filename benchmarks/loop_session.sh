#!/usr/bin/env bash
# Trains the loop's policies on a machine of several GPUs; run from the repository's root after
# `benchmarks/gpu_session.sh setup`. Into $OUT: NAME.onnx, NAME-metrics.jsonl and NAME.log for each.
#   loop_session.sh SECONDS NAME:GPU...  NAME: paper_identified, paper_oracle, harsher_identified, harsher_oracle
# SETTINGS in the environment are further options of every training, such as "--set iterations=800".
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
    # shellcheck disable=SC2086
    CUDA_VISIBLE_DEVICES=$gpu WARP_CACHE_PATH=/tmp/warp-$name timeout --signal=INT "$seconds" \
        python3 -m trainer train --config "examples/loop/train_$name.yaml" --device cuda --out "$run" ${SETTINGS:-} \
        >"$OUT/$name.log" 2>&1 || true
    cp "$run/metrics.jsonl" "$OUT/$name-metrics.jsonl"
    CUDA_VISIBLE_DEVICES="" python3 -m trainer export "$run" --out "$OUT/$name.onnx" >>"$OUT/$name.log" 2>&1
}

for job in "$@"; do
    one "${job%%:*}" "${job##*:}" &
done
wait
tar -czf "$OUT/loop.tar.gz" -C "$OUT" $(cd "$OUT" && ls -- *identified* *oracle* | tr '\n' ' ')
ls -l "$OUT"
