#!/usr/bin/env bash
# Install the fake robot into an environment of its own, start it, and tell the job how to reach it.
#
# Reads PYTHON, SOURCE (this repository), SCENARIO, PORT; GITHUB_ENV and GITHUB_OUTPUT as GitHub sets them.
set -euo pipefail

folder=${RUNNER_TEMP:-/tmp}/spot-rl-fake
mkdir -p "$folder"
if [ ! -x "$folder/venv/bin/spot-rl" ]; then
  "$PYTHON" -m venv "$folder/venv"
  "$folder/venv/bin/python" -m pip install --quiet -c "$SOURCE/requirements.lock" "$SOURCE[fake]"
fi

nohup "$folder/venv/bin/spot-rl" fake-robot --scenario "$SCENARIO" --port "$PORT" --json \
  --state-dir "$folder/state" > "$folder/ready.json" 2> "$folder/log" &
robot=$!
echo "$robot" > "$folder/pid"

for _ in $(seq 600); do
  [ -s "$folder/ready.json" ] && break
  if ! kill -0 "$robot" 2> /dev/null; then
    cat "$folder/log" >&2
    exit 1
  fi
  sleep 0.1
done

"$folder/venv/bin/python" - "$folder/ready.json" << 'PYTHON'
import json
import os
import sys

told = json.load(open(sys.argv[1], encoding="utf-8"))
with open(os.environ["GITHUB_ENV"], "a", encoding="utf-8") as variables:
    variables.writelines(f"{name}={value}\n" for name, value in told["environment"].items())
with open(os.environ["GITHUB_OUTPUT"], "a", encoding="utf-8") as outputs:
    outputs.write(f"host={told['sdk_host']}\n")
print(f"fake Spot at {told['sdk_host']}")
PYTHON
