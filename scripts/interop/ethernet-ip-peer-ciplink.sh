#!/usr/bin/env bash
# `bench doctor --peer robot` looks at the adapter of the crate `ciplink`: its identity, its assemblies, then its images. The
# peer gets no command.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/ciplink-robot"
says peer listening
start doctor at_plc "$NODES/bench" doctor --setup B --interface plc --peer robot
ends doctor 30
says doctor "good +address +$ROBOT_ADDRESS answers"
says doctor 'good +identity +.ciplink robot.'
says doctor 'good +life counter'
says doctor 'good +answer +the robot echoes life counter'
says doctor 'Every step of the robot was seen'
! grep -q 'command ' "$OUT/peer.log" || fail "the peer got a command"
recorded
