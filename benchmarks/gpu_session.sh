#!/usr/bin/env bash
# One stage of a session on a GPU machine without a network; run from the repository's root.
#   setup            unpack the packed wheels (.gpu, .whl) into the folder $SITE; set SITE for the other stages, too
#   check            parity of the two back ends, then training speed at three sizes, as JSON
#   train NAME [S]   train policies/NAME.yaml for at most S seconds, then export to $OUT; CUDA_VISIBLE_DEVICES picks a GPU
#   trainings FILE S   several side by side, FILE's lines being: GPU LABEL NAME OPTIONS...; each on $CORES_A_GPU (2)
#                    cores of its GPU's own, from core 0 upwards; each judged at the end; $OUT/LABEL.tar.gz each
#   piece LABEL NAME CORES S   S seconds of a CPU training of policies/NAME.yaml on these cores; continues exactly where
#                    .cache/pieces/LABEL.tar.gz stands, if that is there; $OUT/LABEL.tar.gz
#   sweep FILE S     CPU trainings side by side, FILE's lines being: CORES LABEL NAME OPTIONS...; each on cores of its
#                    own from core $FIRST_CORE (8) upwards, for at most S seconds; all into $OUT/sweep.tar.gz
#   cpubench CORES   training speed on these CPU cores ("6,7"), as JSON
#   scale N          training speed on N GPUs by torchrun, as JSON
set -euo pipefail
OUT=${OUT:-out}
DEVICE=${DEVICE:-cuda}
export PYTHONPATH="${SITE:+$SITE:}$PWD" PYTHONUNBUFFERED=1 OMP_WAIT_POLICY=PASSIVE
mkdir -p "$OUT" runs

setup() {
    : "${SITE:?set SITE to the folder into which the wheels are unpacked}"
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
        python3 -m proof.training --device "$DEVICE" --set "n_envs=$n" --json | tee -a "$OUT/bench.jsonl"
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

trainings() {
    local file=$1 seconds=$2 gpu label name options each=${CORES_A_GPU:-2} cores
    while read -r gpu label name options; do
        # Each with its own kernel cache: two that compile into one at once are in each other's way.
        # shellcheck disable=SC2086
        (
            export CUDA_VISIBLE_DEVICES=$gpu WARP_CACHE_PATH=$PWD/runs/warp-$label
            cores=$((each * gpu))-$((each * gpu + each - 1))
            taskset -c "$cores" \
                bash "$0" one_training "$label" "$seconds" --config "policies/$name.yaml" --device "$DEVICE" $options
            tar -czf "$OUT/$label.tar.gz" --exclude tensorboard --exclude 'checkpoint_*' "runs/$label"
            taskset -c "$cores" timeout "${JUDGE_S:-120}" \
                python3 benchmarks/judge_policy.py "runs/$label/policy.onnx" --seeds 5 >"$OUT/$label-judged.jsonl" 2>&1 || true
        ) </dev/null >/dev/null 2>&1 &
    done < <(grep -v '^#' "$file")
    wait
}

sweep() {
    local file=$1 seconds=$2 core=${FIRST_CORE:-8} cores label name options
    while read -r cores label name options; do
        # shellcheck disable=SC2086
        taskset -c "$core-$((core + cores - 1))" \
            bash "$0" one_training "$label" "$seconds" --config "policies/$name.yaml" --device cpu $options \
            </dev/null >/dev/null 2>&1 &
        core=$((core + cores))
    done < <(grep -v '^#' "$file")
    wait
    # shellcheck disable=SC2046
    tar -czf "$OUT/sweep.tar.gz" --exclude tensorboard --exclude 'checkpoint_*' \
        $(grep -v '^#' "$file" | while read -r _ label _; do echo "runs/$label"; done)
}

one_training() {
    local label=$1 seconds=$2 run=runs/$1
    shift 2
    rm -rf "$run"
    timeout --signal=INT "$seconds" python3 -m trainer train "$@" --out "$run" >"$run.log" 2>&1 || true
    python3 -m trainer export "$run" --out "$run/policy.onnx" --networks "$run/networks.pt" >>"$run.log" 2>&1 || true
    mv "$run.log" "$run/training.log"
}

piece() {
    local label=$1 name=$2 cores=$3 seconds=$4 run=runs/$1
    if [ -e ".cache/pieces/$label.tar.gz" ] && [ ! -d "$run" ]; then tar -xzf ".cache/pieces/$label.tar.gz"; fi
    local what=(--config "policies/$name.yaml" --set save_every=10 --out "$run")
    if [ -d "$run" ]; then
        what=(--resume "$run")
        rm -f "$run/policy.onnx"
    fi
    taskset -c "$cores" timeout --signal=INT "$seconds" \
        python3 -m trainer train "${what[@]}" --device cpu >>"$run.log" 2>&1 || true
    taskset -c "$cores" python3 -m trainer export "$run" --out "$run/policy.onnx" >>"$run.log" 2>&1 || true
    cp "$run.log" "$run/training.log"
    # shellcheck disable=SC2012
    ls "$run"/checkpoint_* | head -n -1 | xargs -r rm
    tar -czf "$OUT/$label.tar.gz" --exclude tensorboard "$run"
}

cpubench() {
    for options in n_envs=1024 n_envs=2048 n_envs=4096 "n_envs=2048 --set ppo.hidden=[256,128,64]"; do
        # shellcheck disable=SC2086
        taskset -c "$1" python3 -m proof.training --device cpu --json --set $options | tee -a "$OUT/cpubench.jsonl"
    done
}

scale() {
    python3 -m torch.distributed.run --standalone --nproc-per-node "$1" \
        -m proof.training --device "$DEVICE" --set n_envs=16384 --json | tee -a "$OUT/scale.jsonl"
}

stage=$1
shift
"$stage" "$@"
