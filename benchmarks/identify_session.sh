#!/usr/bin/env bash
# The accuracy of identification on a machine of many cores without a network; run from the repository's root.
#   identify_session.sh setup            lay the packed wheels (.cache/sysid_wheels) into $SITE
#   identify_session.sh run NAME ...     benchmarks/identify_fake.py with these options; $OUT/NAME.tar.gz at the end
#   identify_session.sh loop TRUTH IDENTIFIED.onnx ORACLE.onnx      the closed loop's table; $OUT/loop-TRUTH.tar.gz
#   identify_session.sh all GPU_CORES CORES                        the loop's trainings on four GPUs too, and all of the above
# What is there after $LIMIT_S seconds is packed, finished or not.
set -euo pipefail
SITE=${SITE:-/tmp/site_identify}
OUT=${OUT:-out}
LIMIT_S=${LIMIT_S:-480}
export PYTHONPATH="$SITE:$PWD" PYTHONUNBUFFERED=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
mkdir -p "$OUT"

setup() {
    if [ ! -d "$SITE/mcap" ]; then
        for wheel in .cache/sysid_wheels/*.whl; do
            python3 -m zipfile -e "$wheel" "$SITE"
        done
    fi
    python3 -c 'import importlib.metadata as m; m.version("spot-rl"); import mujoco, numpy, scipy, grpc, mcap, cmaes, bosdyn.client
print("ready:", mujoco.__version__, numpy.__version__, scipy.__version__, grpc.__version__)'
}

run() {
    local name=$1 folder=/tmp/identify-$1
    shift
    mkdir -p "$folder"
    timeout --signal=INT --kill-after=10 "$LIMIT_S" \
        python3 benchmarks/identify_fake.py --out "$folder" "$@" >"$folder/console.txt" 2>&1 || true
    python3 benchmarks/identify_fake.py --out "$folder" --table --pack "$OUT/$name.tar.gz"
}

loop() {
    local truth=$1 folder=/tmp/loop-$1
    mkdir -p "$folder"
    timeout --signal=INT --kill-after=10 "$LIMIT_S" python3 examples/close_the_loop.py --out "$folder" --truth "$truth" \
        --identified "$2" --oracle "$3" --runs-at-once 6 >"$folder/console.txt" 2>&1 || true
    tar -czf "$OUT/loop-$truth.tar.gz" -C "$folder" --exclude '*.mcap' --exclude incidents .
}

# Everything in one call on a machine of four GPUs, after `gpu_session.sh setup`: all GPU_CORES CORES (as for taskset -c).
all() {
    local gpu_cores=$1 cores=$2 made=/tmp/loop-policies
    local names="paper_identified:0 paper_oracle:1 harsher_identified:2 harsher_oracle:3"
    local short="--config benchmarks/identify_short.yaml --repeats 3 --truths-at-once 6 --runs-at-once 2 --workers 2"
    local sequences=forward,six_directions,random,user,benchmarks/sprint.yaml
    setup
    (
        # shellcheck disable=SC2086
        SITE=/tmp/site OUT=$made SETTINGS="--set iterations=${ITERATIONS:-1050}" \
            taskset -c "$gpu_cores" bash benchmarks/loop_session.sh "${TRAIN_S:-395}" $names || true
        cp "$made/loop.tar.gz" "$OUT/loop-policies.tar.gz"
        for truth in paper harsher; do
            LIMIT_S=${DEPLOY_S:-110} taskset -c "$gpu_cores" bash "$0" loop \
                "$truth" "$made/${truth}_identified.onnx" "$made/${truth}_oracle.onnx" &
        done
        wait
    ) &
    # shellcheck disable=SC2086
    taskset -c "$cores" bash "$0" run inertia --inertia --policy policies/baseline.onnx $short &
    # shellcheck disable=SC2086
    nice -n 15 taskset -c "$cores" bash "$0" run plain --sequences "$sequences" $short &
    wait
}

stage=$1
shift
"$stage" "$@"
