#!/usr/bin/env bash
# A run's motion.mcap, read by Foxglove's own reader of ROS 2 messages: each message decodes and says what the tables say.
set -euo pipefail
for setup in A B; do
    rm -rf "${OUT:?}/$setup"
    "$NODES/bench" --setup "$setup" --mode virtual --reps 1 --mcap --quiet --out "$OUT/$setup" >/dev/null
    "$VENV/bin/python" scripts/interop/peers/playback.py "$OUT/$setup"
done
