#!/usr/bin/env bash
# Our scanner controls the adapter of the crate `ciplink`: RegisterSession, Forward_Open with electronic key, class 1
# data in both directions at 1 ms, Forward_Close. The peer acts as a robot that executes nothing; a run ends only if
# the peer receives our command image and we receive its feedback.
# shellcheck source=scripts/interop/cell.sh
. scripts/interop/cell.sh

at_robot ip address add "$ROBOT_ADDRESS/24" dev robot
start peer at_robot "$PEERS/ciplink-robot"
says peer listening
start plc_node at_plc "$NODES/plc-node" run --setup B --interface plc --types rc,cm
ends plc_node 30

# We received the peer's own figures ...
says plc_node 'rc .* by the robot.s clock   123\.456 ms; 7 motions'
says plc_node 'cm .* by the robot.s clock   123\.456 ms; [0-9]+ motions'
# ... and the peer received ours: the program to run, then every motion through the five slots.
says peer 'kind: ExclusiveOwner.* t_o_rpi: 1ms.* input_size: 256, .* output_size: 256'
says peer 'command [0-9]+: skill 17, 0 motions, program 1'
says peer 'command [0-9]+: skill 16, [0-9]+ motions'
says peer 'targets .*300\.0, 300\.0'
says peer closed
recorded
