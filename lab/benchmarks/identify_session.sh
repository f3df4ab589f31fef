#!/usr/bin/env bash
# The accuracy of identification on a machine of many cores without a network; run from the repository's root.
#   identify_session.sh setup            unpack the packed wheels (.cache/sysid_wheels) into the folder $SITE; set SITE for the
#                                        other stages, too
#   identify_session.sh run NAME ...     lab/benchmarks/identify_fake.py with these options; $OUT/NAME.tar.gz at the end
#   identify_session.sh loop TRUTH IDENTIFIED.onnx ORACLE.onnx      the closed loop's table; $OUT/loop-TRUTH.tar.gz
# Everything else goes to $WORK, by default a new temporary folder. What is there after $LIMIT_S seconds is packed, finished or not.
set -euo pipefail
WORK=${WORK:-$(mktemp -d)}
OUT=${OUT:-out}
LIMIT_S=${LIMIT_S:-480}
export PYTHONPATH="${SITE:+$SITE:}$PWD" PYTHONUNBUFFERED=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
mkdir -p "$OUT"

setup() {
    : "${SITE:?set SITE to the folder into which the wheels are unpacked}"
    if [ ! -d "$SITE/mcap" ]; then
        for wheel in .cache/sysid_wheels/*.whl; do
            python3 -m zipfile -e "$wheel" "$SITE"
        done
    fi
    python3 -c 'import importlib.metadata as m; m.version("spot-rl"); import mujoco, numpy, scipy, grpc, mcap, cmaes, bosdyn.client
print("ready:", mujoco.__version__, numpy.__version__, scipy.__version__, grpc.__version__)'
}

run() {
    local name=$1 folder=$WORK/identify-$1
    shift
    mkdir -p "$folder"
    timeout --signal=INT --kill-after=10 "$LIMIT_S" \
        python3 lab/benchmarks/identify_fake.py --out "$folder" "$@" >"$folder/console.txt" 2>&1 || true
    python3 lab/benchmarks/identify_fake.py --out "$folder" --table --pack "$OUT/$name.tar.gz"
}

loop() {
    local truth=$1 folder=$WORK/loop-$1
    mkdir -p "$folder"
    timeout --signal=INT --kill-after=10 "$LIMIT_S" python3 examples/close_the_loop.py --out "$folder" --truth "$truth" \
        --identified "$2" --oracle "$3" --runs-at-once 6 >"$folder/console.txt" 2>&1 || true
    tar -czf "$OUT/loop-$truth.tar.gz" -C "$folder" --exclude '*.mcap' --exclude incidents .
}

stage=$1
shift
"$stage" "$@"
