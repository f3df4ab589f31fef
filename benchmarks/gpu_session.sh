#!/usr/bin/env bash
# One stage of a session on a lent GPU machine without a network; run from the repository's root.
#   setup            lay the packed wheels (.gpu, .whl) into $SITE
#   check            parity of the two back ends, then training speed at three sizes, as JSON
#   train NAME [S]   train policies/NAME.yaml for at most S seconds, then export to $OUT
#   sweep FILE S C   CPU trainings of policies/walk.yaml with FILE's options (a name and options a line), C cores
#                    each from core 4 upwards, for at most S seconds; metrics and policies into $OUT/sweep.tar.gz
#   scale N          training speed on N GPUs by torchrun, as JSON
set -euo pipefail
SITE=${SITE:-/tmp/site}
OUT=${OUT:-out}
DEVICE=${DEVICE:-cuda}
export PYTHONPATH="$SITE:$PWD" PYTHONUNBUFFERED=1 OMP_WAIT_POLICY=PASSIVE
mkdir -p "$OUT"

setup() {
    for part in .gpu/1 .gpu/2; do
        if [ -d "$part" ]; then python3 "$part/gpu_stack.py" unpack "$part" "$SITE"; fi
    done
    for wheel in .whl/*.whl; do
        if [ -e "$wheel" ]; then python3 -m zipfile -e "$wheel" "$SITE"; fi
    done
}

check() {
    nvidia-smi -L
    python3 benchmarks/gpu_parity.py cuda:0 256 50 | tee "$OUT/parity.jsonl"
    for n in 4096 8192 16384; do
        python3 -m trainer bench-train --device "$DEVICE" --set "n_envs=$n" --json | tee -a "$OUT/bench.jsonl"
    done
}

train() {
    local name=$1 seconds=${2:-520} run=runs/$1
    shift; shift || true
    rm -rf "$run"
    timeout --signal=INT "$seconds" \
        python3 -m trainer train --config "policies/$name.yaml" --device "$DEVICE" --out "$run" "$@" || true
    cp "$run/metrics.jsonl" "$OUT/$name-metrics.jsonl"
    rm -f "$OUT/$name.onnx"
    python3 -m trainer export "$run" --out "$OUT/$name.onnx" --networks "$OUT/$name-networks.pt"
}

sweep() {
    local file=$1 seconds=$2 cores=${3:-2} core=4 name options
    mkdir -p runs/sweep
    while read -r name options; do
        # shellcheck disable=SC2086
        taskset -c "$core-$((core + cores - 1))" timeout --signal=INT "$seconds" \
            python3 -m trainer train --config policies/walk.yaml --device cpu --out "runs/sweep/$name" $options \
            </dev/null >"runs/sweep/$name.log" 2>&1 &
        core=$((core + cores))
    done <"$file"
    wait
    for name in runs/sweep/*/; do
        python3 -m trainer export "$name" --out "$name/policy.onnx" || true
    done
    tar -czf "$OUT/sweep.tar.gz" --exclude tensorboard --exclude '*.pt' runs/sweep
}

scale() {
    python3 -m torch.distributed.run --standalone --nproc-per-node "$1" \
        -m trainer bench-train --device "$DEVICE" --set n_envs=16384 --json | tee -a "$OUT/scale.jsonl"
}

stage=$1
shift
"$stage" "$@"
