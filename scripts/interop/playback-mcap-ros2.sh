#!/usr/bin/env bash
# A run's motion.mcap, read by Foxglove's reader of ROS 2 messages: every message can be decoded and agrees with the
# tables.
set -euo pipefail
for setup in A B; do
    rm -rf "${OUT:?}/$setup"
    "$NODES/bench" --setup "$setup" --mode virtual --reps 1 --mcap --quiet --out "$OUT/$setup" >/dev/null
    "$VENV/bin/python" scripts/interop/peers/playback.py "$OUT/$setup"
done
