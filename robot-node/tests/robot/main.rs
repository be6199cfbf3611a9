//! The robot from outside: a file for each thing that it must do, in one program, since every program links the whole
//! robot again.
//!
//! Two of the helpers drive it: [`driven`] feeds a bare controller every cycle, [`plc`] writes to a robot on a cable,
//! and [`fed`] feeds a bare path. The
//! others are what its motions are compared with: [`drawn`] draws single motions, [`recorded`] records what is driven,
//! [`fastest`] finds the least time.

#![expect(clippy::panic, clippy::unwrap_used, reason = "a test fails by panicking")]

mod drawn;
mod driven;
mod fastest;
mod fed;
mod plc;
mod recorded;

mod altered_images;
mod any_order;
mod application;
mod bad_input;
mod blocks;
mod buffer_mode;
mod cell;
mod commands;
mod configuration;
mod corners;
mod curves;
mod deep_queue;
mod drives;
mod driving;
mod force;
mod force_limits;
mod frames;
mod in_line;
mod limits;
mod meeting;
mod moving_together;
mod old_images;
mod optimum;
mod outputs;
mod overrides;
mod planned_reach;
mod quality;
mod random_applications;
mod rehearsal;
mod singular;
mod six_axes;
mod skills;
mod start_times;
mod states;
mod stored;
mod straight_on;
mod suspending;
mod trajectory;
mod waiting;
mod zones;
